# SPDX-License-Identifier: BSD-3-Clause
"""Twenty swing-ups of a real robot: a large mean motion, feedback, noise, and few experiments."""

import numpy as np
import pytest
from support import load

OUTPUTS = ["pos1", "pos2", "vel1", "vel2"]


@pytest.fixture(scope="module")
def pendubot(shared_data):
    path = shared_data / "pendubot" / "pendubot.npz"
    if not path.exists():
        pytest.skip(f"{path} is absent: the measured data are no part of the project")
    return path


def test_info(tokid, pendubot):
    found = tokid.json("info", pendubot)
    assert [found[key] for key in ("experiments", "steps", "inputs", "outputs", "dt")] == [20, 195, 2, 4, 0.02]
    assert found["largest_lag_order"] == 3
    assert [c["name"] for c in found["channels"]][2:] == OUTPUTS


def test_few_experiments_share_what_they_know(tokid, tmp_path, pendubot):
    found = tokid.json("identify", pendubot, "-o", tmp_path / "model.npz", "--hold-out", 0.3, "--no-refine")
    assert [found[key] for key in ("experiments", "method", "nominal")] == [14, "subspace", True]
    # 14 experiments less the one that the mean motion costs carry one lag; coupled over time they carry more.
    assert found["largest_lag_order"] == 1 < found["lags"]
    assert found["smoothing"] >= 1
    candidates = {(trial["lags"], trial["smoothing"]): trial["error"] for trial in found["smoothing_trials"]}
    assert candidates[found["lags"], found["smoothing"]] == min(candidates.values())


def test_tvera_says_what_twenty_experiments_can_carry(tokid, tmp_path, pendubot):
    result = tokid("identify", pendubot, "-o", tmp_path / "model.npz", "--method", "tvera", "--hold-out", 0.3,
                   "--feedthrough", "--verbose")
    # 14 experiments less the one that the mean motion costs: r + p (r + m) = 8, 14, ...
    assert "14 experiments permit lag orders up to p = 1" in result.stdout
    assert "the mean motion was removed" in result.stdout
    assert "on 6 experiments held out" in result.stdout
    assert "14 experiments are few" in result.stderr


def test_lag_orders_beyond_are_refused(tokid, tmp_path, pendubot):
    result = tokid("identify", pendubot, "-o", tmp_path / "model.npz", "--method", "tvera", "--lags", 4, status=2)
    assert str(pendubot) in result.stderr
    assert "20 found" in result.stderr and "lag orders up to" in result.stderr
    assert not (tmp_path / "model.npz").exists()


def test_identify_and_validate(tokid, tmp_path, pendubot):
    data = load(pendubot)
    held_out = np.arange(len(data["u"])) % 3 == 2
    for name, rows in (("training", ~held_out), ("fresh", held_out)):
        part = {key: value[rows] if key in ("u", "y") else value for key, value in data.items()}
        np.savez(tmp_path / f"{name}.npz", **part)
    # EM takes most of the time. Predictions of models with EM are tested in test_examples.py.
    found = tokid.json("identify", tmp_path / "training.npz", "-o", tmp_path / "model.npz", "--no-refine")
    assert found["nominal"] is True and found["initial_state"] == "unknown"
    assert load(tmp_path / "model.npz")["y_nominal"].shape == (195, 4)

    fresh = tokid.json("validate", tmp_path / "model.npz", tmp_path / "fresh.npz", "--horizon", 5)
    assert fresh["output_names"] == OUTPUTS
    # Positions are told from the last sample to a few percent (published baseline: 97 %); the velocities are noisy.
    assert min(fresh["one_step_fit"][:2]) > 90
    # Predictions get worse with the horizon, and so they are shown.
    assert np.all(np.array(fresh["horizon_fit"][:2]) < fresh["one_step_fit"][:2])
