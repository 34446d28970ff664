# SPDX-License-Identifier: BSD-3-Clause
"""The examples in Python run to their end, and their tables agree with docs/how-to/robot.md."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT


@pytest.fixture
def example(tokid, shared_data):
    """Runs an example on the measured data, and gives the lines that it prints."""
    if not shared_data.exists():
        pytest.skip(f"{shared_data} is absent: the measured data are no part of the project")

    def run(name, *arguments, status=0, data=shared_data):
        environment = {**os.environ, "TOKID": tokid.executable, "TOKID_DATA": str(data)}
        result = subprocess.run([sys.executable, ROOT / "examples" / name, *map(str, arguments)], env=environment,
                                capture_output=True, text=True, check=False)
        assert result.returncode == status, result.stdout + result.stderr
        return result.stdout.splitlines() if status == 0 else result.stderr

    return run


def numbers(line):
    """Those that stand by themselves, not in names."""
    return np.array([float(word) for word in line.split() if re.fullmatch(r"-?\d+\.\d+", word)])


def test_pendubot(example):
    lines = example("pendubot.py", "--splits", 1, "--sets", "plain")
    rows = {line[:30].strip(): numbers(line[30:]) for line in lines[2:]}
    published = rows["ARX varying in time, pooled"]
    assert published[:3] == pytest.approx([94.7, 91.6, 93.15], abs=0.051)
    # Means of both positions over 1, 5, 10, 20 steps. Splits differ by a few points, which is less than the distance to
    # the published row over many steps: about 15, 25 and 35 points.
    assert np.all(rows["tokid"][5::3] > published[5::3])
    assert rows["tokid"][2] > published[2] - 2


def test_time_invariant(example):
    lines = example("time_invariant.py")
    fits = numbers(next(line for line in lines if line.startswith("slicot_ib01")))
    assert fits[0] > fits[1] - 0.5 and fits[2] > fits[3] - 0.5
    varying, invariant = (numbers(line)[0] for line in lines[-2:])
    assert varying > invariant - 1


@pytest.mark.parametrize("name", ["pendubot.py", "time_invariant.py"])
def test_absent_data_are_named(example, tmp_path, name):
    assert f"{tmp_path}" in example(name, status=1, data=tmp_path)
