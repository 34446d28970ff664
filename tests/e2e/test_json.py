# SPDX-License-Identifier: BSD-3-Clause
"""What --json promises: one object on stdout with these keys and types, and nothing else there."""

import json
from numbers import Real

import numpy as np
import pytest
from support import load


def per_output(value):
    return isinstance(value, list) and len(value) == 2 and all(v is None or isinstance(v, Real) for v in value)


def texts(value):
    return isinstance(value, list) and all(isinstance(v, str) for v in value)


def findings(value):
    keys = {"kind", "severity", "scope", "channels", "experiments", "steps", "numbers", "text"}
    return isinstance(value, list) and all(keys <= set(v) and v["severity"] in ("note", "warning") for v in value)


def real(value):
    return isinstance(value, Real) and not isinstance(value, bool)


def count(value):
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def probability(value):
    return value is None or 0 <= value <= 1


def one_of(*words):
    return lambda value: value in words


def check(found, contract):
    for key, holds in contract.items():
        assert key in found, f"{key} is missing"
        assert holds(found[key]), f"{key} = {found[key]!r}"


IDENTIFY = {
    "experiments": count, "steps": count, "inputs": count, "outputs": count, "states": count, "lags": count,
    "method": one_of("tvera"), "initial_state": one_of("zero", "unknown"), "k_begin": count, "min_experiments": count,
    "condition_max": real, "rank_deficient_steps": count, "seconds": real, "one_step_fit": per_output,
    "simulation_fit": per_output, "warnings": texts, "findings": findings, "evaluated_on": one_of("training", "held_out"),
    "nominal": lambda v: isinstance(v, bool), "frame": one_of("raw"), "dt": real, "missing_samples": count,
    "largest_lag_order": count, "output_names": texts, "held_out_experiments": count, "version": lambda v: v,
    "outliers": lambda v: v == [], "copies": lambda v: v == [],
}


def check_findings(found):
    """The sentences are those of the findings, in their order."""
    assert findings(found["findings"])
    assert [finding["text"] for finding in found["findings"]] == found["warnings"]
    return {finding["kind"]: finding for finding in found["findings"]}


def test_findings(tokid, tmp_path):
    rng = np.random.default_rng(5)
    u = rng.standard_normal((30, 40, 2))
    u[:, 10:13, 1] = 0
    y = np.zeros((30, 40, 1))
    for k in range(1, 40):
        y[:, k, 0] = 0.8 * y[:, k - 1, 0] + u[:, k - 1, 0] + 0.5 * u[:, k - 1, 1]
    y += 0.01 * rng.standard_normal(y.shape)
    u[7], y[7] = u[3], y[3]
    y[9, 20, 0] += 30
    np.savez(tmp_path / "data.npz", u=u, y=y, input_names=["force", "valve"], output_names=["speed"])
    found = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--initial-state", "zero")
    kinds = check_findings(found)
    assert {"sample_time_missing", "input_zero", "experiments_copied", "samples_outlying"} <= set(kinds)
    assert kinds["sample_time_missing"]["severity"] == "note" and kinds["sample_time_missing"]["numbers"] == {"dt": 1}
    resting = kinds["input_zero"]
    assert resting["channels"] == [{"side": "input", "index": 1, "name": "valve"}]
    assert resting["steps"] == [10, 11, 12] and resting["severity"] == "warning" and resting["scope"] == "all"
    copied = kinds["experiments_copied"]
    assert copied["experiments"] == [{"row": 7, "name": None}] and copied["groups"] == [[{"row": 3, "name": None}]]
    outlying = kinds["samples_outlying"]
    assert outlying["experiments"] == [{"row": 9, "name": None}] and outlying["steps"] == [20]
    assert outlying["channels"] == [{"side": "output", "index": 0, "name": "speed"}]
    assert outlying["numbers"]["error"] > 25

    for command in (["validate", tmp_path / "model.npz", tmp_path / "data.npz"], ["info", tmp_path / "data.npz"],
                    ["refine", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "refined.npz"],
                    ["confidence", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "bounds.npz"]):
        check_findings(tokid.json(*command))


def test_identify(tokid, tmp_path, oscillator):
    found = tokid.json("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz")
    check(found, IDENTIFY)
    model = load(tmp_path / "model.npz")
    data = load(oscillator / "data.npz")
    assert [found[key] for key in ("experiments", "steps", "inputs")] == list(data["u"].shape)
    assert found["outputs"] == data["y"].shape[2]
    assert found["states"] == 4 == model["state_dim"].max()
    assert found["lags"] == 2 == model["lags"].max()
    assert found["min_experiments"] == 2 + 2 * (2 + 2)
    assert found["largest_lag_order"] == (60 - 2) // 4
    assert found["k_begin"] == model["k_begin"] == 0
    assert found["condition_max"] == pytest.approx(model["condition"].max(), rel=1e-12)  # as many digits as printed
    regressors = 2 + 4 * model["lags"]
    assert found["rank_deficient_steps"] == np.count_nonzero(model["rank"] < regressors)
    assert found["initial_state"] == "zero"
    assert found["evaluated_on"] == "training"
    # Of the training data, the verdict is that of a report.
    verdict = tokid.json("report", tmp_path / "model.npz", oscillator / "data.npz", "-o", tmp_path / "page.html")
    assert found["verdict"] == {key: verdict[key] for key in ("trust", "summary", "reasons", "horizon", "checks")}
    assert found["no_verdict"] is None
    assert found["nominal"] is False
    assert found["missing_samples"] == 0
    assert found["dt"] == 0.05
    assert found["output_names"] == ["y1", "y2"]
    # Noise-free data: the smallest exact lag order is the best, and the singular values end with a cliff.
    assert found["lag_order_errors"]["best"] == 2
    assert found["lag_order_errors"]["candidates"][:3] == [1, 2, 3]
    errors = found["lag_order_errors"]["leave_one_out_error"]
    assert 0.01 < errors[0] < 1 and max(errors[1:]) < 1e-9
    assert found["order_scores"] is None  # the rank decides, not the errors
    assert found["singular_value_gap"] is None or found["singular_value_gap"] > 1e6
    assert found["nominal_test"]["significant"] is False
    assert found["initial_state_test"] == {"statistic": None, "threshold": None, "decision": "zero",
                                           "reason": "as the data say"}


def test_given_orders_are_not_tested(tokid, tmp_path, oscillator):
    found = tokid.json("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--lags", 3, "--nominal", "none")
    check(found, IDENTIFY)
    assert found["lags"] == 3
    assert found["lag_order_errors"] is None
    assert found["nominal_test"] is None


@pytest.mark.parametrize("options,why", [(["--no-refine"], "by cross-validation error"),
                                         (["--method", "tvera"], "by prediction errors")])
def test_states_of_noisy_data_are_tried(tokid, tmp_path, options, why):
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--steps", 30, "--measurement-noise", 0.2,
          "--experiments", 50)
    found = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", *options)
    scores = found["order_scores"]
    assert scores["best"] in scores["candidates"] and found["states"] == scores["best"]
    assert set(scores) == {"candidates", "best", "one_step_error", "5_step_error"}  # 20 steps are more than half
    for key in ("one_step_error", "5_step_error"):
        assert len(scores[key]) == len(scores["candidates"]) and min(scores[key]) > 0
    shown = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", *options).stdout
    assert f"n = {found['states']}, {why}" in shown


def test_validate(tokid, oscillator):
    found = tokid.json("validate", oscillator / "model.npz", oscillator / "fresh.npz", "--horizon", 3)
    check(found, {"simulation_fit": per_output, "one_step_fit": per_output, "horizon_fit": per_output,
                  "simulation_rmse": per_output, "one_step_rmse": per_output, "horizon_rmse": per_output,
                  "whiteness_p": probability, "independence_p": probability, "feedback_p": probability,
                  "nis_p": probability, "nis": lambda v: v is None or v > 0, "tested_over": one_of("nothing"),
                  "outlying_samples": lambda v: v == [], "gain_errors": lambda v: v == [None, None], "gain_deviations": lambda v: v == [None, None],
                  "conclusions": lambda v: {test: (c["result"], c["reason"]) for test, c in v.items()} == dict.fromkeys(
                      ["nis", "whiteness", "independence", "gains", "feedback"], ("untested", "rounding_level")),
                  "verdict": lambda v: v["trust"] == "good" and v["reasons"] == [] and v["horizon"] == 0 and {
                      c["name"]: (c["result"], c["untested"], c["conclusion"]) for c in v["checks"][-4:]} == dict.fromkeys(
                      ["whiteness", "independence", "gains", "nis"], (None, "innovations", "rounding_level")),
                  "nis_presumes_normal": lambda v: v is None, "cross_validation": lambda v: v is None, "horizon": lambda v: v == 3, "warnings": texts, "findings": findings,
                  "first_predicted": lambda v: v == 0, "output_names": lambda v: v == ["y1", "y2"],
                  # Errors at rounding level: 10 times their median is below 0.05.
                  "experiment_limits": lambda v: v == {"simulation": 0.05, "one_step": 0.05},
                  "worst_experiments_first": lambda v: len(v) == found["experiments"] and set(v[0]) == {
                      "experiment", "name", "simulation_fit", "one_step_fit", "simulation_rmse", "one_step_rmse",
                      "simulation_samples", "one_step_samples", "over_median", "simulation_error", "one_step_error",
                      "excess", "outlying", "worst_output"}})


def test_cross_validation(tokid, oscillator):
    found = tokid.json("validate", oscillator / "model.npz", oscillator / "data.npz", "--cross-validate", 4)
    cross = found["cross_validation"]
    check(cross, {"folds": lambda v: v == 4, "simulation_fit": per_output, "one_step_fit": per_output,
                  "horizon_fit": per_output, "simulation_fit_spread": per_output, "one_step_fit_spread": per_output,
                  "horizon_fit_spread": per_output, "simulation_rmse": per_output, "one_step_rmse": per_output,
                  "horizon_rmse": per_output})
    assert min(cross["simulation_fit"]) > 99.9999  # no noise
    assert [fold["experiments"] for fold in cross["per_fold"]] == [list(range(i, 60, 4)) for i in range(4)]
    for fold in cross["per_fold"]:
        check(fold, {"states": lambda v: v == 4, "lags": lambda v: v == 2, "simulation_fit": per_output,
                     "one_step_fit": per_output, "horizon_fit": per_output, "warnings": texts})


def test_horizon_of_one_is_the_one_step_prediction(tokid, oscillator):
    found = tokid.json("validate", oscillator / "model.npz", oscillator / "fresh.npz")
    assert found["horizon"] == 1
    assert found["horizon_fit"] == found["one_step_fit"]


def test_info_of_an_ensemble(tokid, tmp_path):
    rng = np.random.default_rng(7)
    u, y = rng.standard_normal((9, 12, 1)), 1e6 + rng.standard_normal((9, 12, 2))
    length = np.full(9, 12)
    length[4] = 10
    y[0, 3, 1] = y[1, 5, 1] = np.nan
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=0.25, length=length, free_y=rng.standard_normal((4, 6, 2)),
             input_names=["F"], input_units=["N"], output_names=["x", "v"], initial_state="unknown")
    found = tokid.json("info", tmp_path / "data.npz")
    check(found, {"kind": one_of("ensemble"), "experiments": lambda v: v == 9, "steps": lambda v: v == 12,
                  "inputs": lambda v: v == 1, "outputs": lambda v: v == 2, "dt": lambda v: v == 0.25,
                  "missing_samples": lambda v: v == 2, "initial_state": one_of("unknown"),
                  "length": lambda v: v == length.tolist(),
                  "free_responses": lambda v: v == {"experiments": 4, "steps": 6},
                  "largest_lag_order": lambda v: v == (9 - 1) // 3})
    assert [c["name"] for c in found["channels"]] == ["F", "x", "v"]
    assert [c["unit"] for c in found["channels"]] == ["N", "", ""]
    assert [c["kind"] for c in found["channels"]] == ["input", "output", "output"]
    assert [c["missing"] for c in found["channels"]] == [0, 0, 2]
    u[4, 10:] = y[4, 10:] = np.nan
    for channel, values in zip(found["channels"], [u[..., 0], y[..., 0], y[..., 1]]):
        assert channel["samples"] == np.count_nonzero(~np.isnan(values))
        assert channel["min"] == np.nanmin(values) and channel["max"] == np.nanmax(values)
        # A mean of 1e6 beside a spread of 1: rounding of the mean enters the spread at 1e-10.
        assert channel["mean"] == pytest.approx(np.nanmean(values), rel=1e-12, abs=1e-12)
        assert channel["std"] == pytest.approx(np.nanstd(values), rel=1e-9)


def test_info_of_an_ensemble_that_says_little(tokid, tmp_path):
    np.savez(tmp_path / "data.npz", u=np.ones((3, 4, 1)))
    found = tokid.json("info", tmp_path / "data.npz")
    assert found["outputs"] == 0
    assert found["length"] is None and found["initial_state"] is None
    assert found["free_responses"] == {"experiments": 0, "steps": 0}


def test_info_of_a_model(tokid, oscillator):
    found, model = tokid.json("info", oscillator / "model.npz"), load(oscillator / "model.npz")
    check(found, {"kind": one_of("model"), "method": one_of("tvera"), "frame": one_of("raw"), "states": lambda v: v == 4,
                  "inputs": lambda v: v == 2, "outputs": lambda v: v == 2, "steps": lambda v: v == 40,
                  "k_begin": lambda v: v == 0, "k_end": lambda v: v == 40, "dt": lambda v: v == 0.05,
                  "initial_state": one_of("zero"), "nominal": lambda v: v is False, "version": texts_or_text,
                  "input_names": lambda v: v == ["u1", "u2"], "output_names": lambda v: v == ["y1", "y2"],
                  "lags": lambda v: v == {"min": 0, "max": 2}})
    assert found["state_dim"] == {"min": int(model["state_dim"].min()), "max": 4}
    full = np.flatnonzero(model["state_dim"] == 4)
    assert (found["full_begin"], found["full_end"]) == (full[0], full[-1] + 1)
    assert found["condition_max"] == pytest.approx(model["condition"].max(), rel=1e-12)
    assert found["rank_deficient_steps"] == np.count_nonzero(model["rank"] < 2 + 4 * model["lags"])
    assert found["options"]["lags"] == "auto"
    closed = [A + G @ C for A, G, C in zip(model["A"], model["G"], model["C"])]
    norms = [np.linalg.norm(b @ a) for a, b in zip(closed, closed[1:])]
    # Products at rounding level have no digits that NumPy and the library share, but the same size.
    assert found["deadbeat_product_norm"] < 1e-9
    assert np.median(norms) < 1e-9


def texts_or_text(value):
    return isinstance(value, str) and value.count(".") == 2


def test_names_are_valid_text_whatever_they_hold(tokid, tmp_path):
    name = 'a "quoted"\nname\twith \\ and é'
    np.savez(tmp_path / "data.npz", u=np.ones((3, 4, 1)), y=np.ones((3, 4, 1)), output_names=[name])
    assert tokid.json("info", tmp_path / "data.npz")["channels"][1]["name"] == name
    # For people, every channel keeps to its line.
    lines = tokid("info", tmp_path / "data.npz").stdout.splitlines()
    assert any('a "quoted" name with \\ and é' in line for line in lines)


@pytest.mark.parametrize("command", [["identify", "data.npz", "-o", "model.npz"], ["info", "data.npz"]])
def test_failures_print_nothing_on_stdout(tokid, tmp_path, command):
    result = tokid(*command, "--json", status=2, cwd=tmp_path)
    assert result.stdout == ""


def test_not_a_number_is_null(tokid, tmp_path, oscillator):
    # Beyond the last step of the model nothing is predicted, and a fit of nothing is no number.
    data = load(oscillator / "fresh.npz")
    data["y"][:, :, 1] = np.nan
    data["y"][0, 0, 1] = 1.0  # a channel without a single sample would be refused
    np.savez(tmp_path / "data.npz", **data)
    text = tokid("validate", oscillator / "model.npz", tmp_path / "data.npz", "--horizon", 2, "--json").stdout
    assert "nan" not in text.lower() and "inf" not in text.lower()
    assert json.loads(text)["one_step_fit"][1] is None


def test_figures_of_regressions_that_were_given_up(tokid, tmp_path):
    """They are null, as docs/formats.md has it."""
    data = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 60, "--steps", 30, "--measurement-noise", 0.05)
    call = ["identify", data, "-o", tmp_path / "model.npz", "--no-refine"]
    given_up, kept = tokid.json(*call), tokid.json(*call, "--method", "tvera")
    assert given_up["smoothing_trials"] and not kept["smoothing_trials"]
    for key in ("condition_max", "rank_deficient_steps", "lag_order_errors"):
        assert given_up[key] is None and kept[key] is not None, key
    one = tokid.json(*call, "--time-invariant", "--lags", 3)
    assert one["condition_max"] is None and one["rank_deficient_steps"] is None
    assert "Regressions" not in tokid(*call, "--time-invariant", "--lags", 3, "--verbose").stdout
