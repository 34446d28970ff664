# SPDX-License-Identifier: BSD-3-Clause
"""The model's equations in NumPy, from the arrays of a model file, written independently of the library."""

import contextlib
import os

import h5py
import numpy as np


def load(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def markov(path, span=6):
    """h_{k,i} of all i < k < i + span, which no choice of coordinates changes, of a model in an .npz or .h5."""
    with (np.load if str(path).endswith(".npz") else h5py.File)(path) as model:
        A, B, C = (model[name][()] for name in "ABC")
    found = []
    for i in range(len(A) - span):
        x = B[i]
        for k in range(i + 1, i + span):
            found.append(C[k] @ x)
            x = A[k] @ x
    return np.array(found)


def _departures(model, name, values):
    values = values.copy()
    if f"{name}_nominal" in model:
        nominal = model[f"{name}_nominal"]
        values[:, :len(nominal)] -= nominal[:values.shape[1]]
    return values


def _with_nominal(model, y):
    if "y_nominal" in model:
        nominal = model["y_nominal"]
        y[:, :len(nominal)] += nominal[:y.shape[1]]
    return y


def simulate(model, u):
    """y (N, T, m) from the zero state at k_begin. The matrices are padded with zeros, which carry nothing."""
    u = _departures(model, "u", u)
    begin, (steps, outputs, states) = int(model["k_begin"]), model["C"].shape
    y = np.full((*u.shape[:2], outputs), np.nan)
    x = np.zeros((len(u), states))
    for k in range(begin, min(begin + steps, u.shape[1])):
        A, B, C, D = (model[name][k - begin] for name in "ABCD")
        y[:, k] = x @ C.T + u[:, k] @ D.T
        x = x @ A.T + u[:, k] @ B.T
    return _with_nominal(model, y)


def predict(model, u, y, horizon=1):
    """H-step predictions from zero initial states; before the horizon has passed, from the initial state."""
    u, y = _departures(model, "u", u), _departures(model, "y", y)
    begin, (steps, _, states) = int(model["k_begin"]), model["C"].shape
    end = min(begin + steps, u.shape[1])
    state = {begin: np.zeros((len(u), states))}
    for k in range(begin, end):
        A, B, C, D, G = (model[name][k - begin] for name in "ABCDG")
        innovation = y[:, k] - state[k] @ C.T - u[:, k] @ D.T
        innovation[np.isnan(innovation)] = 0.0  # a missing output corrects nothing
        state[k + 1] = state[k] @ A.T + u[:, k] @ B.T - innovation @ G.T
    predicted = np.full(y.shape, np.nan)
    for k in range(begin, end):
        j = max(begin, k - horizon + 1)
        x = state[j]
        for i in range(j, k):
            x = x @ model["A"][i - begin].T + u[:, i] @ model["B"][i - begin].T
        predicted[:, k] = x @ model["C"][k - begin].T + u[:, k] @ model["D"][k - begin].T
    return _with_nominal(model, predicted)


def fit(measured, computed, reference=None):
    """100 (1 - |y - computed| / |y - reference|) for each output, over the samples that both have."""
    result = []
    for j in range(measured.shape[2]):
        y, c = measured[..., j], computed[..., j]
        both = ~np.isnan(y) & ~np.isnan(c)
        r = np.broadcast_to(reference[:, j], y.shape)[both] if reference is not None else y[both].mean()
        result.append(100 * (1 - np.linalg.norm((y - c)[both]) / np.linalg.norm(y[both] - r)))
    return np.array(result)


def rmse(measured, computed):
    return np.sqrt(np.nanmean((measured - computed) ** 2, axis=(0, 1)))


def assert_close(found, expected, tolerance):
    """Equal up to `tolerance` times the largest value, and NaN in the same places."""
    assert found.shape == expected.shape
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    scale = np.nanmax(np.abs(expected))
    assert scale > 0
    assert np.nanmax(np.abs(found - expected)) <= tolerance * scale


def random_system(seed, steps, states, inputs, outputs):
    """Matrices of a time varying system that neither dies out nor explodes: A is orthogonal, turned a little each step."""
    rng = np.random.default_rng(seed)
    A, _ = np.linalg.qr(rng.standard_normal((steps, states, states)))
    return {"A": A, "B": rng.standard_normal((steps, states, inputs)),
            "C": rng.standard_normal((steps, outputs, states)), "D": rng.standard_normal((steps, outputs, inputs)),
            "k_begin": 0}


def write_ensemble(path, experiments=40, steps=600, noise=0.0, seed=5, **options):
    """Two states, one input, two outputs."""
    random = np.random.default_rng(seed)
    u = random.standard_normal((experiments, steps, 1))
    y = np.empty((experiments, steps, 2))
    x = np.zeros((experiments, 2))
    for k in range(steps):
        a = np.array([[0.8, 0.3], [-0.3 + 0.1 * np.sin(0.02 * k), 0.7]])
        y[:, k] = x @ np.array([[1.0, 0.2], [0.1, 1.0]])
        x = x @ a.T + u[:, k] @ np.array([[1.0, 0.5]])
    with h5py.File(path, "w") as file:
        file.create_dataset("u", data=u, **options)
        file.create_dataset("y", data=y + noise * random.standard_normal(y.shape), **options)
        file["initial_state"] = "zero"
        file["output_names"] = ["angle", "rate"]
    return path


NOISE = ["--process-noise", 0.1, "--measurement-noise", 0.1]


def identified(tokid, folder, steps):
    """Write data.npz, 40 experiments of the oscillator with noise, and model.npz, identified from them."""
    tokid("example", "oscillator", "-o", folder / "data.npz", "--experiments", 40, "--steps", steps, *NOISE)
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--states", 4, "--quiet")
    return folder


def leftovers(folder):
    return sorted(name for name in os.listdir(folder) if name.endswith(".tmp"))


def links(folder):
    """Where the links in it lead to; some may be gone by now."""
    with contextlib.suppress(PermissionError, FileNotFoundError, ProcessLookupError):  # of a process that has ended
        for link in folder.iterdir():
            with contextlib.suppress(FileNotFoundError):
                yield os.readlink(link)
