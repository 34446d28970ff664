# SPDX-License-Identifier: BSD-3-Clause
"""What tokid's time is measured against computes the same."""

import json
import subprocess
import sys

import numpy as np
from conftest import ROOT
from support import write_ensemble

SCRIPT = ROOT / "bench" / "numpy_tokid.py"


def run(*arguments):
    return subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True, check=False)


def test_numpy_script(tokid, tmp_path):
    data, model, own = tmp_path / "data.npz", tmp_path / "model.npz", tmp_path / "script.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 30, "--steps", 60)
    tokid("identify", data, "-o", model)
    result = run(data, "-o", own, "--check", model)
    assert result.returncode == 0, result.stdout + result.stderr
    assert json.loads(result.stdout)["difference"] < 1e-8

    # Where windows have full rank, there is one observer gain: the same closed loop up to the coordinates.
    with np.load(own) as a, np.load(model) as b:
        assert a["state_dim"].tolist() == b["state_dim"].tolist()
        for k in range(10, 50):
            loops = [np.linalg.eigvals((m["A"][k] + m["G"][k] @ m["C"][k]) @ (m["A"][k - 1] + m["G"][k - 1] @ m["C"][k - 1]))
                     for m in (a, b)]
            assert np.abs(loops).max() < 1e-6  # deadbeat in two steps
    tokid("validate", own, data)  # the tool reads it


def test_numpy_script_tells_another_model(tokid, tmp_path):
    data, model = tmp_path / "data.npz", tmp_path / "model.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 30, "--steps", 60)
    tokid("identify", data, "-o", model, "--states", 3)
    result = run(data, "-o", tmp_path / "script.npz", "--check", model)
    assert result.returncode == 1 and json.loads(result.stdout)["difference"] > 1e-8


# A process of its own: what is forked counts the memory of its parent, too.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def peak(*arguments):
    """Largest memory of a process in bytes."""
    found = subprocess.run([sys.executable, "-c", PEAK, *map(str, arguments)], capture_output=True, text=True, check=True)
    return 1024 * int(found.stdout)


def test_memory_without_blocks(tokid, tmp_path):
    """Of few experiments the model takes as much as the data. What the regressions hold is gone before the validation."""
    small, large = (write_ensemble(tmp_path / f"{steps}.h5", experiments=10, steps=steps) for steps in (200, 100_000))
    own, whole = (peak(tokid.executable, "identify", data, "-o", tmp_path / "model.h5", "--block", "all", "--quiet")
                  for data in (small, large))
    assert whole - own < 8 * 10 * 100_000 * 3 * 8
