# SPDX-License-Identifier: BSD-3-Clause
"""tokid learn: the inputs of the next run in a file."""

import numpy as np
import pytest
from support import NOISE, identified


@pytest.fixture(scope="module")
def folder(tokid, tmp_path_factory):
    folder = identified(tokid, tmp_path_factory.mktemp("learn"), 30)
    tokid("example", "oscillator", "-o", folder / "runs.npz", "--experiments", 3, "--steps", 30, "--seed", 2, *NOISE)
    tokid("example", "oscillator", "-o", folder / "wanted.npz", "--experiments", 1, "--steps", 30, "--seed", 3)
    return folder


def lifted(model):
    """The matrix from all inputs to all outputs, from rest."""
    steps, outputs, inputs = model["D"].shape
    h = np.zeros((steps, outputs, steps, inputs))
    for i in range(steps):
        h[i, :, i] = model["D"][i]
        response = model["B"][i]
        for k in range(i + 1, steps):
            h[k, :, i] = model["C"][k] @ response
            response = model["A"][k] @ response
    return h.reshape(steps * outputs, steps * inputs)


def solution(model, u, y, reference, error, own, change, rate):
    """Inputs that minimise the cost, the outputs that they are to give, and what rounding does to the inputs.

    `error`: weights of all errors, zero where an output is free. The others: weights of the channels."""
    h, steps = lifted(model), len(u) // 2
    difference = np.eye(2 * steps) - np.eye(2 * steps, k=-2)
    departures = np.diag(np.tile(own, steps)) + difference.T @ np.diag(np.tile(rate, steps)) @ difference
    left = h.T @ np.diag(error) @ h + departures + np.diag(np.tile(change, steps))
    step = np.linalg.solve(left, h.T @ (error * np.nan_to_num(reference - y)) - departures @ u)
    # A solution errs by the condition number times rounding of each of its sums.
    rounding = np.linalg.cond(left) * len(u) * np.finfo(float).eps * np.abs(u + step).max()
    return u + step, y + h @ step, rounding


def test_inputs_minimise_the_cost(tokid, folder):
    model, runs, wanted = (np.load(folder / name) for name in ("model.npz", "runs.npz", "wanted.npz"))
    assert np.all(model["state_dim"] == 4) and model["k_begin"] == 0 and "y_nominal" not in model
    found = tokid.json("learn", folder / "model.npz", folder / "runs.npz", folder / "wanted.npz", "--experiment", 1,
                       "--error-weight", "2,3", "--input-weight", 0.1, "--input-change-weight", 0.5,
                       "--input-rate-weight", "0.2,0.3", "-o", folder / "next.npz")
    u, y, reference = runs["u"][1].ravel(), runs["y"][1].ravel(), wanted["y"][0].ravel()
    error = np.tile([2.0, 3.0], 30)
    inputs, outputs, rounding = solution(model, u, y, reference, error, [0.1, 0.1], [0.5, 0.5], [0.2, 0.3])
    following = np.load(folder / "next.npz")
    assert following["u"].shape == (1, 30, 2)
    assert np.abs(following["u"][0].ravel() - inputs).max() <= rounding
    # Outputs err as the inputs do, times the gain, and by rounding of their own sums.
    gain = np.abs(lifted(model)).sum(axis=1).max()
    assert np.abs(following["y"][0].ravel() - outputs).max() <= 2 * gain * rounding
    assert found["experiment"] == 1 and found["warnings"] == []
    for key, values in (("error", y), ("predicted_error", outputs)):
        rms = np.sqrt(np.mean((reference - values).reshape(-1, 2) ** 2, axis=0))
        assert np.allclose(found[key], rms, rtol=0, atol=2 * gain * rounding)


def test_next_run_follows_the_reference(tokid, folder):
    shown = tokid("learn", folder / "model.npz", folder / "runs.npz", folder / "wanted.npz",
                  "--input-change-weight", 0.001, "-o", folder / "next.npz").stdout
    rows = [line.split() for line in shown.splitlines() if line.split()[:1] in (["y1"], ["y2"])]
    assert len(rows) == 2 and all(float(predicted) < float(last) for _, last, predicted in rows)
    assert f"{folder / 'runs.npz'}, experiment 2" in shown  # the last row


def test_missing_samples_of_the_reference_are_free(tokid, folder):
    wanted = dict(np.load(folder / "wanted.npz"))
    wanted["y"][0, :5, 0] = wanted["y"][0, :, 1] = np.nan  # the second output is free at all steps
    np.savez(folder / "part.npz", **wanted)
    tokid("learn", folder / "model.npz", folder / "runs.npz", folder / "part.npz", "--input-change-weight", 0.5, "-o",
          folder / "next.npz")
    model, runs = np.load(folder / "model.npz"), np.load(folder / "runs.npz")
    reference = wanted["y"][0].ravel()
    inputs, _, rounding = solution(model, runs["u"][2].ravel(), runs["y"][2].ravel(), reference,
                                   1.0 * ~np.isnan(reference), [0, 0], [0.5, 0.5], [0, 0])
    assert np.abs(np.load(folder / "next.npz")["u"][0].ravel() - inputs).max() <= rounding


def test_a_run_that_stopped_early(tokid, folder):
    """The next run is as long as the last one."""
    runs = {name: value[:1] for name, value in np.load(folder / "runs.npz").items() if name in ("u", "y")}
    np.savez(folder / "short_run.npz", u=runs["u"][:, :18], y=runs["y"][:, :18], dt=0.05)
    for name in ("u", "y"):
        runs[name][:, 18:] = np.nan
    np.savez(folder / "stopped.npz", **runs, dt=0.05, length=[18])
    wanted = dict(np.load(folder / "wanted.npz"))
    np.savez(folder / "short_wanted.npz", u=wanted["u"][:, :18], y=wanted["y"][:, :18], dt=0.05)
    for run, reference, following in (("stopped", "wanted", "a"), ("short_run", "short_wanted", "b")):
        tokid("learn", folder / "model.npz", folder / f"{run}.npz", folder / f"{reference}.npz",
              "--input-change-weight", 0.5, "-o", folder / f"{following}.npz")
    one, other = np.load(folder / "a.npz"), np.load(folder / "b.npz")
    assert one["u"].shape == (1, 18, 2) and np.array_equal(one["u"], other["u"]) and np.array_equal(one["y"], other["y"])


@pytest.mark.parametrize("words, message", [
    (["--experiment", 3, "--input-weight", 1], "--experiment 3 found, 0 to 2 needed"),
    (["--input-weight", "1,2,3"], "--input-weight: 3 numbers found, one for all channels, or one for each of 2 needed"),
    (["--error-weight", "-1"], "numbers from 0 on needed"),
    ([], "no weight on inputs found; --input-weight, --input-change-weight or --input-rate-weight needed"),
])
def test_wrong_options(tokid, folder, words, message):
    failed = tokid("learn", folder / "model.npz", folder / "runs.npz", folder / "wanted.npz", *words, "-o",
                   folder / "refused.npz", status=2)
    assert message in failed.stderr and not (folder / "refused.npz").exists()


def test_wrong_references(tokid, folder):
    call = ["learn", "--input-weight", 1, "-o", folder / "refused.npz", folder / "model.npz", folder / "runs.npz"]
    assert "3 experiments found, one needed" in tokid(*call, folder / "runs.npz", status=2).stderr
    tokid("example", "oscillator", "-o", folder / "short.npz", "--experiments", 1, "--steps", 20)
    refused = tokid(*call, folder / "short.npz", status=2).stderr
    assert f"{folder / 'short.npz'}: 20 steps found, 30 needed as in {folder / 'runs.npz'}" in refused
    assert "REFERENCE" in tokid(*call, status=2).stderr
    for outputs in (0, 1, 3):
        path = folder / f"{outputs}.npz"
        np.savez(path, u=np.ones((1, 30, 2)), y=np.ones((1, 30, outputs)))
        for command in (call, ["lqr", "-o", folder / "refused.npz", folder / "model.npz", "--reference"]):
            assert f"{path}: outputs: {outputs} found, the model has 2" in tokid(*command, path, status=2).stderr
    free = folder / "free.npz"
    np.savez(free, u=np.ones((1, 30, 2)), y=np.full((1, 30, 2), np.nan))
    assert f"{free}: reference: all samples" in tokid(*call, free, status=2).stderr
    assert not (folder / "refused.npz").exists()
