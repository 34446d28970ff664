# SPDX-License-Identifier: BSD-3-Clause
"""Counts of experiments are those that are used. Odd lengths, empty experiments and channels that are equal in all
experiments are named, by `info` as by `identify`."""

import numpy as np
import pytest

from support import load

QUICK = ["--lags", 3, "--states", 2, "--no-refine"]


def experiments(count, steps, seed=1, noise=0.1, mean=0.0):
    """Second order, with a stiffness that varies over time."""
    rng = np.random.default_rng(seed)
    u, y, x = rng.standard_normal((count, steps, 1)), np.zeros((count, steps, 1)), np.zeros((count, 2))
    for k in range(steps):
        y[:, k, 0] = x @ [1.0, 0.5] + mean * np.sin(k / 5)
        a = 1.2 + 0.2 * np.sin(2 * np.pi * k / 40)
        x = np.stack([a * x[:, 0] - 0.7 * x[:, 1] + u[:, k, 0], x[:, 0]], 1)
    return u, y + noise * rng.standard_normal(y.shape)


def write(path, u, y, **more):
    np.savez(path, u=u, y=y, **{"dt": 0.1, "initial_state": "zero", **more})
    return path


def between(values, begins, ends):
    """The samples from begin to end of each experiment; NaN elsewhere."""
    values = values.copy()
    for n, (begin, end) in enumerate(zip(begins, ends)):
        values[n, :begin] = values[n, end:] = np.nan
    return values


def kinds(found):
    return {finding["kind"]: finding for finding in found["findings"]}


def rows(finding):
    return [experiment["row"] for experiment in finding["experiments"]]


# Counts

def test_held_out_experiments_are_counted_without_copies(tokid, tmp_path):
    u, y = experiments(20, 30)
    path = write(tmp_path / "data.npz", *(np.concatenate([v, v[:5]]) for v in (u, y)))
    command = ["identify", path, "-o", tmp_path / "model.npz", *QUICK, "--hold-out", 0.2]
    found = tokid.json(*command)
    assert (found["experiments"], found["held_out_experiments"]) == (16, 4)
    assert "on 4 held-out experiments" in found["verdict"]["summary"]
    assert "on 4 experiments held out" in tokid(*command).stdout


@pytest.mark.parametrize("command", ["identify", "confidence", "cross-validate"])
def test_errors_tell_of_copies(tokid, tmp_path, command):
    u, y = experiments(20, 30)
    whole = write(tmp_path / "whole.npz", u, y)
    tokid("identify", whole, "-o", tmp_path / "model.npz", *QUICK)
    equal = write(tmp_path / "equal.npz", *(np.repeat(v[:1], 40, axis=0) for v in (u, y)))
    arguments = {"identify": ["identify", equal, "-o", tmp_path / "other.npz"],
                 "confidence": ["confidence", tmp_path / "model.npz", equal, "-o", tmp_path / "bounds.npz"],
                 "cross-validate": ["validate", tmp_path / "model.npz", equal, "--cross-validate", 2]}[command]
    told = tokid(*arguments, status=2).stderr
    assert "experiments: 1 found" in told and "39 of 40" in told


def test_info_counts_used_experiments(tokid, tmp_path):
    u, y = experiments(9, 30)
    once = tokid.json("info", write(tmp_path / "once.npz", u, y))
    u, y = (np.concatenate([v, v[:5], np.full((2, *v.shape[1:]), np.nan)]) for v in (u, y))
    found = tokid.json("info", write(tmp_path / "more.npz", u, y))
    assert found["experiments"] == 16 and found["largest_lag_order"] == once["largest_lag_order"]
    assert rows(kinds(found)["experiments_copied"]) == [9, 10, 11, 12, 13]
    assert rows(kinds(found)["experiments_empty"]) == [14, 15]


def test_empty_experiments_are_not_used(tokid, tmp_path):
    u, y = experiments(20, 30)
    without = tokid.json("identify", write(tmp_path / "a.npz", u, y), "-o", tmp_path / "without.npz", *QUICK,
                         "--hold-out", 0.25)
    u, y = (np.insert(v, [0, 7, 7], np.nan, axis=0) for v in (u, y))
    found = tokid.json("identify", write(tmp_path / "b.npz", u, y), "-o", tmp_path / "model.npz", *QUICK,
                       "--hold-out", 0.25)
    assert rows(kinds(found)["experiments_empty"]) == [0, 8, 9]
    for name in ("experiments", "held_out_experiments", "simulation_fit"):
        assert found[name] == without[name]
    assert np.array_equal(load(tmp_path / "model.npz")["A"], load(tmp_path / "without.npz")["A"])


# Lengths

@pytest.mark.parametrize("mean", [0.0, 3.0])
@pytest.mark.parametrize("steps", [60, 700])
def test_the_model_ends_where_one_experiment_goes_on(tokid, tmp_path, mean, steps):
    u, y = experiments(13, steps, mean=mean)
    ends = [25] * 13
    ends[4] = steps
    path = write(tmp_path / "data.npz", *(between(v, [0] * 13, ends) for v in (u, y)),
                 experiment_names=[f"run{n + 1}" for n in range(13)])
    told = kinds(tokid.json("info", path))["late_steps_of_few"]
    assert told["experiments"] == [{"row": 4, "name": "run5"}] and told["numbers"]["needed"] == 2
    assert (told["steps"][0], told["steps"][-1]) == (25, steps - 1) or told["steps"] == [[25, steps - 1]]
    found = tokid.json("identify", path, "-o", tmp_path / "model.npz", "--report", tmp_path / "page.html", *QUICK)
    assert kinds(found)["late_steps_of_few"] == told and "input_same" not in kinds(found)
    assert found["steps"] == 25
    assert (tmp_path / "page.html").exists()
    cut = write(tmp_path / "cut.npz", u[:, :25], y[:, :25])
    expected = tokid.json("identify", cut, "-o", tmp_path / "cut_model.npz", *QUICK)
    assert found["simulation_fit"] == expected["simulation_fit"]
    assert found["verdict"]["trust"] == expected["verdict"]["trust"]
    model, other = load(tmp_path / "model.npz"), load(tmp_path / "cut_model.npz")
    for name in "ABCDG":
        assert np.array_equal(model[name], other[name])
    # The data are known as those of the identification.
    judged = tokid.json("validate", tmp_path / "model.npz", path)
    assert "model_ends_early" in kinds(judged)
    bounds = [tokid.json("confidence", tmp_path / f"{name}.npz", data, "-o", tmp_path / "b.npz", "--replicates", 4)
              for name, data in (("model", path), ("cut_model", cut))]
    assert bounds[0]["experiments"] == bounds[1]["experiments"] == 13
    assert "bounds_of_other_data" not in kinds(bounds[0])


def test_one_model_for_all_steps_uses_the_long_experiment(tokid, tmp_path):
    u, y = experiments(12, 200)
    path = write(tmp_path / "data.npz", *(between(v, [0] * 12, [25] * 11 + [200]) for v in (u, y)))
    found = tokid.json("identify", path, "-o", tmp_path / "model.npz", *QUICK, "--time-invariant")
    assert found["steps"] == 200 and "late_steps_of_few" not in kinds(found)


def test_few_long_experiments_of_which_one_remains(tokid, tmp_path):
    """Of the two long experiments, one is held out."""
    u, y = experiments(20, 80)
    path = write(tmp_path / "data.npz", *(between(v, [0] * 20, [80 if n in (0, 4) else 25 for n in range(20)])
                                          for v in (u, y)))
    assert "late_steps_of_few" not in kinds(tokid.json("info", path))
    whole = tokid.json("identify", path, "-o", tmp_path / "whole.npz", *QUICK)
    assert whole["steps"] == 80 and "late_steps_of_few" not in kinds(whole)
    part = tokid.json("identify", path, "-o", tmp_path / "part.npz", *QUICK, "--hold-out", 0.2)
    assert (part["steps"], part["held_out_experiments"]) == (25, 4) and "late_steps_of_few" in kinds(part)


def test_regressions_of_single_steps_end_where_too_few_remain(tokid, tmp_path):
    u, y = experiments(20, 60, noise=0.0)
    path = write(tmp_path / "data.npz", *(between(v, [0] * 20, [30] * 16 + [60] * 4) for v in (u, y)))
    found = tokid.json("identify", path, "-o", tmp_path / "model.npz", "--lags", 2, "--method", "tvera")
    told = kinds(found)["late_steps_of_few"]
    assert rows(told) == [16, 17, 18, 19] and told["numbers"]["needed"] == found["min_experiments"] == 5
    assert found["steps"] == 30 and "too_few_complete" not in kinds(found) and found["simulation_fit"][0] > 99.99


def test_an_experiment_that_begins_before_the_others_is_named(tokid, tmp_path):
    u, y = experiments(20, 60)
    path = write(tmp_path / "data.npz", *(between(v, [25] * 3 + [0] + [25] * 16, [60] * 20) for v in (u, y)))
    for found in (tokid.json("info", path), tokid.json("identify", path, "-o", tmp_path / "model.npz", *QUICK)):
        assert rows(kinds(found)["early_steps_of_few"]) == [3] and "input_same" not in kinds(found)


def test_an_experiment_that_begins_late_is_fine(tokid, tmp_path):
    u, y = experiments(20, 60)
    path = write(tmp_path / "data.npz", *(between(v, [0] * 19 + [25], [60] * 20) for v in (u, y)))
    for found in (tokid.json("info", path), tokid.json("identify", path, "-o", tmp_path / "model.npz", *QUICK)):
        assert not {"early_steps_of_few", "late_steps_of_few"} & set(kinds(found))


def test_samples_after_the_end_are_not_missing(tokid, tmp_path):
    u, y = experiments(12, 60)
    ends = [40 + n for n in range(11)] + [60]
    ends[10] = 60
    u, y = (between(v, [0] * 12, ends) for v in (u, y))
    y[2, 7] = np.nan
    path = write(tmp_path / "data.npz", u, y)
    info = tokid.json("info", path)
    assert info["missing_samples"] == 1 and [c["missing"] for c in info["channels"]] == [0, 1]
    found = tokid.json("identify", path, "-o", tmp_path / "model.npz", *QUICK)
    assert found["missing_samples"] == 1
    share, = next(c for c in found["verdict"]["checks"] if c["name"] == "missing")["figures"]
    assert share["values"] == [pytest.approx(1 / (2 * sum(ends)))]


@pytest.mark.parametrize("steps", [30, 50, 80])
def test_one_model_for_all_steps_is_tested_by_records_of_any_length(tokid, tmp_path, steps):
    def invariant(count, length, seed):
        rng = np.random.default_rng(seed)
        u, y, x = rng.standard_normal((count, length, 1)), np.zeros((count, length, 1)), np.zeros((count, 2))
        for k in range(length):
            y[:, k, 0] = x @ [1.0, 0.5]
            x = np.stack([1.5 * x[:, 0] - 0.7 * x[:, 1] + u[:, k, 0], x[:, 0]], 1)
        return u, y + 0.3 * rng.standard_normal(y.shape)
    tokid("identify", write(tmp_path / "data.npz", *invariant(20, 60, 1)), "-o", tmp_path / "model.npz", *QUICK,
          "--time-invariant")
    path = write(tmp_path / "other.npz", *invariant(20, steps, 2))
    verdict = tokid.json("validate", tmp_path / "model.npz", path)["verdict"]
    coverage = next(c for c in verdict["checks"] if c["name"] == "coverage")
    assert coverage["numbers"] == {"tested": 60, "steps": 60} and coverage["result"] == "good"


# Channels

@pytest.mark.parametrize("rounding", [0.0, 1e-15])
def test_inputs_that_are_equal_in_all_experiments_are_named(tokid, tmp_path, rounding):
    u, y = experiments(12, 30)
    u = np.repeat(u[:1], 12, axis=0) * (1 + rounding * np.random.default_rng(2).standard_normal(u.shape))
    path = write(tmp_path / "data.npz", u, y)
    for found in (tokid.json("info", path), tokid.json("identify", path, "-o", tmp_path / "model.npz", *QUICK)):
        told = kinds(found)["input_same"]
        assert [c["name"] for c in told["channels"]] == ["u1"] and "experiments" not in told["numbers"]
    assert "e-1" not in tokid("info", path).stdout  # no spread of rounding errors


def test_info_names_constant_channels(tokid, tmp_path):
    u, y = experiments(12, 30)
    path = write(tmp_path / "data.npz", np.concatenate([u, 0 * u], axis=2), np.concatenate([y, 0 * y + 0.1], axis=2))
    found = tokid.json("info", path)
    assert {"input_zero", "output_constant"} <= set(kinds(found))
    assert found["channels"][3]["std"] == 0.0
