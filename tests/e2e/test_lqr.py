# SPDX-License-Identifier: BSD-3-Clause
"""tokid lqr: controllers in files."""

import h5py
import numpy as np
import pytest
import scipy.io


@pytest.fixture(scope="module")
def folder(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lqr")
    tokid("example", "oscillator", "-o", folder / "data.npz", "--experiments", 40, "--steps", 30, "--process-noise", 0.1,
          "--measurement-noise", 0.1)
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--states", 4, "--quiet")
    return folder


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
    (["--output-weight", "1,2,3"], "--output-weight: 3 numbers found, one or one for each of 2 channels needed"),
    (["--output-weight", "-1"], "numbers from 0 on needed"),
    (["--input-weight", "0"], "input: the sum of all weights on inputs is singular at step"),
    (["--end", "31"], "which the model has")])
def test_refusals(tokid, folder, words, message):
    refused = tokid("lqr", folder / "model.npz", *words, "-o", folder / "no.h5", status=2)
    assert message in refused.stderr and not (folder / "no.h5").exists()


def test_files_of_another_kind(tokid, folder):
    tokid("lqr", folder / "model.npz", "-o", folder / "kind.h5")
    for words in (["info", folder / "kind.h5"], ["simulate", folder / "kind.h5", folder / "data.npz", "-o",
                                                 folder / "no.npz"], ["lqr", folder / "kind.h5", "-o", folder / "no.h5"]):
        assert "kind.h5" in tokid(*words, status=2).stderr
    assert "a controller of tokid lqr found" in tokid("info", folder / "kind.h5", status=2).stderr
