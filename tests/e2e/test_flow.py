# SPDX-License-Identifier: BSD-3-Clause
"""example, identify, info, validate, simulate, predict, convert in every format, with the numbers checked in NumPy."""

import numpy as np
import pytest
import scipy.stats
from support import assert_close, fit, load, predict, rmse, simulate

# Forty steps of a recursion over four states, summed in another order than here, stay within a few hundred units of
# rounding; 1e-12 leaves room and is still far below anything a wrong term would do.
ROUNDING = 1e-12

ENSEMBLES = [".npz", ".h5", ".hdf5", ".mat", ".csv"]
MODELS = [".npz", ".h5", ".mat"]


@pytest.mark.parametrize("system,sizes", [("oscillator", (2, 2, 4)), ("rotating-tube", (1, 1, 2))])
def test_example_has_the_sizes_asked_for(tokid, tmp_path, system, sizes):
    r, m, n = sizes
    tokid("example", system, "-o", tmp_path / "data.npz", "--experiments", 30, "--steps", 25, "--free-responses", 6)
    data = load(tmp_path / "data.npz")
    assert data["u"].shape == (30, 25, r)
    assert data["y"].shape == (30, 25, m)
    assert data["free_y"].shape == (6, 25, m)
    assert str(data["initial_state"]) == "zero"
    result = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz")
    assert result["states"] == n
    # Free responses give the state its full dimension from the first step on.
    assert load(tmp_path / "model.npz")["state_dim"][0] == n


def test_example_follows_its_options(tokid, tmp_path):
    def example(*options):
        tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 5, "--steps", 9, *options)
        return load(tmp_path / "data.npz")

    plain, again, other = example(), example(), example("--seed", 2)
    np.testing.assert_array_equal(plain["y"], again["y"])
    assert not np.array_equal(plain["u"], other["u"])
    # From rest the first output is the feed-through alone, D = 0.1 I.
    np.testing.assert_allclose(plain["y"][:, 0], 0.1 * plain["u"][:, 0], rtol=0, atol=1e-15)
    noisy = example("--measurement-noise", 0.5)
    np.testing.assert_array_equal(noisy["u"], plain["u"])
    # 90 samples: the standard deviation is met within a third, far beyond its standard error of 1/13.
    assert np.std(noisy["y"] - plain["y"]) == pytest.approx(0.5, rel=1 / 3)
    assert not np.array_equal(example("--process-noise", 0.5)["y"], plain["y"])
    thrown = example("--initial-state", "unknown")
    assert str(thrown["initial_state"]) == "unknown"
    assert np.abs(thrown["y"][:, 0] - 0.1 * thrown["u"][:, 0]).min() > 0


@pytest.mark.parametrize("extension", ENSEMBLES)
def test_every_format_gives_the_same_model(tokid, tmp_path, oscillator, extension):
    data = tmp_path / f"data{extension}"
    tokid("convert", oscillator / "data.npz", data)
    tokid("identify", data, "-o", tmp_path / "model.npz")
    expected, found = load(oscillator / "model.npz"), load(tmp_path / "model.npz")
    assert found.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.mark.parametrize("extension", MODELS)
def test_models_of_every_format_compute_the_same(tokid, tmp_path, oscillator, extension):
    model = tmp_path / f"model{extension}"
    tokid("identify", oscillator / "data.npz", "-o", model)
    fresh, computed = load(oscillator / "fresh.npz"), load(oscillator / "model.npz")
    for command, expected in (("simulate", simulate(computed, fresh["u"])),
                              ("predict", predict(computed, fresh["u"], fresh["y"]))):
        tokid(command, model, oscillator / "fresh.npz", "-o", tmp_path / "out.npz")
        assert_close(load(tmp_path / "out.npz")["y"], expected, ROUNDING)


def test_mat73_is_read_back(tokid, tmp_path, oscillator):
    for name in ("data", "model"):
        tokid("convert", oscillator / f"{name}.npz", tmp_path / f"{name}.mat", "--mat73")
        # Version 7.3 is HDF5 behind a header of 512 bytes.
        assert (tmp_path / f"{name}.mat").read_bytes()[512:520] == b"\x89HDF\r\n\x1a\n"
        tokid("convert", tmp_path / f"{name}.mat", tmp_path / f"{name}.npz")
        expected, found = load(oscillator / f"{name}.npz"), load(tmp_path / f"{name}.npz")
        assert found.keys() == expected.keys()
        for key in expected:
            np.testing.assert_array_equal(found[key], expected[key], err_msg=key)


@pytest.mark.parametrize("extension", ENSEMBLES)
def test_computed_ensembles_of_every_format(tokid, tmp_path, oscillator, extension):
    tokid("simulate", oscillator / "model.npz", oscillator / "fresh.npz", "-o", tmp_path / f"out{extension}")
    fresh = load(oscillator / "fresh.npz")
    found = tokid.arrays(tmp_path / f"out{extension}", tmp_path)
    np.testing.assert_array_equal(found["u"], fresh["u"])
    assert float(found["dt"]) == 0.05
    assert_close(found["y"], simulate(load(oscillator / "model.npz"), fresh["u"]), ROUNDING)


def test_noise_free_data_are_reproduced(tokid, oscillator):
    result = tokid.json("validate", oscillator / "model.npz", oscillator / "fresh.npz", "--horizon", 5)
    for key in ("simulation_fit", "one_step_fit", "horizon_fit"):
        assert min(result[key]) > 99.9999, key
    # Noise-free innovations are errors of arithmetic, which no test of whiteness applies to.
    assert result["whiteness_p"] is None
    # Outputs of unit order that pass through windows of condition 1e3 keep far more than nine digits.
    scale = load(oscillator / "fresh.npz")["y"].std(axis=(0, 1))
    assert np.all(result["simulation_rmse"] < 1e-9 * scale)
    assert np.all(result["one_step_rmse"] < 1e-9 * scale)


@pytest.fixture(scope="module")
def noisy(tokid, tmp_path_factory):
    directory = tmp_path_factory.mktemp("noisy")
    noise = ["--process-noise", 0.1, "--measurement-noise", 0.3, "--steps", 30]
    tokid("example", "oscillator", "-o", directory / "data.npz", "--experiments", 150, *noise)
    tokid("example", "oscillator", "-o", directory / "fresh.npz", "--experiments", 20, "--seed", 2, *noise)
    tokid("identify", directory / "data.npz", "-o", directory / "model.npz", "--lags", 3, "--states", 4)
    return directory


@pytest.mark.parametrize("horizon", [1, 2, 7])
def test_predictions_are_those_of_the_observer(tokid, tmp_path, noisy, horizon):
    model, fresh = load(noisy / "model.npz"), load(noisy / "fresh.npz")
    tokid("predict", noisy / "model.npz", noisy / "fresh.npz", "-o", tmp_path / "out.npz", "--horizon", horizon)
    found = load(tmp_path / "out.npz")
    np.testing.assert_array_equal(found["u"], fresh["u"])
    assert_close(found["y"], predict(model, fresh["u"], fresh["y"], horizon), ROUNDING)


def test_validation_figures(tokid, noisy):
    model, fresh = load(noisy / "model.npz"), load(noisy / "fresh.npz")
    result = tokid.json("validate", noisy / "model.npz", noisy / "fresh.npz", "--horizon", 4)
    for key, computed in (("simulation", simulate(model, fresh["u"])),
                          ("one_step", predict(model, fresh["u"], fresh["y"])),
                          ("horizon", predict(model, fresh["u"], fresh["y"], 4))):
        # Fits of tens of percent that agree to ten digits were computed by the same formula.
        np.testing.assert_allclose(result[f"{key}_fit"], fit(fresh["y"], computed), rtol=0, atol=1e-8)
        np.testing.assert_allclose(result[f"{key}_rmse"], rmse(fresh["y"], computed), rtol=1e-10)
    assert 0 <= result["whiteness_p"] <= 1
    assert 0 <= result["independence_p"] <= 1
    assert 0 <= result["feedback_p"] <= 1
    assert result["tested_over"] == "experiments"


def test_fits_from_a_common_step_on(tokid, noisy):
    model, fresh = load(noisy / "model.npz"), load(noisy / "fresh.npz")
    first = 13
    result = tokid.json("validate", noisy / "model.npz", noisy / "fresh.npz", "--horizon", 4, "--from", first)
    for key, computed in (("simulation", simulate(model, fresh["u"])),
                          ("one_step", predict(model, fresh["u"], fresh["y"])),
                          ("horizon", predict(model, fresh["u"], fresh["y"], 4))):
        expected = fit(fresh["y"][:, first:], computed[:, first:])
        np.testing.assert_allclose(result[f"{key}_fit"], expected, rtol=0, atol=1e-8)
    assert result["first_predicted"] == result["first_simulated"] == first
    call = ["validate", noisy / "model.npz", noisy / "fresh.npz", "--from"]
    assert f"from step {first} on" in tokid(*call, first, "--verbose").stdout
    assert "first_step: 30 found, 0 to 29 needed" in tokid(*call, 30, status=2).stderr


def test_worst_experiments_are_listed_first(tokid, noisy):
    model, fresh = load(noisy / "model.npz"), load(noisy / "fresh.npz")
    listed = tokid.json("validate", noisy / "model.npz", noisy / "fresh.npz")["worst_experiments_first"]
    errors = np.sqrt(np.mean((fresh["y"] - predict(model, fresh["u"], fresh["y"])) ** 2, axis=1))
    assert sorted(entry["experiment"] for entry in listed) == list(range(len(errors)))
    # tokid takes the upper one of two middle values as median.
    over_median = errors / np.sort(errors, axis=0)[len(errors) // 2]
    for entry in listed:
        np.testing.assert_allclose(entry["one_step_rmse"], errors[entry["experiment"]], rtol=1e-10)
        np.testing.assert_allclose(entry["over_median"], over_median[entry["experiment"]], rtol=1e-10)
    largest = [entry["excess"] for entry in listed]
    assert largest == sorted(largest, reverse=True)
    page = tokid("validate", noisy / "model.npz", noisy / "fresh.npz", "--verbose").stdout
    rows = page.split("\nWorst ")[1].splitlines()[1:6]
    assert [int(row.split()[0]) for row in rows] == [entry["experiment"] for entry in listed[:5]]


def test_outlying_experiments_are_listed_without_verbose(tokid, noisy, tmp_path):
    arrays = load(noisy / "fresh.npz")
    arrays["y"] = arrays["y"].copy()
    arrays["y"][3] *= -30
    np.savez(tmp_path / "bad.npz", **arrays)
    text = tokid("validate", noisy / "model.npz", tmp_path / "bad.npz").stdout
    rows = text.split("\nWorst ")[1].splitlines()[1:6]
    assert rows[0].split()[0] == "3" and [row.endswith(", outlying") for row in rows] == [True] + 4 * [False]
    assert "\nWorst " not in tokid("validate", noisy / "model.npz", noisy / "fresh.npz").stdout


def test_normalised_innovations_squared(tokid, noisy):
    model, fresh = load(noisy / "model.npz"), load(noisy / "fresh.npz")
    result = tokid.json("validate", noisy / "model.npz", noisy / "fresh.npz")
    innovations = fresh["y"] - predict(model, fresh["u"], fresh["y"])
    squares = np.einsum("nki,kij,nkj->nk", innovations, np.linalg.inv(model["innovation_cov"]), innovations)
    outputs = innovations.shape[2]
    assert result["nis"] == pytest.approx(squares.mean() / outputs, rel=1e-9)
    experiments = len(squares)
    assert result["nis_presumes_normal"] is (experiments < 20)
    if experiments < 20:
        chi2 = scipy.stats.chi2(squares.size * outputs)
        p = 2 * min(chi2.cdf(squares.sum()), chi2.sf(squares.sum()))
    else:
        p = scipy.stats.ttest_1samp(squares.sum(axis=1), squares.shape[1] * outputs).pvalue
    assert result["nis_p"] == pytest.approx(p, rel=1e-6)


def test_cross_validation_figures(tokid, tmp_path, noisy):
    """Every fold is what identify and validate say of its experiments."""
    orders = ["--lags", 3, "--states", 4, "--nominal", "none", "--no-refine"]
    tokid("identify", noisy / "data.npz", "-o", tmp_path / "model.npz", *orders, "--hold-out", 0.2)
    found = tokid.json("validate", tmp_path / "model.npz", noisy / "data.npz", "--cross-validate", 3, "--horizon", 4)
    data = load(noisy / "data.npz")
    count = len(data["u"])
    for i, fold in enumerate(found["cross_validation"]["per_fold"]):
        kept = np.arange(count) % 3 == i
        for name, rows in (("others", ~kept), ("kept", kept)):
            np.savez(tmp_path / f"{name}.npz", **{**data, "u": data["u"][rows], "y": data["y"][rows]})
        tokid("identify", tmp_path / "others.npz", "-o", tmp_path / "fold.npz", *orders)
        expected = tokid.json("validate", tmp_path / "fold.npz", tmp_path / "kept.npz", "--horizon", 4)
        for key in ("simulation_fit", "one_step_fit", "horizon_fit"):
            np.testing.assert_allclose(fold[key], expected[key], rtol=1e-9)
    shown = tokid("validate", tmp_path / "model.npz", noisy / "data.npz", "--cross-validate", 3).stdout
    assert "K = 3, n = 4 in all folds; p = 3 in all folds" in shown and "±" in shown


def test_identify_reports_what_validate_finds(tokid, tmp_path, noisy):
    result = tokid.json("identify", noisy / "data.npz", "-o", tmp_path / "model.npz", "--lags", 3, "--states", 4)
    assert result["evaluated_on"] == "training"
    again = tokid.json("validate", tmp_path / "model.npz", noisy / "data.npz")
    for key in ("simulation_fit", "one_step_fit"):
        # The same computation twice, less the last digit of the text.
        np.testing.assert_allclose(result[key], again[key], rtol=1e-9)


def test_inputs_alone_are_enough_to_simulate(tokid, tmp_path, oscillator):
    fresh = load(oscillator / "fresh.npz")
    expected = simulate(load(oscillator / "model.npz"), fresh["u"])
    # Outputs that are there are not used.
    for outputs in ({}, {"y": np.zeros((7, 40, 3))}):
        np.savez(tmp_path / "inputs.npz", u=fresh["u"], dt=0.05, **outputs)
        tokid("simulate", oscillator / "model.npz", tmp_path / "inputs.npz", "-o", tmp_path / "out.npz")
        assert_close(load(tmp_path / "out.npz")["y"], expected, ROUNDING)
    # The noise-free truth, to the accuracy of test_noise_free_data_are_reproduced.
    assert_close(expected, fresh["y"], 1e-9)


def test_fewer_and_more_steps_than_the_model_has(tokid, tmp_path, oscillator):
    model, rng = load(oscillator / "model.npz"), np.random.default_rng(3)
    for steps in (7, 60):
        u = rng.standard_normal((3, steps, 2))
        np.savez(tmp_path / "inputs.npz", u=u, dt=0.05)
        result = tokid("simulate", oscillator / "model.npz", tmp_path / "inputs.npz", "-o", tmp_path / "out.npz")
        covered = {7: "steps 0 to 6\n", 60: "steps 0 to 39; at all other steps they are missing (NaN)\n"}[steps]
        assert covered in result.stdout
        y = load(tmp_path / "out.npz")["y"]
        assert np.isnan(y).any() == (steps == 60)
        assert_close(y, simulate(model, u), ROUNDING)


def test_channel_names_go_along(tokid, tmp_path):
    tokid("example", "oscillator", "-o", tmp_path / "plain.npz", "--experiments", 20, "--steps", 15)
    names = {"input_names": ["Drehmoment", "τ2"], "output_names": ["q1", "q2"], "input_units": ["N m", "N m"],
             "output_units": ["rad", "rad"]}
    np.savez(tmp_path / "data.npz", **{**load(tmp_path / "plain.npz"), **names})
    shown = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.h5").stdout
    assert "q1 [rad]" in shown
    shown = tokid("info", tmp_path / "model.h5").stdout
    assert "Drehmoment [N m], τ2 [N m]" in shown
    assert tokid.json("info", tmp_path / "model.h5")["output_names"] == names["output_names"]
    np.savez(tmp_path / "inputs.npz", u=load(tmp_path / "plain.npz")["u"], dt=0.05)
    tokid("simulate", tmp_path / "model.h5", tmp_path / "inputs.npz", "-o", tmp_path / "out.npz")
    out = load(tmp_path / "out.npz")
    for key, value in names.items():
        assert list(out[key]) == value


def test_other_units_are_told(tokid, tmp_path, oscillator):
    values = load(oscillator / "data.npz")
    for name, units in ("model", {"input_units": ["N", ""], "output_units": ["m", "m"]}), ("newton", {}), (
            "pound", {"input_units": ["lbf", "kg"], "output_units": ["m", "ft"]}):
        np.savez(tmp_path / f"{name}.npz", **{**values, **units})
    tokid("identify", tmp_path / "model.npz", "-o", tmp_path / "made.npz")
    for call in ("simulate", "predict"):
        assert tokid(call, tmp_path / "made.npz", tmp_path / "newton.npz", "-o", tmp_path / "out.npz").stderr == ""
        said = tokid(call, tmp_path / "made.npz", tmp_path / "pound.npz", "-o", tmp_path / "out.npz").stderr
        assert said.splitlines() == [
            "tokid: warning: the data's input u1 has the unit lbf, but this channel of the model has the unit N. "
            "tokid does not convert units",
            "tokid: warning: the data's output y2 has the unit ft, but this channel of the model has the unit m. "
            "tokid does not convert units"]
    assert "has the unit lbf" in "".join(tokid.json("validate", tmp_path / "made.npz", tmp_path / "pound.npz")["warnings"])


def test_steps_beyond_the_model_are_told(tokid, tmp_path, oscillator):
    values = load(oscillator / "data.npz")
    for name in "u", "y":
        values[name] = np.concatenate([values[name]] * 2, axis=1)
    np.savez(tmp_path / "long.npz", **values)
    told = "the model ends with step 39, so it does not cover the last 40 steps of the data"
    assert tokid.json("validate", oscillator / "model.npz", tmp_path / "long.npz")["warnings"] == [told]
    for call in "simulate", "predict":
        computed = tokid(call, oscillator / "model.npz", tmp_path / "long.npz", "-o", tmp_path / "computed.npz")
        assert f"tokid: warning: {told}\n" in computed.stderr
    assert "the model ends" not in tokid("validate", oscillator / "model.npz", oscillator / "data.npz").stderr


def test_one_wild_experiment_is_no_agreement(tokid, tmp_path, noisy):
    values = load(noisy / "fresh.npz")
    values["y"][0] *= 1e6
    np.savez(tmp_path / "wild.npz", **values)
    result = tokid.json("validate", noisy / "model.npz", tmp_path / "wild.npz")
    assert result["nis"] > 1e6 and result["nis_p"] > 0.01  # of the spread over the experiments
    tokid("report", noisy / "model.npz", tmp_path / "wild.npz", "-o", tmp_path / "page.html")
    text = "much larger than the model says, at least in single experiments"
    assert text in (tmp_path / "page.html").read_text()
    assert text in " ".join(tokid("validate", noisy / "model.npz", tmp_path / "wild.npz", "--verbose").stdout.split())


def test_columns_of_a_csv_by_name(tokid, tmp_path, oscillator):
    data = load(oscillator / "data.npz")
    experiments, steps = data["u"].shape[:2]
    lines = ["experiment,time,torque,force,angle,speed"]
    lines += [",".join([str(n), repr(k * 0.05), *map(repr, data["u"][n, k].tolist() + data["y"][n, k].tolist())])
              for n in range(experiments) for k in range(steps)]
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    tokid("identify", tmp_path / "data.csv", "-o", tmp_path / "model.npz", "--inputs", "torque,force", "--outputs",
          "angle,speed")
    found = load(tmp_path / "model.npz")
    assert list(found["input_names"]) == ["torque", "force"]
    np.testing.assert_array_equal(found["A"], load(oscillator / "model.npz")["A"])


def test_data_are_not_overwritten_but_a_model_may_be_refined_in_place(tokid, tmp_path, oscillator):
    for name in ("data", "model"):
        (tmp_path / f"{name}.npz").write_bytes((oscillator / f"{name}.npz").read_bytes())
    model, data, alias = tmp_path / "model.npz", tmp_path / "data.npz", tmp_path / "alias.npz"
    alias.symlink_to(data)
    before = data.read_bytes()
    for output in (data, alias):
        for call in (("identify", data), ("refine", model, data), ("simulate", model, data), ("predict", model, data),
                     ("confidence", model, data), ("convert", data)):
            run = tokid(*call, *(["-o"] if call[0] != "convert" else []), output, status=2)
            assert f"{output.name}: another file of this command has this name, " \
                "and writing would replace it. Use another name" in run.stderr
    assert data.read_bytes() == before
    tokid("refine", model, data, "-o", model, "--iterations", 2)
    assert load(model)["method"] == "em"


def test_two_results_do_not_share_a_name(tokid, tmp_path, oscillator):
    for state in "out.npz", "./out.npz", tmp_path / "out.npz":
        run = tokid("identify", oscillator / "data.npz", "-o", "out.npz", "--state", state, status=2, cwd=tmp_path)
        assert "another file of this command has this name" in run.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("frame", ["reference", "smooth"])
def test_frames_change_no_output(tokid, tmp_path, oscillator, frame):
    tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--frame", frame)
    model, raw = load(tmp_path / "model.npz"), load(oscillator / "model.npz")
    assert str(model["frame"]) == frame
    assert not np.allclose(model["A"], raw["A"])
    fresh = load(oscillator / "fresh.npz")
    # A change of coordinates costs the digits of its condition, a few hundred here.
    assert_close(simulate(model, fresh["u"]), simulate(raw, fresh["u"]), 1e-9)


def test_reference_step(tokid, tmp_path, oscillator):
    tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--frame", "reference",
          "--reference-step", 20)
    model = load(tmp_path / "model.npz")
    # x' = O_s+ O_k x leaves the coordinates of the reference step itself alone, and no others.
    raw = load(oscillator / "model.npz")
    np.testing.assert_allclose(model["C"][20], raw["C"][20], rtol=0, atol=1e-10 * np.abs(raw["C"][20]).max())
    assert np.abs(model["C"][21] - raw["C"][21]).max() > 1e-6


def test_no_feedthrough(tokid, tmp_path, oscillator):
    tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--no-feedthrough")
    model = load(tmp_path / "model.npz")
    assert np.all(model["D"] == 0) and np.any(model["B"] != 0)
    assert '"feedthrough":"no"' in str(model["options"])


def save_under_feedback(path, gain, seed):
    """A slowly varying plant without feedthrough, with noise, and the feedback u[k] = w[k] - gain y[k]."""
    rng, T, N = np.random.default_rng(seed), 60, 60
    u, y, x = np.zeros((N, T, 1)), np.zeros((N, T, 1)), np.zeros((N, 2))
    for k in range(T):
        y[:, k] = x[:, :1] + 0.3 * rng.normal(size=(N, 1))
        u[:, k] = 0.3 * rng.normal(size=(N, 1)) - gain * y[:, k]
        A, B = [[0.9, 0.3], [-0.2, 0.7 + 0.1 * np.sin(0.1 * k)]], [1 + 0.3 * np.cos(0.1 * k), 0.5]
        x = x @ np.transpose(A) + u[:, k] * B + 0.05 * rng.normal(size=(N, 2))
    np.savez(path, u=u, y=y, dt=1.0, initial_state="zero")


def test_feedback_in_the_same_step_is_a_warning_until_feedthrough_is_stated(tokid, tmp_path):
    data, model = tmp_path / "data.npz", tmp_path / "model.npz"
    words = ("input u1 and output y1 are correlated within a step, and the inputs depend on earlier outputs. The data "
             "do not show whether feedthrough or feedback within the step causes this correlation, so D may be wrong. If "
             "the controller uses the output of the same step, state that there is no feedthrough (--no-feedthrough). "
             "Otherwise, state that there is feedthrough (--feedthrough)")
    save_under_feedback(data, 0.8, 1)
    found = tokid("identify", data, "-o", model, "--no-refine", "--verbose")
    assert words in " ".join(found.stderr.split())
    assert "Feedthrough    D is estimated, the outputs and inputs of a step are correlated" in found.stdout
    assert np.any(load(model)["D"] != 0)
    assert '"feedthrough_choice":{"present":true,"reason":"feedback"}' in str(load(model)["options"])
    for option, reason, present in (("--no-feedthrough", "stated", False), ("--feedthrough", "stated", True)):
        found = tokid.json("identify", data, "-o", model, "--no-refine", option)
        assert (found["feedthrough"], found["feedthrough_choice"]["reason"]) == (present, reason)
        assert not any("same step" in text for text in found["warnings"])
        assert np.any(load(model)["D"] != 0) == present


def test_feedthrough_that_noisy_data_do_not_show_is_zero(tokid, tmp_path):
    data, model = tmp_path / "data.npz", tmp_path / "model.npz"
    save_under_feedback(data, 0.0, 2)
    found = tokid.json("identify", data, "-o", model, "--no-refine", "--report", tmp_path / "page.html")
    assert not found["feedthrough"] and found["feedthrough_choice"]["reason"] == "no_response"
    assert found["feedthrough_choice"]["response_p"] >= 0.01
    assert found["feedthrough_choice"]["feedback_p"] is None
    assert np.all(load(model)["D"] == 0)
    assert "D = 0, no response of the outputs" in (tmp_path / "page.html").read_text()
