# SPDX-License-Identifier: BSD-3-Clause
"""tokid lqr: controllers in files, their closed loop, and what tokid info says about them."""

import h5py
import numpy as np
import pytest
import scipy.io
from support import identified, load


@pytest.fixture(scope="module")
def folder(tokid, tmp_path_factory):
    return identified(tokid, tmp_path_factory.mktemp("lqr"), 30)


def riccati(model, q, r):
    p, gains = np.zeros(model["A"].shape[1:]), []
    for a, b, c, d in zip(*(model[name][::-1] for name in "ABCD")):
        gain = np.linalg.solve(r + d.T @ q @ d + b.T @ p @ b, d.T @ q @ c + b.T @ p @ a)
        seen, closed = c - d @ gain, a - b @ gain
        p = seen.T @ q @ seen + gain.T @ r @ gain + closed.T @ p @ closed
        gains.append(gain)
    return np.array(gains[::-1])


def test_gains_and_cost(tokid, folder):
    model = np.load(folder / "model.npz")
    report = tokid.json("lqr", folder / "model.npz", "--output-weight", "2,3", "--input-weight", 0.5, "-o",
                        folder / "controller.npz")
    found = np.load(folder / "controller.npz")
    dims = model["state_dim"]
    assert np.array_equal(found["state_dim"], dims[:-1]) and found["k_begin"] == model["k_begin"]
    if np.all(dims == dims[0]):
        assert np.allclose(found["controller_gain"], riccati(model, np.diag([2.0, 3]), 0.5 * np.eye(2)), rtol=1e-8,
                           atol=1e-10)
    assert np.array_equal(found["output_weight"], [np.diag([2.0, 3])]) and "input_gain" not in found
    cost = report["expected_cost"]
    assert cost["total"] == cost["outputs"] + cost["inputs"] < report["nominal_cost"]["total"]
    assert report["presumes_zero_state"] is False
    assert (report["begin"], report["end"]) == (model["k_begin"], model["k_begin"] + len(model["A"]))


def test_formats_are_the_same(tokid, folder):
    arrays = {}
    for extension in ("npz", "h5", "mat"):
        file = folder / f"same.{extension}"
        tokid("lqr", folder / "model.npz", "--input-rate-weight", "0.1,0.2", "--terminal-weight", 3, "--begin", 5, "--end",
              20, "-o", file)
        if extension == "npz":
            arrays[extension] = dict(np.load(file))
        elif extension == "h5":
            with h5py.File(file) as opened:
                arrays[extension] = {name: opened[name][()] for name in opened}
        else:
            arrays[extension] = scipy.io.loadmat(file)
    plain = arrays["npz"]
    assert plain["controller_gain"].shape[:2] == (15, 2) and plain["k_begin"] == 5
    for name in ("controller_gain", "input_gain", "input_rate_weight"):
        assert np.array_equal(plain[name], arrays["h5"][name])
        in_matlab = arrays["mat"][name]
        stack = in_matlab[None] if in_matlab.ndim == 2 else in_matlab.transpose(2, 0, 1)
        assert np.array_equal(plain[name], stack)
    assert np.array_equal(plain["terminal_weight"], 3 * np.eye(2))


def test_text(tokid, folder):
    shown = tokid("lqr", folder / "model.npz", "--input-rate-weight", 0.1, "-o", folder / "c.h5").stdout
    assert "outputs 1, inputs 1" in shown and "expected with the observer" in shown and "nominal inputs alone" in shown
    known = folder / "known.npz"
    model = dict(np.load(folder / "model.npz"))
    np.savez(known, **{name: value for name, value in model.items() if name not in ("innovation_cov", "Q", "R", "K")})
    assert "not known, because the model has no noise" in tokid("lqr", known, "-o", folder / "c.h5").stdout


def test_costs_of_unknown_initial_states(tokid, folder):
    tokid("example", "oscillator", "-o", folder / "unknown.npz", "--experiments", 40, "--steps", 30, "--initial-state",
          "unknown", "--process-noise", 0.1, "--measurement-noise", 0.1)
    tokid("identify", folder / "unknown.npz", "-o", folder / "unknown_model.npz", "--states", 4, "--lags", 3, "--no-refine",
          "--quiet")
    assert "x0_mean" not in np.load(folder / "unknown_model.npz")
    call = ["lqr", folder / "unknown_model.npz", "-o", folder / "c.npz"]
    assert tokid.json(*call)["presumes_zero_state"] is True
    assert "presumes that the observer begins with the state zero" in tokid(*call).stdout


@pytest.mark.parametrize("words, message", [
    (["--output-weight", "1,2,3"], "--output-weight: 3 numbers found, one for all channels, or one for each of 2 needed"),
    (["--output-weight", "-1"], "numbers from 0 on needed"),
    (["--input-weight", "0"], "input: the sum of all weights on inputs is singular at step"),
    (["--end", "31"], "which the model has")])
def test_refusals(tokid, folder, words, message):
    refused = tokid("lqr", folder / "model.npz", *words, "-o", folder / "no.h5", status=2)
    assert message in refused.stderr and not (folder / "no.h5").exists()


def closed_loop(model, controller, truth, u_min, u_max):
    """The loop without noise from rest, and its cost, for models and controllers of the same steps."""
    n, begin = model["A"].shape[-1], int(model["k_begin"])
    x, estimate, cost = np.zeros(n), np.zeros(n), 0.0
    inputs, outputs = [], []
    for s, gain in enumerate(controller["controller_gain"]):
        du = controller["feedforward"][s] - gain @ estimate
        u = np.clip(controller["u_nominal"][s] + du, u_min, u_max)
        du, k = u - controller["u_nominal"][s], begin + s
        true_u = u - (truth["u_nominal"][k] if "u_nominal" in truth else 0)
        y = truth["C"][s] @ x + truth["D"][s] @ true_u + (truth["y_nominal"][k] if "y_nominal" in truth else 0)
        error = y - controller["y_nominal"][s] - controller["y_reference"][s]
        cost += error @ controller["output_weight"][0] @ error + du @ controller["input_weight"][0] @ du
        innovation = y - controller["y_nominal"][s] - model["C"][s] @ estimate - model["D"][s] @ du
        estimate = model["A"][s] @ estimate + model["B"][s] @ du - model["G"][s] @ innovation
        x = truth["A"][s] @ x + truth["B"][s] @ true_u
        inputs.append(u)
        outputs.append(y)
    return np.array(inputs), np.array(outputs), cost


def test_simulated_loop_follows_a_reference(tokid, folder):
    tokid("example", "oscillator", "-o", folder / "wanted.npz", "--experiments", 1, "--steps", 30, "--seed", 3)
    tokid("example", "oscillator", "-o", folder / "other.npz", "--experiments", 40, "--steps", 30, "--seed", 9,
          "--process-noise", 0.1, "--measurement-noise", 0.1)
    tokid("identify", folder / "other.npz", "-o", folder / "truth.npz", "--states", 4, "--quiet")
    wanted, model, truth = (load(folder / f"{name}.npz") for name in ("wanted", "model", "truth"))
    call = ["lqr", folder / "model.npz", "--output-weight", 50, "--reference", folder / "wanted.npz", "-o",
            folder / "follow.npz", "--simulate", folder / "loop.npz", "--truth", folder / "truth.npz", "--u-min", "-0.4",
            "--u-max", "0.4,0.5"]
    report = tokid.json(*call, "--no-noise", "--experiments", 2)
    controller, loop, begin = load(folder / "follow.npz"), load(folder / "loop.npz"), int(model["k_begin"])
    assert np.array_equal(truth["state_dim"], model["state_dim"]) and truth["k_begin"] == begin
    reference = wanted["y"][0, begin:] - controller["y_nominal"]
    assert np.allclose(controller["y_reference"], reference, rtol=0, atol=1e-12 * np.abs(reference).max())
    u, y, cost = closed_loop(model, controller, truth, [-0.4, -0.4], [0.4, 0.5])
    assert np.max(u, axis=0).tolist() == [0.4, 0.5] and u.min() == -0.4
    scale = np.abs(y).max()
    for n in range(2):  # rounding errors of 30 steps
        assert np.allclose(loop["u"][n, begin:], u, rtol=0, atol=1e-10 * np.abs(u).max())
        assert np.allclose(loop["y"][n, begin:], y, rtol=0, atol=1e-10 * scale)
    assert np.allclose(report["simulation"]["cost"], cost, rtol=1e-9)
    assert report["simulation"]["standard_error"] <= 1e-9 * cost and report["reference"] == str(folder / "wanted.npz")


def test_differences_of_the_truth_are_reported(tokid, folder):
    model = load(folder / "model.npz")
    names = {"input_names": ["force", "torque"], "output_names": ["x", "angle"], "input_units": ["N", "N m"]}
    np.savez(folder / "named.npz", **{**model, **names})
    np.savez(folder / "differs.npz", **{**model, **names, "dt": 2 * model["dt"], "output_names": ["x", "phi"],
                                        "input_units": ["kN", "N m"]})
    call = ["lqr", folder / "named.npz", "-o", folder / "c.npz", "--simulate", folder / "loop.npz", "--truth"]
    assert tokid.json(*call, folder / "named.npz")["findings"] == []
    found = tokid.json(*call, folder / "differs.npz")
    assert [(f["kind"], f["detail"]) for f in found["findings"]] == [
        (kind, "truth") for kind in ("sample_time_differs", "output_names_differ", "units_differ")]
    assert "the truth's outputs are named x, phi, but the model's outputs are named x, angle" in found["warnings"]
    stderr = tokid(*call, folder / "differs.npz").stderr
    assert "the truth's dt = " in stderr and "has the unit kN, but this channel of the model has the unit N" in stderr


def test_simulated_cost_is_that_expected(tokid, folder):
    call = ["lqr", folder / "model.npz", "-o", folder / "c.npz", "--simulate", folder / "loop.csv", "--experiments", 400]
    report = tokid.json(*call, "--seed", 5)
    found, expected = report["simulation"], report["expected_cost"]["total"]
    costs = np.array(found["cost"])
    assert len(costs) == 400 and found["truth"] is None
    assert np.isclose(found["mean_cost"], costs.mean()) and np.isclose(found["standard_error"], costs.std(ddof=1) / 20)
    assert abs(found["mean_cost"] - expected) < 4 * found["standard_error"]  # of a fixed seed
    assert tokid.json(*call, "--seed", 6)["simulation"]["mean_cost"] != found["mean_cost"]
    assert "400 experiments on the model: mean cost" in tokid(*call).stdout
    assert (folder / "loop.csv").exists()


@pytest.mark.parametrize("words, message", [
    (["--reference", "data.npz"], "data.npz: 40 experiments found, one needed"),
    (["--reference", "short.npz"], "short.npz: 20 steps found, 30 needed, the end of the controller"),
    (["--reference", "gap.npz"], "gap.npz: a missing output found at step 12, all outputs of the steps"),
    (["--experiments", "3"], "--simulate"),
    (["--simulate", "model.npz"], "another file of this command has this name"),
    (["--simulate", "loop.npz", "--truth", "single.npz"], "truth: 1 inputs and 2 outputs found"),
    (["--simulate", "loop.npz", "--u-min", "1", "--u-max", "0"], "u_min: a limit above u_max found"),
    (["--simulate", "loop.npz", "--u-max", "1,2,3"], "--u-max: 3 numbers found")])
def test_refusals_of_the_loop(tokid, folder, words, message):
    tokid("example", "oscillator", "-o", folder / "short.npz", "--experiments", 1, "--steps", 20)
    tokid("example", "oscillator", "-o", folder / "gap.npz", "--experiments", 1, "--steps", 30)
    gap, model = load(folder / "gap.npz"), load(folder / "model.npz")
    gap["y"][0, 12, 1] = np.nan
    np.savez(folder / "gap.npz", **gap)
    inputs = {name: model[name][..., :1] for name in ("B", "D", "u_nominal") if name in model}
    kept = {name: value for name, value in model.items() if not name.startswith("input_")}
    np.savez(folder / "single.npz", **{**kept, **inputs})
    words = [folder / word if word.endswith(".npz") else word for word in words]
    refused = tokid("lqr", folder / "model.npz", *words, "-o", folder / "never.h5", status=2)
    assert message in refused.stderr and not (folder / "never.h5").exists()


def test_info(tokid, folder):
    report = tokid.json("lqr", folder / "model.npz", "--output-weight", "2,3", "--input-rate-weight", 0.5,
                        "--terminal-weight", 4, "-o", folder / "seen.h5")
    found = tokid.json("info", folder / "seen.h5")
    model = load(folder / "model.npz")
    assert found["kind"] == "controller" and found["model"] == "model.npz"
    assert (found["begin"], found["end"], found["inputs"], found["outputs"]) == (report["begin"], report["end"], 2, 2)
    assert found["state_dim"] == {"min": model["state_dim"][:-1].min(), "max": 4}
    assert found["output_weight"] == [[[2, 0], [0, 3]]] and found["input_rate_weight"] == [[[0.5, 0], [0, 0.5]]]
    assert found["terminal_weight"] == [[4, 0], [0, 4]]
    assert found["expected_cost"] == report["expected_cost"] and found["presumes_zero_state"] is False
    with h5py.File(folder / "seen.h5") as file:
        assert found["system"] == file["system"][()].decode()
    text = tokid("info", folder / "seen.h5").stdout
    for part in ("model.npz, state dimensions", "outputs 2, 3, inputs 1", "input rates 0.5", "last step: outputs 4 in addition",
                 "expected with the observer", "none: the nominal trajectory"):
        assert part in text
    without = {name: value for name, value in model.items() if name not in ("innovation_cov", "Q", "R", "K")}
    np.savez(folder / "quiet.npz", **without)
    tokid("lqr", folder / "quiet.npz", "-o", folder / "quiet.h5")
    assert tokid.json("info", folder / "quiet.h5")["expected_cost"] is None
    assert "not stored" in tokid("info", folder / "quiet.h5").stdout


def test_costs_that_are_not_finite_are_not_stored(tokid, folder):
    model = load(folder / "model.npz")
    np.savez(folder / "wild.npz", **{**model, "G": np.full_like(model["G"], 1e160)})  # its square overflows
    report = tokid.json("lqr", folder / "wild.npz", "-o", folder / "wild.h5")
    assert report["expected_cost"]["total"] is None
    text = tokid("lqr", folder / "wild.npz", "-o", folder / "wild.h5").stdout
    assert "Cost           not finite with the observer" in text and "with the nominal inputs" not in text
    assert tokid.json("info", folder / "wild.h5")["expected_cost"] is None


@pytest.mark.parametrize("name,value", [("controller_gain", np.nan), ("expected_cost", -1.0), ("expected_cost", np.inf),
                                        ("y_nominal", np.inf), ("output_weight", np.nan), ("dt", 0.0)])
def test_files_with_wrong_numbers_are_refused(tokid, folder, name, value):
    tokid("lqr", folder / "model.npz", "-o", folder / "right.npz")
    arrays = dict(np.load(folder / "right.npz"))
    np.savez(folder / "wrong.npz", **{**arrays, name: np.full_like(arrays[name], value)})
    assert f"data set '{name}': " in tokid("info", folder / "wrong.npz", status=2).stderr


def test_rows_of_costs(tokid, folder):
    model = load(folder / "model.npz")
    model.update(initial_state="unknown")
    np.savez(folder / "unknown.npz", **{name: value for name, value in model.items() if not name.startswith("x0_")})
    text = tokid("lqr", folder / "unknown.npz", "-o", folder / "unknown.h5").stdout
    places = [text.index(part) for part in ("expected with the observer", "with the nominal inputs alone", "This cost presumes")]
    assert places == sorted(places)


def test_files_of_another_kind(tokid, folder):
    tokid("lqr", folder / "model.npz", "-o", folder / "kind.h5")
    for words in (["simulate", folder / "kind.h5", folder / "data.npz", "-o", folder / "no.npz"],
                  ["simulate", folder / "model.npz", folder / "kind.h5", "-o", folder / "no.npz"],
                  ["convert", folder / "kind.h5", folder / "no.npz"],
                  ["lqr", folder / "kind.h5", "-o", folder / "no.h5"]):
        assert "kind.h5: a controller of tokid lqr found" in tokid(*words, status=2).stderr
