# SPDX-License-Identifier: BSD-3-Clause
"""plan: the numbers of experiments with their reasons, inputs within limits, experiments on them, the model."""

import re

import numpy as np
import pytest
from support import load, simulate

SIZES = ["--states", 4, "--inputs", 2, "--outputs", 2]
KINDS = ["gaussian", "binary", "multisine", "orthogonal"]


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat", ".csv"])
def test_planned_experiments_give_the_system_back(tokid, tmp_path, oscillator, extension):
    """The plan is carried out on the true system; the model from it predicts experiments that it has not seen."""
    planned = tmp_path / f"inputs{extension}"
    tokid("plan", *SIZES, "--steps", 40, "--experiments", 12, "--dt", 0.05, "-o", planned)
    tokid("simulate", oscillator / "model.npz", planned, "-o", tmp_path / "data.npz")
    result = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--lags", 2)
    assert result["states"] == 4
    assert result["initial_state"] == "zero"
    fresh = load(oscillator / "fresh.npz")
    # Rounding times a condition of at most a few thousand, over 40 steps.
    assert np.abs(simulate(load(tmp_path / "model.npz"), fresh["u"]) - fresh["y"]).max() < 1e-8


def test_examples_take_the_inputs_of_a_plan(tokid, tmp_path):
    inputs, planned = tmp_path / "inputs.npz", tmp_path / "data.npz"
    tokid("plan", *SIZES, "--steps", 30, "-o", inputs)
    tokid("example", "oscillator", "--inputs", inputs, "-o", planned, "--measurement-noise", 0.1)
    assert np.array_equal(load(planned)["u"], load(inputs)["u"])
    assert "--steps" in tokid("example", "oscillator", "--inputs", inputs, "--steps", 30, "-o", planned, status=2).stderr
    refused = tokid("example", "rotating-tube", "--inputs", inputs, "-o", planned, status=2).stderr
    assert "inputs.npz" in refused and "2 inputs" in refused


def test_the_file_holds_inputs_alone(tokid, tmp_path):
    tokid("plan", *SIZES, "--steps", 30, "-o", tmp_path / "inputs.npz", "--dt", 0.1, "--initial-state", "unknown")
    planned = load(tmp_path / "inputs.npz")
    assert planned["u"].shape == (15, 30, 2)
    assert "y" not in planned or planned["y"].shape == (15, 30, 0)
    assert float(planned["dt"]) == 0.1
    assert str(planned["initial_state"]) == "unknown"


@pytest.mark.parametrize("kind", KINDS)
def test_limits_hold_for_each_input(tokid, tmp_path, kind):
    def plan(seed):
        result = tokid.json("plan", *SIZES, "--steps", 50, "--experiments", 13, "--kind", kind, "--amplitude", "0.2,3",
                            "--seed", seed, "-o", tmp_path / "inputs.npz")
        return result, load(tmp_path / "inputs.npz")["u"]

    (result, u), (_, again), (_, other) = plan(1), plan(1), plan(2)
    assert result["kind"] == kind
    assert (np.abs(u) <= [0.2, 3]).all()
    np.testing.assert_array_equal(np.abs(u).max(axis=(0, 1)), result["peak"])
    np.testing.assert_allclose(np.sqrt((u**2).mean(axis=(0, 1))), result["rms"], rtol=1e-12)
    np.testing.assert_array_equal(u, again)
    assert not np.array_equal(u, other)
    if kind == "binary":
        np.testing.assert_array_equal(np.abs(u), np.broadcast_to([0.2, 3], u.shape))
    if kind == "orthogonal":
        for k in range(2, 50):
            window = u[:, k - 2:k + 1].reshape(13, -1) / ([0.2, 3] * 3)
            gram = window.T @ window
            # Columns of 13 entries up to 1: rounding of sums of a dozen products.
            np.testing.assert_allclose(gram, np.diag(np.diag(gram)), rtol=0, atol=1e-13)


def worst_condition(model, u):
    """The largest condition number of the windows of 2 lags, from the step on where the inputs have moved all states."""
    v = np.concatenate([u, simulate(model, u)], axis=2)
    windows = [np.concatenate([v[:, k - 2:k].reshape(len(u), -1), u[:, k]], axis=1) for k in range(4, u.shape[1])]
    return max(np.linalg.cond(w) for w in windows)


def test_a_preliminary_model_is_made_use_of(tokid, tmp_path, oscillator):
    model = load(oscillator / "model.npz")
    plain = tokid.json("plan", *SIZES, "--steps", 40, "--experiments", 10, "-o", tmp_path / "plain.npz")
    result = tokid.json("plan", "--model", oscillator / "model.npz", "--experiments", 10, "-o", tmp_path / "inputs.npz")
    assert result["kind"] == "optimised"
    assert (result["states"], result["inputs"], result["outputs"], result["steps"]) == (4, 2, 2, 40)
    assert "condition" not in plain
    assert result["condition"]["largest"] == max(c for c in result["condition"]["per_step"])
    assert result["condition"]["largest"] < result["start_condition"] / 2
    u = load(tmp_path / "inputs.npz")["u"]
    gaussian = np.median([worst_condition(model, np.random.default_rng(s).standard_normal((10, 40, 2)))
                          for s in range(40)])
    # On 40 steps Gaussian inputs reach 1.2e4 in the median, the optimised ones stay near 150.
    assert worst_condition(model, u) < gaussian / 20
    np.testing.assert_allclose(np.abs(simulate(model, u)).max(axis=(0, 1)), result["output_peak"], rtol=1e-9)


def test_numbers_for_people(tokid, tmp_path, oscillator):
    shown = tokid("plan", *SIZES, "--steps", 80, "--noise", "0:0.1", "-o", tmp_path / "inputs.npz",
                  "--verbose").stdout
    for text in ("minimum 10, recommended 111", "2 + 2·4 = 10", "coefficients add 10 % to the mean square", "not known without a model of the system",
                 str(tmp_path / "inputs.npz")):
        assert text in shown if text.startswith("/") else text in " ".join(shown.split())
    shown = tokid("plan", "--model", oscillator / "model.npz", "--noise", "0.01:0.1", "--experiments", 60, "-o",
                  tmp_path / "inputs.npz").stdout
    assert re.search(r"best one-step error: \d.* % of the outputs; error of the Markov parameters: \d.* %", shown)
    result = tokid("plan", *SIZES, "--steps", 80, "--experiments", 10, "-o", tmp_path / "inputs.npz")
    assert "no degree of freedom" in result.stderr
    shown = tokid("plan", *SIZES, "--steps", 80, "--noise", "0:0", "-o", tmp_path / "inputs.npz").stdout
    assert re.search(r"\nNoise +none", shown)
    assert "recommended 15" in shown
    assert "estimated coefficients" not in shown


def test_noise_beyond_reach(tokid, tmp_path, oscillator):
    """A stated number of experiments is drawn whatever the noise asks for; an automatic one has its limits."""
    arguments = ["plan", "--model", oscillator / "model.npz", "--noise", "0:1e6", "-o", tmp_path / "inputs.npz"]
    result = tokid(*arguments, status=2)
    needed = re.fullmatch(r"tokid: experiments: (\d+) recommended, but a plan .*\(--experiments\), at least 10\n",
                          result.stderr)
    assert needed
    assert list(tmp_path.iterdir()) == []
    drawn = tokid.json(*arguments, "--experiments", 100)
    assert (drawn["experiments"], drawn["recommended"]) == (100, int(needed.group(1)))
    assert any(f"{drawn['recommended']} are recommended" in text for text in drawn["warnings"])


@pytest.mark.parametrize("alike", [1e-9, 1e-12, 5e-13])
def test_the_step_of_the_largest_condition_is_that(tokid, tmp_path, alike):
    """However large it is: two outputs that are next to the same, whose rounding errors are of the size of 1."""
    steps = 20
    matrices = {"A": [[0.9, 0.1], [0, 0.8]], "B": [[1], [0.5]], "C": [[1, 0], [1, alike]], "D": [[0], [0]],
                "G": np.zeros((2, 2))}
    np.savez(tmp_path / "model.npz", dt=0.1, state_dim=np.full(steps + 1, 2),
             **{name: np.tile(np.array(value, float), (steps, 1, 1)) for name, value in matrices.items()})
    condition = tokid.json("plan", "--model", tmp_path / "model.npz", "-o", tmp_path / "u.npz", "--experiments",
                           40)["condition"]
    assert condition["largest"] > 1e9
    assert condition["per_step"][condition["step"]] > 0.5 * condition["largest"]


def test_initial_states_are_those_of_the_model(tokid, tmp_path):
    """A model from unknown initial states begins late, and plans experiments from unknown states."""
    tokid("example", "oscillator", "--steps", 40, "--initial-state", "unknown", "-o", tmp_path / "data.npz")
    tokid("identify", tmp_path / "data.npz", "--lags", 2, "--states", 4, "--initial-state", "unknown",
          "-o", tmp_path / "model.npz")
    begin = int(load(tmp_path / "model.npz")["k_begin"])
    assert begin >= 2
    arguments = ["plan", "--model", tmp_path / "model.npz", "--experiments", 12, "-o", tmp_path / "inputs.npz"]
    result = tokid.json(*arguments)
    assert result["initial_state"] == "unknown"
    assert (result["first_step"], result["first_forecast"]) == (2, begin + 2)
    assert [c is None for c in result["condition"]["per_step"]] == [k < begin + 2 for k in range(40)]
    assert [c is None for c in result["input_condition"]["per_step"]] == [k < 2 for k in range(40)]
    assert any(f"begins at step {begin}, so tokid computes no forecasts" in text and f"before step {begin + 2}" in text for text in result["warnings"])
    assert str(load(tmp_path / "inputs.npz")["initial_state"]) == "unknown"
    assert tokid.json(*arguments, "--initial-state", "zero")["initial_state"] == "zero"
    assert str(load(tmp_path / "inputs.npz")["initial_state"]) == "zero"


def test_json_keeps_its_promise(tokid, tmp_path):
    result = tokid.json("plan", *SIZES, "--steps", 20, "--initial-state", "unknown", "--nominal",
                        "--experiments", 11, "-o", tmp_path / "inputs.npz")
    assert (result["minimum"], result["unknowns"], result["lags"], result["first_step"]) == (11, 10, 2, 2)
    assert result["excess"] is None  # infinite
    assert result["input_condition"]["per_step"][:2] == [None, None]
    assert len(result["input_condition"]["per_step"]) == 20
    assert all(isinstance(text, str) for text in result["reasons"] + result["warnings"])


@pytest.mark.parametrize("arguments,words", [
    ([], ["--states"]),
    ([*SIZES], ["--steps"]),
    ([*SIZES, "--steps", 80, "--experiments", 9], ["experiments: 9 found", "10"]),
    ([*SIZES, "--steps", 80, "--lags", 1], ["lags: 1 found", "2"]),
    ([*SIZES, "--steps", 2], ["steps: 2 found", "3"]),
    ([*SIZES, "--steps", "0"], ["--steps", "'0'"]),
    ([*SIZES, "--steps", 80, "--kind", "white"], ["'white'", "gaussian|binary|multisine"]),
    ([*SIZES, "--steps", 80, "--kind", "optimised"], ["model"]),
    ([*SIZES, "--steps", 80, "--amplitude", "1,0"], ["--amplitude", "'1,0'"]),
    ([*SIZES, "--steps", 80, "--amplitude", "1,2,3"], ["amplitude: 3"]),
    ([*SIZES, "--steps", 80, "--amplitude", "1e300"], ["amplitude: 1e+300", "1e+60"]),
    ([*SIZES, "--steps", 80, "--noise", "0:1e300"], ["noise", "1e+60"]),
    (["--states", 4, "--inputs", 1000, "--outputs", 2, "--steps", 80], ["sizes: 3004 experiments", "GB"]),
    (["--model", "MODEL", "--dt", 3], ["dt: 3 s found", "0.05"]),
    ([*SIZES, "--steps", 80, "--noise", "0.1"], ["--noise", "'0.1'", "0.01:0.1"]),
    ([*SIZES, "--steps", 80, "--noise", "-1:0"], ["--noise", "'-1:0'"]),
    ([*SIZES, "--steps", 80, "--noise", "nan:1"], ["--noise"]),
    (["--model", "MODEL", "--states", 3], ["states: 3 found", "4"]),
    (["--model", "MODEL", "--steps", 41], ["steps: 41 found", "40"]),
    (["--model", "missing.npz"], ["missing.npz"]),
])
def test_wrong_calls_are_refused(tokid, tmp_path, oscillator, arguments, words):
    arguments = [oscillator / "model.npz" if a == "MODEL" else a for a in arguments]
    result = tokid("plan", *arguments, "-o", tmp_path / "inputs.npz", status=2)
    assert result.stdout == ""
    assert re.fullmatch(r"tokid: [^\n]+\n", result.stderr)
    for word in words:
        assert word in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_unwritable_output(tokid, tmp_path):
    result = tokid("plan", *SIZES, "--steps", 80, "-o", tmp_path / "nowhere/inputs.npz", status=2)
    assert "nowhere" in result.stderr
