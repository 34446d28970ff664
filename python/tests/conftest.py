# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the Python package share."""

import functools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tokid
from tokid import _tokid

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from perturbation import perturbed  # noqa: E402


@pytest.fixture(scope="session")
def tool():
    """tool("identify", …) runs the command line tool, whose path is in TOKID."""

    def run(*words):
        done = subprocess.run([os.environ["TOKID"], *map(str, words)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout) if "--json" in words else done.stdout

    return run


@pytest.fixture(scope="session")
def data():
    """Without noise from zero initial states."""
    return tokid.example("oscillator", experiments=40, steps=30)


@pytest.fixture(scope="session")
def noisy():
    return tokid.example("oscillator", experiments=40, steps=30, process_noise=0.02, measurement_noise=0.05, seed=3)


@pytest.fixture(scope="session")
def model(data):
    return tokid.identify(data)


@pytest.fixture(scope="session")
def python():
    """python(script, *arguments) runs a script in a process of its own, for what a process has once."""

    def run(script, *arguments, check=True):
        return subprocess.run(
            [sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True, check=check, timeout=120
        )

    return run


@pytest.fixture
def same_model():
    def check(a, b):
        for name in ("A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K"):
            assert np.array_equal(getattr(a, name).stack(), getattr(b, name).stack()), name
        assert a.options == b.options and a.k_begin == b.k_begin and a.method == b.method

    return check


@pytest.fixture
def other_processor(monkeypatch):
    """Outputs of ensembles are perturbed, as perturbation.py says."""
    write, example = _tokid.Ensemble.write_outputs, tokid.example

    @functools.wraps(example)
    def perturbed_example(*arguments, **options):
        data = example(*arguments, **options)
        data.y[...] = perturbed(data.y)
        return data

    monkeypatch.setattr(_tokid.Ensemble, "write_outputs", lambda core, y: write(core, perturbed(y)))
    monkeypatch.setattr(tokid, "example", perturbed_example)
