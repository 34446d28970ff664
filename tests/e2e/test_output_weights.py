# SPDX-License-Identifier: BSD-3-Clause
"""identify --output-weights: a small model serves the output that matters, on every route, and keeps the weights."""

import json

import h5py
import numpy as np
import plants
import pytest

from support import load, simulate

NOISE = 0.05
SMALL = ["--states", 2, "--lags", 6, "--smoothing", 1, "--no-refine"]


def two_oscillators(steps):
    """Each output sees one of two oscillators with the same inputs."""
    slow, fast = (plants.discrete(np.array([[0, 1], [-w * w, -0.4]]), np.array(b), 0.1)
                  for w, b in ((1.5, [[1.0, 0.2], [0.5, 1.0]]), (4.0, [[2.0, 1.0], [1.0, -3.0]])))
    A, B, C = np.zeros((4, 4)), np.vstack([slow[1], fast[1]]), np.zeros((2, 4))
    A[:2, :2], A[2:, 2:], C[0, 0], C[1, 2] = slow[0], fast[0], 1, 1
    return plants.Plant(*(np.repeat(x[None], steps, 0) for x in (A, B, C, np.zeros((2, 2)))))


def write(path, count, seed, steps=60, noise=NOISE):
    plant = two_oscillators(steps)
    u, y, _ = plants.experiments(plant, count, seed, *plants.noise(plant, noise, 0))
    if path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["u"], file["y"], file["dt"], file["initial_state"] = u, y, 0.1, "zero"
    else:
        np.savez(path, u=u, y=y, dt=0.1, initial_state="zero")
    return path


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write(tmp_path_factory.mktemp("weights") / "data.npz", 40, 1)


def errors(path):
    """Of a simulation of fresh experiments without noise, over the RMS of each output."""
    u, y, _ = plants.experiments(two_oscillators(60), 50, 2)
    with (np.load if path.suffix == ".npz" else h5py.File)(path) as file:
        model = {name: file[name][()] for name in ("A", "B", "C", "D", "k_begin")}
    found = simulate(model, u)
    return np.sqrt(((found - y) ** 2).mean((0, 1)) / (y ** 2).mean((0, 1)))


def options_of(path):
    return json.loads(str(load(path)["options"]))


@pytest.mark.parametrize("weights", [[1000, 1], [1, 1000]])
@pytest.mark.parametrize("options", [["--states", 2], SMALL, ["--states", 2, "--method", "tvera"]])
def test_a_small_model_serves_the_output_that_matters(tokid, data, tmp_path, options, weights):
    if "tvera" in options:
        data = write(tmp_path / "exact.npz", 40, 1, noise=0)
    report = tokid.json("identify", data, "-o", tmp_path / "model.npz", *options,
                        "--output-weights", ",".join(map(str, weights)))
    assert report["output_weights"] == weights
    assert options_of(tmp_path / "model.npz")["output_weights"] == weights
    heavy = weights.index(1000)
    found = errors(tmp_path / "model.npz")
    assert found[heavy] < 0.1 and found[1 - heavy] > 5 * found[heavy]


def test_without_weights_a_small_model_serves_no_output(tokid, data, tmp_path):
    tokid("identify", data, "-o", tmp_path / "model.npz", *SMALL)
    assert min(errors(tmp_path / "model.npz")) > 0.3


def test_the_report_names_them(tokid, data, tmp_path):
    text = tokid("identify", data, "-o", tmp_path / "model.npz", *SMALL, "--output-weights", "2.5,0").stdout
    assert "Weights        2.5 for y1, 0 for y2, as asked" in text
    assert tokid.json("identify", data, "-o", tmp_path / "model.npz", *SMALL)["output_weights"] is None


def test_updates_keep_them(tokid, data, tmp_path):
    tokid("identify", data, "-o", tmp_path / "model.npz", *SMALL, "--output-weights", "1,1000", "--state", tmp_path / "s.h5")
    tokid("update", tmp_path / "s.h5", write(tmp_path / "later.npz", 20, 3), "-o", tmp_path / "updated.npz")
    assert options_of(tmp_path / "updated.npz")["output_weights"] == [1, 1000]
    found = errors(tmp_path / "updated.npz")
    assert found[1] < 0.1 and found[0] > 3 * found[1]


def test_a_damaged_state_is_refused(tokid, data, tmp_path):
    state = tmp_path / "state.npz"
    tokid("identify", data, "-o", tmp_path / "model.npz", *SMALL, "--output-weights", "1,1000", "--state", state)
    arrays = load(state)
    arrays["options"] = np.array(str(arrays["options"]).replace("[1.0,1000.0]", "[1.0,1000.0,1.0]"))
    np.savez(state, **arrays)
    answer = tokid("update", state, write(tmp_path / "later.npz", 20, 3), status=2)
    assert "data set 'options': 3 output_weights found, 2 needed, one for each output" in answer.stderr


def test_blocks_keep_them(tokid, tmp_path):
    data = write(tmp_path / "data.h5", 40, 1, steps=900)
    tokid("identify", data, "-o", tmp_path / "model.h5", "--block", 400, *SMALL, "--output-weights", "1,1000")
    found = errors(tmp_path / "model.h5")
    assert found[1] < 0.1 and found[0] > 3 * found[1]


def test_later_commands_keep_them(tokid, data, tmp_path):
    """EM from the model, and the replicates of its bounds."""
    model = tmp_path / "model.npz"
    tokid("identify", data, "-o", model, *SMALL, "--output-weights", "1,1000")
    tokid("refine", model, data, "-o", tmp_path / "refined.npz", "--iterations", 3)
    assert options_of(tmp_path / "refined.npz")["output_weights"] == [1, 1000]
    told = tokid.json("confidence", model, data, "-o", tmp_path / "bounds.npz", "--replicates", 10)
    assert not [text for text in told["warnings"] if "other model" in text]


@pytest.mark.parametrize("weights, complaint", [
    ("1,-1", "--output-weights: '1,-1' found, a number from 0 on for each output (not all 0) or equal needed"),
    ("0,0", "--output-weights: '0,0' found, a number from 0 on for each output (not all 0) or equal needed"),
    ("1,nan", "--output-weights: '1,nan' found, a number from 0 on"),
    ("1,2,3", "output_weights: 3 found, 2 needed, one for each output"),
])
def test_wrong_weights_are_refused(tokid, data, tmp_path, weights, complaint):
    answer = tokid("identify", data, "-o", tmp_path / "model.npz", f"--output-weights={weights}", status=2)
    assert complaint in answer.stderr
