# SPDX-License-Identifier: BSD-3-Clause
"""One table of options: the tool, the package and MATLAB know the same ones, with the same values."""

import inspect
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import tokid
from tokid import _tokid
from tokid._identify_options import IdentifyOptions, checked

TABLE = {key: (range_, words) for key, range_, words in _tokid.option_table()}
ROOT = Path(__file__).resolve().parents[2]
NUMBERS = [-1, 0, 1, 2, 7, 0.5, 0.999, 1.0, 1_000_000, 1_000_001, 1_000_000_000, 1_000_000_001, 10**30, -0.1, 1e300]


def test_signatures_and_lists():
    assert len(TABLE) >= 14
    assert set(IdentifyOptions.__annotations__) - {"choices"} == set(TABLE)
    parameters = inspect.signature(tokid.identify).parameters
    assert list(TABLE) == [name for name in parameters if name in TABLE]
    documented = re.findall(r"^    ([a-z_, ]+) : ", inspect.getdoc(tokid.identify).replace("\n", "\n    "), re.MULTILINE)
    assert set(TABLE) <= {name for names in documented for name in names.split(", ")}


def test_matlab():
    text = (ROOT / "matlab/+tokid/identify.m").read_text()
    known = set(re.findall(r"\w+", re.search(r"^options = \[(.*?)\];", text, re.DOTALL | re.MULTILINE)[1]))
    assert set(TABLE) <= known
    assert all(f"'{key}'" in text.split("% SPDX")[0] for key in TABLE)


def test_lists_and_numbers_may_be_of_numpy():
    for value in [3, 20], (3, 20), np.array([3, 20]), np.array([3]), np.array(3):
        checked({"jumps": value})
    checked({"states": np.array(2), "smoothing": np.array(0.5), "hold_out": np.float32(0.5)})
    for value in [1, 10], (1.0, 10.0), np.array([1, 10]), np.array([1.0, 10.0]):
        checked({"output_weights": value})
    with pytest.raises(ValueError, match="jumps: array"):
        checked({"jumps": np.array([20, 3])})


@pytest.mark.parametrize("key", [key for key, (_, words) in TABLE.items() if "yes" not in words])
def test_tool_and_package_take_the_same_values(key, tmp_path):
    """The tool refuses a wrong value with the name of the option, before it looks for the data, which are not there."""
    words = {word for _, words in TABLE.values() for word in words} | {"nan", "all", "1e400"}
    for value in [*NUMBERS, *sorted(words)]:
        try:
            checked({key: value, **({"frame": "reference"} if key == "reference_step" else {})})
            taken = True
        except ValueError as error:
            assert str(error).startswith(f"{key}: {value!r} found, ")
            taken = False
        option = "--" + key.replace("_", "-")
        extra = ["--frame", "reference"] if key == "reference_step" else []
        call = [os.environ["TOKID"], "identify", "none.npz", "-o", "m.npz", f"{option}={value}", *extra]
        complaint = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True).stderr
        assert ("none.npz" in complaint) == taken, (value, complaint)
        assert (option in complaint) != taken, (value, complaint)


@pytest.mark.parametrize("key", [key for key, (_, words) in TABLE.items() if "yes" in words])
def test_switches(key, tmp_path):
    """The package takes True and False, the tool --key and --no-key, and both refuse a value beside."""
    for value in (True, False):
        checked({key: value})
    automatic = "auto" in TABLE[key][1]
    needed = "one of True, False, None, 'auto' needed" if automatic else "True or False needed"
    for value in [0, 1, "maybe", *([] if automatic else ["auto"])]:
        with pytest.raises(ValueError, match=f"{key}: .* found, {needed}"):
            checked({key: value})
    for option, taken in ((f"--{key}", True), (f"--no-{key}", True), (f"--{key}=no", False), (f"--{key}=1", False)):
        call = [os.environ["TOKID"], "identify", "none.npz", "-o", "m.npz", option]
        complaint = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True).stderr
        assert ("none.npz" in complaint) == taken, (option, complaint)
        assert ("takes no value" in complaint) != taken, (option, complaint)
