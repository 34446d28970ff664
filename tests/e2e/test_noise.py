# SPDX-License-Identifier: BSD-3-Clause
"""identify on noisy data: what is chosen and told, single records, and the options that decide."""

import numpy as np
import pytest
from support import load, predict, rmse

T = 30
NOISE = ["--process-noise", 0.1, "--measurement-noise", 0.3]


@pytest.fixture(scope="module")
def noisy(tokid, tmp_path_factory):
    """25 experiments, half as many as a step has unknowns at lag order 12, and fresh ones."""
    directory = tmp_path_factory.mktemp("noisy")
    sizes = ["--steps", T, *NOISE]
    tokid("example", "oscillator", "-o", directory / "data.npz", "--experiments", 25, *sizes)
    tokid("example", "oscillator", "-o", directory / "fresh.npz", "--experiments", 200, "--seed", 2, *sizes)
    return directory


@pytest.fixture(scope="module")
def default(tokid, noisy):
    return tokid.json("identify", noisy / "data.npz", "-o", noisy / "model.npz")


def fresh_error(directory, model):
    fresh = load(directory / "fresh.npz")
    return rmse(fresh["y"], predict(load(model), fresh["u"], fresh["y"])).mean()


def test_what_was_chosen_is_told(noisy, default):
    assert default["method"] == "em"
    assert (default["k_begin"], default["k_end"]) == (0, T)
    trials = default["smoothing_trials"]
    least = min(trials, key=lambda trial: trial["error"])
    assert (least["lags"], least["smoothing"]) == (default["lags"], default["smoothing"])
    assert len({trial["lags"] for trial in trials}) > 1 and len({trial["smoothing"] for trial in trials}) > 1
    scores = default["order_scores"]
    assert scores["best"] in scores["candidates"] and scores["candidates"][0] == 1
    refinement = default["refinement"]
    assert default["states"] == refinement["states"]
    of_these = [trial for trial in refinement["trials"] if trial["states"] == refinement["states"] and trial["iterations"]]
    likeliest = max(of_these, key=lambda trial: trial["log_likelihood"])
    chosen = [trial for trial in of_these if all(trial[key] == refinement[key] for key in ("smoothing", "iterations"))]
    assert len(chosen) == 1 and chosen[0]["error"] <= likeliest["error"]
    assert refinement["trials"][0]["log_likelihood"] is None
    assert refinement["trials"][0]["iterations"] == 0
    model = load(noisy / "model.npz")
    assert np.isfinite(model["A"]).all() and model["A"].shape == (T, default["states"], default["states"])


def test_the_report_says_the_same(tokid, noisy, default, tmp_path):
    text = tokid("identify", noisy / "data.npz", "-o", tmp_path / "model.npz").stdout
    assert f"p = {default['lags']}, by cross-validation error" in text
    assert "over time, by cross-validation error" in text
    assert f"{default['refinement']['iterations']} iteration" in text
    assert (tmp_path / "model.npz").read_bytes() == (noisy / "model.npz").read_bytes()


def test_it_beats_the_method_of_the_paper(tokid, noisy, default, tmp_path):
    for name, options in (("plain", ["--no-refine"]), ("tvera", ["--method", "tvera"])):
        found = tokid.json("identify", noisy / "data.npz", "-o", tmp_path / f"{name}.npz", *options)
        assert found["refinement"] is None
        assert found["method"] == ("subspace" if name == "plain" else "tvera")
    errors = [fresh_error(noisy, path) for path in
              (noisy / "model.npz", tmp_path / "plain.npz", tmp_path / "tvera.npz")]
    assert errors[0] < errors[1] < errors[2]


@pytest.mark.parametrize("given,told", [("0", 0.0), ("0.3", 0.3), ("infinity", 0.0)])
def test_a_penalty_that_is_given(tokid, noisy, tmp_path, given, told):
    found = tokid.json("identify", noisy / "data.npz", "-o", tmp_path / "model.npz", "--smoothing", given,
                       "--no-refine", "--states", 4, "--lags", 4)
    assert found["smoothing"] == told
    model = load(tmp_path / "model.npz")
    invariant = given == "infinity"
    assert found["period"] == int(invariant)  # one model for all steps
    assert (np.ptp(model["A"], axis=0) == 0).all() == invariant


def test_refine_can_be_asked_for(tokid, noisy, default, tmp_path):
    found = tokid.json("identify", noisy / "data.npz", "-o", tmp_path / "model.npz", "--refine", "--smoothing", "auto")
    assert found["refinement"] == default["refinement"]


@pytest.mark.parametrize("option,period", [(["--time-invariant"], 1), (["--period", 3], 3)])
def test_a_single_record(tokid, tmp_path, option, period):
    rng = np.random.default_rng(3)
    steps, used = 500, 400
    u, y, x = rng.standard_normal((1, steps, 1)), np.empty((1, steps, 1)), np.zeros(2)
    phases = [np.array([[0.9, 0.3 + 0.1 * j], [-0.3, 0.8 - 0.1 * j]]) for j in range(period)]
    for k in range(steps):
        y[0, k] = x[0] + 0.05 * rng.standard_normal()
        x = phases[k % period] @ x + np.array([0.5, 1.0]) * u[0, k]
    np.savez(tmp_path / "first.npz", u=u[:, :used], y=y[:, :used], dt=0.1)
    np.savez(tmp_path / "all.npz", u=u, y=y, dt=0.1)
    found = tokid.json("identify", tmp_path / "first.npz", "-o", tmp_path / "model.npz", *option)
    assert (found["period"], found["experiments"]) == (period, 1)
    model = load(tmp_path / "model.npz")
    assert model["period"] == period
    np.testing.assert_array_equal(model["A"][period:], model["A"][:-period])
    # The model goes on behind the record that it was identified from.
    judged = tokid.json("validate", tmp_path / "model.npz", tmp_path / "all.npz")
    assert judged["one_step_fit"][0] > 90
    tokid("predict", tmp_path / "model.npz", tmp_path / "all.npz", "-o", tmp_path / "predicted.npz")
    predicted = load(tmp_path / "predicted.npz")["y"]
    assert np.isfinite(predicted[0, used:]).all()
    assert rmse(y[:, used:], predicted[:, used:])[0] < 0.1  # the noise alone is 0.05
    tokid("simulate", tmp_path / "model.npz", tmp_path / "all.npz", "-o", tmp_path / "simulated.npz")
    assert np.isfinite(load(tmp_path / "simulated.npz")["y"][0, used:]).all()


def test_the_end_of_a_single_record_held_out(tokid, tmp_path):
    rng = np.random.default_rng(4)
    u = rng.standard_normal((1, 300, 1))
    y = np.concatenate([np.zeros((1, 1, 1)), u[:, :-1]], axis=1) + 0.1 * rng.standard_normal(u.shape)
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=1.0)
    found = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--time-invariant",
                       "--hold-out", 0.2)
    assert (found["steps"], found["evaluated_on"]) == (240, "held_out")
    assert found["one_step_fit"][0] == pytest.approx(90, abs=2)  # noise of a tenth of the outputs


def test_simulation_from_an_estimated_state(tokid, tmp_path):
    for name, seed in (("data", 1), ("fresh", 2)):
        tokid("example", "oscillator", "-o", tmp_path / f"{name}.npz", "--experiments", 40, "--steps", 40, "--seed", seed,
              "--measurement-noise", 0.05, "--initial-state", "unknown")
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--no-refine", "--states", 4, "--lags", 4)
    y = load(tmp_path / "fresh.npz")["y"]
    errors = []
    for options in ([], ["--estimate-state"]):
        result = tokid("simulate", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "out.npz", *options)
        assert ("unknown" in result.stderr) == (not options)
        simulated = load(tmp_path / "out.npz")["y"]
        errors.append(np.sqrt(np.nanmean((simulated - y) ** 2)))
    assert errors[1] < 0.3 * errors[0]
