# SPDX-License-Identifier: BSD-3-Clause
"""The tool under test is the executable named by the environment variable TOKID."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))


class Tool:
    """Runs the tool and checks its exit status."""

    def __init__(self, executable):
        self.executable = str(executable)

    def __call__(self, *arguments, status=0, **options):
        result = subprocess.run([self.executable, *map(str, arguments)], stdin=subprocess.DEVNULL,
                                capture_output=True, text=True, check=False, **options)
        assert result.returncode == status, f"{' '.join(map(str, arguments))}\n{result.stdout}{result.stderr}"
        return result

    def json(self, *arguments):
        """The JSON object that is all of stdout."""
        value = json.loads(self(*arguments, "--json").stdout)
        assert isinstance(value, dict)
        return value

    def arrays(self, path, tmp_path):
        """All data sets of a file of any format, read by NumPy."""
        if Path(path).suffix != ".npz":
            copy = tmp_path / f"{Path(path).name}.npz"
            self("convert", path, copy)
            path = copy
        with np.load(path) as file:
            return {name: file[name] for name in file.files}


@pytest.fixture(scope="session")
def tokid():
    executable = os.environ.get("TOKID")
    if not executable:
        pytest.fail("TOKID must hold the path of the executable to test")
    return Tool(Path(executable).resolve())


@pytest.fixture(scope="session")
def shared_data():
    """Measured data that is no part of the project."""
    return ROOT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def oscillator(tokid, tmp_path_factory):
    """The paper's system: 60 zero-state experiments of 40 steps without noise, a model of them, fresh experiments."""
    directory = tmp_path_factory.mktemp("oscillator")
    sizes = ["--steps", 40]
    tokid("example", "oscillator", "-o", directory / "data.npz", "--experiments", 60, *sizes)
    tokid("example", "oscillator", "-o", directory / "fresh.npz", "--experiments", 7, "--seed", 2, *sizes)
    tokid("identify", directory / "data.npz", "-o", directory / "model.npz")
    return directory
