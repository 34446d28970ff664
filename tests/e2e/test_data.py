# SPDX-License-Identifier: BSD-3-Clause
"""What real ensembles bring along: dead inputs, unknown initial states, a mean motion, gaps, hold-out, threads."""

import numpy as np
import pytest
from support import assert_close, load, random_system, simulate

# Errors of identification without noise: rounding times the condition of the windows (1e2 to 1e4 here), carried
# through the steps.
EXACT = 1e-8


def experiments(system, count, seed, x0=None):
    """Inputs and outputs of `count` experiments on a known system, from rest or from the given states."""
    rng = np.random.default_rng(seed)
    steps, outputs, states = system["C"].shape
    u = rng.standard_normal((count, steps, system["B"].shape[2]))
    y = np.empty((count, steps, outputs))
    x = np.zeros((count, states)) if x0 is None else x0
    for k in range(steps):
        A, B, C, D = (system[name][k] for name in "ABCD")
        y[:, k] = x @ C.T + u[:, k] @ D.T
        x = x @ A.T + u[:, k] @ B.T
    return u, y


@pytest.fixture
def identify(tokid, tmp_path):
    """Writes an ensemble and identifies it: the JSON and the arrays of the model."""
    def call(*options, **values):
        np.savez(tmp_path / "data.npz", **values)
        found = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", *options)
        return found, load(tmp_path / "model.npz")

    return call


def warning_with(found, *words):
    matching = [text for text in found["warnings"] if all(word in text for word in words)]
    assert len(matching) == 1, found["warnings"]
    return matching[0]


# Inputs that identify nothing

@pytest.mark.parametrize("states", [2, 3])  # as many as two block columns of one live input can reach, and more
@pytest.mark.parametrize("value,word", [(0.0, "zero"), (2.5, "the same")])
def test_dead_input(tokid, identify, tmp_path, value, word, states):
    system = random_system(1, 20, states, 2, 2)
    system["B"][:, :, 1] = system["D"][:, :, 1] = 0.0  # what never moves leaves no trace in the outputs
    u, y = experiments(system, 40, 2)
    u[:, :, 1] = value
    found, model = identify("--lags", 2, "--nominal", "none", u=u, y=y, initial_state="zero",
                            input_names=["torque", "brake"])
    warning_with(found, "brake", word, "0–19")
    assert not any("torque" in text for text in found["warnings"])
    # Step 0 has no lags: a constant is a regressor there like any other.
    assert found["rank_deficient_steps"] == (20 if value == 0 else 19)
    # What the other input does is found all the same.
    fresh = np.random.default_rng(3).standard_normal((5, 20, 2))
    fresh[:, :, 1] = value
    assert_close(simulate(model, fresh), simulate(system, fresh), EXACT)
    # The same warning reaches people.
    assert "brake" in tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "again.npz", "--lags", 2, "--nominal",
                            "none").stderr


def test_input_that_rests_for_some_steps(identify):
    u, _ = experiments(random_system(1, 20, 3, 2, 2), 40, 2)
    u[:, 5:8, 0] = 0.0
    u[:, 11, 0] = 0.0
    found, _ = identify("--lags", 2, u=u, y=simulate(random_system(1, 20, 3, 2, 2), u), initial_state="zero")
    warning_with(found, "u1", "zero", "5–7 and 11")
    assert min(found["simulation_fit"]) > 99.9999


def test_all_inputs_dead(identify):
    y = np.random.default_rng(1).standard_normal((40, 10, 1))
    found, _ = identify("--lags", 1, u=np.zeros((40, 10, 1)), y=y, initial_state="zero")
    warning_with(found, "u1", "zero", "0–9")


# Initial states

@pytest.fixture(scope="module")
def thrown():
    system = random_system(4, 30, 4, 2, 2)
    x0 = 100 * np.random.default_rng(5).standard_normal((60, 4))
    return system, *experiments(system, 60, 6, x0)


@pytest.mark.parametrize("stated,option", [("unknown", []), (None, []), (None, ["--initial-state", "unknown"]),
                                           ("zero", ["--initial-state", "unknown"])])
def test_unknown_initial_states(tokid, identify, tmp_path, thrown, stated, option):
    system, u, y = thrown
    found, model = identify("--nominal", "none", *option, u=u, y=y, **({"initial_state": stated} if stated else {}))
    assert found["initial_state"] == "unknown"
    p, n, r = found["lags"], found["states"], 2
    assert (p, n) == (2, 4)
    assert p <= found["k_begin"] <= p + -(-n // r)
    assert model["k_begin"] == found["k_begin"]
    assert model["state_dim"][0] == n
    warning_with(found, "unknown", f"step {found['k_begin']}")
    assert min(found["one_step_fit"]) > 99.9999 and min(found["simulation_fit"]) > 99.9999

    # Fresh experiments from other states: exact p steps after the model begins, and not before.
    x0 = 100 * np.random.default_rng(7).standard_normal((6, 4))
    u, y = experiments(system, 6, 8, x0)
    np.savez(tmp_path / "fresh.npz", u=u, y=y)
    result = tokid("predict", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "out.npz")
    predicted = load(tmp_path / "out.npz")["y"]
    first = found["k_begin"] + p
    assert f"outputs at steps {first} to 29; at all other steps they are missing (NaN)" in result.stdout
    assert np.isnan(predicted[:, :first]).all()
    assert_close(predicted[:, first:], y[:, first:], EXACT)


def test_simulating_without_the_initial_state_is_said(tokid, identify, tmp_path, thrown):
    _, u, y = thrown
    found, model = identify("--nominal", "none", u=u, y=y, initial_state="unknown")
    result = tokid("simulate", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "out.npz")
    assert "unknown" in result.stderr and f"zero state at step {found['k_begin']}" in result.stderr
    assert_close(load(tmp_path / "out.npz")["y"], simulate(model, u), 1e-12)


def test_too_few_samples_to_find_the_state(tokid, identify, tmp_path, thrown):
    _, u, y = thrown
    found, _ = identify("--nominal", "none", u=u, y=y, initial_state="unknown")
    steps = found["k_begin"] + 1
    np.savez(tmp_path / "short.npz", u=u[:, :steps], y=y[:, :steps], initial_state="unknown")
    result = tokid("predict", tmp_path / "model.npz", tmp_path / "short.npz", "-o", tmp_path / "out.npz")
    assert len(result.stderr.splitlines()) == 1 and "all computed outputs are missing" in result.stderr
    assert np.isnan(load(tmp_path / "out.npz")["y"]).all()
    # What the tool writes it also reads; only what needs outputs refuses to go without.
    tokid("info", tmp_path / "out.npz")
    tokid("convert", tmp_path / "out.npz", tmp_path / "out.mat")
    tokid("simulate", tmp_path / "model.npz", tmp_path / "out.mat", "-o", tmp_path / "again.npz")
    assert "y1" in tokid("identify", tmp_path / "out.npz", "-o", tmp_path / "never.npz", status=2).stderr


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_zero_initial_states_are_found_out(identify, noise):
    system = random_system(4, 30, 4, 2, 2)
    u, y = experiments(system, 80, 6)
    y += noise * np.random.default_rng(9).standard_normal(y.shape)
    found, _ = identify(u=u, y=y)
    assert found["initial_state"] == "zero" == found["initial_state_test"]["decision"]
    assert found["initial_state_test"]["statistic"] <= found["initial_state_test"]["threshold"]
    assert found["k_begin"] == 0


def test_asked_for_zero(identify, thrown):
    _, u, y = thrown
    found, _ = identify("--initial-state", "zero", "--lags", 2, u=u, y=y, initial_state="unknown")
    assert found["initial_state"] == "zero"
    assert found["k_begin"] == 0


# Nominal trajectory

@pytest.fixture(scope="module")
def swinging():
    """Departures of a linear system around a mean motion a hundred times their size."""
    system = random_system(10, 25, 3, 2, 2)
    t = np.arange(25)[:, None]
    mean = {"u": 100 * np.sin(0.3 * t + [0, 1]), "y": 100 * np.cos(0.2 * t + [0, 2]) + 50}

    def draw(count, seed):
        u, y = experiments(system, count, seed)
        return {"u": u + mean["u"], "y": y + mean["y"]}

    return draw


@pytest.mark.parametrize("option", ["auto", "mean"])
def test_nominal_trajectory(tokid, identify, tmp_path, swinging, option):
    data, fresh = swinging(40, 11), swinging(5, 12)
    found, model = identify("--nominal", option, "--lags", 2, **data, initial_state="zero")
    assert found["nominal"] is True
    # The mean costs one experiment more.
    assert found["min_experiments"] == 2 + 2 * 4 + 1
    # A sum of forty numbers in two orders.
    assert_close(model["u_nominal"], data["u"].mean(axis=0), 1e-14)
    assert_close(model["y_nominal"], data["y"].mean(axis=0), 1e-14)
    assert min(found["simulation_fit"]) > 99.9999 and min(found["one_step_fit"]) > 99.9999

    np.savez(tmp_path / "fresh.npz", **fresh, initial_state="zero")
    for command in ("simulate", "predict"):
        tokid(command, tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "out.npz")
        assert_close(load(tmp_path / "out.npz")["y"], fresh["y"], EXACT)
    validated = tokid.json("validate", tmp_path / "model.npz", tmp_path / "fresh.npz")
    assert min(validated["simulation_fit"]) > 99.9999
    assert tokid.json("info", tmp_path / "model.npz")["nominal"] is True


def test_simulation_adds_the_nominal_trajectory_back(tokid, identify, tmp_path, swinging):
    _, model = identify("--lags", 2, **swinging(40, 11), initial_state="zero")
    u = swinging(3, 13)["u"]
    np.savez(tmp_path / "inputs.npz", u=u)
    tokid("simulate", tmp_path / "model.npz", tmp_path / "inputs.npz", "-o", tmp_path / "out.npz")
    found = load(tmp_path / "out.npz")["y"]
    assert_close(found, simulate(model, u), 1e-12)
    # Fit is told against the nominal trajectory: it alone would explain the outputs to a percent.
    assert np.abs(found.mean(axis=0)).max() > 100


def test_nominal_trajectory_can_be_left_in(identify, swinging):
    found, model = identify("--nominal", "none", "--lags", 2, **swinging(40, 11), initial_state="zero")
    assert found["nominal"] is False
    assert "u_nominal" not in model and "y_nominal" not in model


def gust(u, y, size=20.0):
    """A mean departure of the first output at 6 of the steps."""
    y = y.copy()
    y[:, 40:46, 0] += size
    return {"u": u, "y": y}


@pytest.mark.parametrize(("steps", "options"), [(100, []), (200, ["--block", 192])])
def test_a_mean_motion_of_few_steps_is_found(tokid, tmp_path, steps, options):
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--steps", steps, "--experiments", 60,
          "--measurement-noise", 0.1)
    found = load(tmp_path / "data.npz")
    np.savez(tmp_path / "data.npz", **{**found, **gust(found["u"], found["y"])})
    data = tmp_path / "data.h5"  # which can be read in blocks
    tokid("convert", tmp_path / "data.npz", data)
    call = ["identify", data, "-o", tmp_path / "model.h5", "--states", 4, "--lags", 4, "--smoothing", 1, "--no-refine", *options]
    found = tokid.json(*call)
    assert found["nominal"] is True
    test = found["nominal_test"]
    assert test["significant"] is True
    assert test["statistic"] < test["threshold"] and test["step_statistic"] > test["step_threshold"]
    assert test["departures"] == [{"channel": "y1", "steps": [[40, 45]]}]
    shown = tokid(*call, "--verbose").stdout
    assert "it is significant: y1 at steps 40–45" in " ".join(shown.split())
    # The mean of 60 experiments is the gust, up to five standard deviations.
    y = load(tmp_path / "data.npz")["y"][:, 40:46, 0]
    nominal = tokid.arrays(tmp_path / "model.h5", tmp_path)["y_nominal"][40:46, 0]
    assert np.abs(nominal - 20).max() < 5 * y.std(axis=0).max() / np.sqrt(60)


def test_no_nominal_trajectory_where_there_is_none(identify):
    u, y = experiments(random_system(10, 25, 3, 2, 2), 40, 11)
    found, model = identify("--lags", 2, u=u, y=y, initial_state="zero")
    assert found["nominal"] is False
    test = found["nominal_test"]
    assert test["statistic"] < test["threshold"] and test["step_statistic"] < test["step_threshold"]
    assert test["departures"] == []
    assert "u_nominal" not in model


# Gaps

def test_missing_samples(tokid, identify, tmp_path):
    system, rng = random_system(14, 25, 4, 2, 2), np.random.default_rng(15)
    u, y = experiments(system, 80, 16)
    u[rng.random(u.shape) < 0.01] = np.nan
    y[rng.random(y.shape) < 0.02] = np.nan
    missing = np.isnan(u).sum() + np.isnan(y).sum()
    found, model = identify("--lags", 2, u=u, y=y, initial_state="zero")
    assert found["missing_samples"] == missing
    assert tokid.json("info", tmp_path / "data.npz")["missing_samples"] == missing
    fresh, truth = experiments(system, 5, 17)
    assert_close(simulate(model, fresh), truth, EXACT)


def test_lost_outputs_correct_no_prediction(tokid, identify, tmp_path):
    system = random_system(14, 25, 4, 2, 2)
    u, y = experiments(system, 80, 16)
    identify("--lags", 2, u=u, y=y, initial_state="zero")
    fresh, truth = experiments(system, 5, 17)
    gaps = truth.copy()
    gaps[2, 6:9] = np.nan
    np.savez(tmp_path / "fresh.npz", u=fresh, y=gaps, initial_state="zero")
    tokid("predict", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "out.npz")
    # Without noise the state is right and stays so without correction.
    assert_close(load(tmp_path / "out.npz")["y"], truth, EXACT)


def test_unequal_lengths(tokid, identify, tmp_path):
    system, rng = random_system(14, 25, 4, 2, 2), np.random.default_rng(18)
    u, y = experiments(system, 80, 16)
    length = rng.integers(18, 26, len(u))
    length[:30] = 25
    for n, steps in enumerate(length):
        u[n, steps:] = y[n, steps:] = 1e9  # beyond the length: to be ignored, whatever it is
    found, model = identify("--lags", 2, u=u, y=y, length=length, initial_state="zero")
    assert found["missing_samples"] == 0
    fresh, truth = experiments(system, 5, 17)
    assert_close(simulate(model, fresh), truth, EXACT)
    shown = tokid("info", tmp_path / "data.npz").stdout
    assert f"{length.min()} to 25 steps" in shown


def test_steps_with_too_few_complete_experiments_are_told(identify):
    u, y = experiments(random_system(14, 25, 4, 2, 2), 20, 16)
    y[:15, 12, 0] = np.nan
    found, _ = identify("--lags", 2, u=u, y=y, initial_state="zero")
    warning_with(found, "missing samples", "12–14")


# Hold-out

def test_hold_out(identify):
    system = random_system(20, 20, 3, 1, 1)
    u, y = experiments(system, 50, 21)
    y += 0.1 * np.random.default_rng(22).standard_normal(y.shape)
    options = ["--lags", 4, "--states", 3, "--method", "tvera", "--nominal", "none", "--hold-out", 0.2]
    found, model = identify(*options, u=u, y=y, initial_state="zero")
    assert (found["experiments"], found["held_out_experiments"], found["evaluated_on"]) == (40, 10, "held_out")

    # Experiments that were held out leave no trace in the model, the others do.
    used = []
    for n in range(5):
        changed = y.copy()
        changed[n] *= 2
        _, other = identify(*options, u=u, y=changed, initial_state="zero")
        used.append(not np.array_equal(other["A"], model["A"]))
    assert sorted(used) == [False, True, True, True, True]

    # On held-out experiments the figures are worse than on the training data: that is what they are for.
    training, _ = identify(*options[:-2], u=u, y=y, initial_state="zero")
    assert training["evaluated_on"] == "training"
    assert found["one_step_fit"][0] < training["one_step_fit"][0]


# The same bits

@pytest.mark.parametrize("extension, options", [(".npz", ["--states", 4]), (".h5", ["--no-refine"])])
def test_threads_and_repetition_give_the_same_bits(tokid, tmp_path, extension, options):
    data = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 20, "--steps", 20, "--measurement-noise", 0.1)
    files = []
    for run, threads in enumerate([1, 3, 3]):
        model = tmp_path / f"model{run}{extension}"
        tokid("identify", data, "-o", model, "--threads", threads, "--hold-out", 0.25, *options)
        files.append(model.read_bytes())
    assert all(content == files[0] for content in files)


def test_examples_are_the_same_bits(tokid, tmp_path):
    for name in ("a.npz", "b.npz"):
        tokid("example", "rotating-tube", "-o", tmp_path / name, "--experiments", 3, "--process-noise", 1)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


# Data that do not fit the model

def test_differences_between_data_and_model_are_told(tokid, tmp_path, oscillator):
    data = load(oscillator / "fresh.npz")
    np.savez(tmp_path / "data.npz", **{**data, "dt": 0.1})
    found = tokid.json("validate", oscillator / "model.npz", tmp_path / "data.npz")
    warning_with(found, "0.1 s", "0.05 s")
    assert tokid.json("validate", oscillator / "model.npz", oscillator / "fresh.npz")["warnings"] == []


def test_channels_of_other_names_are_told(tokid, identify, tmp_path):
    u, y = experiments(random_system(10, 15, 2, 2, 2), 30, 11)
    identify("--lags", 1, u=u, y=y, input_names=["left", "right"], initial_state="zero")
    np.savez(tmp_path / "fresh.npz", u=u, y=y, input_names=["port", "right"])
    found = tokid.json("validate", tmp_path / "model.npz", tmp_path / "fresh.npz")
    warning_with(found, "port, right", "left, right")
