# SPDX-License-Identifier: BSD-3-Clause
"""refine: the likelihood grows, the model predicts better, and what it says is so in NumPy."""

import json

import numpy as np
import pytest
from support import load

NOISE = ["--process-noise", 0.1, "--measurement-noise", 0.3, "--steps", 40]


@pytest.fixture(scope="module")
def noisy(tokid, tmp_path_factory):
    directory = tmp_path_factory.mktemp("noisy")
    tokid("example", "oscillator", "-o", directory / "data.npz", "--experiments", 80, *NOISE)
    tokid("example", "oscillator", "-o", directory / "fresh.npz", "--experiments", 200, "--seed", 2, *NOISE)
    tokid("identify", directory / "data.npz", "-o", directory / "model.npz", "--states", 4, "--no-refine")
    return directory


def log_likelihood(model, data):
    """Kalman filter from the zero state, complete data."""
    total, (n, m) = 0.0, (model["A"].shape[1], model["C"].shape[1])
    x, P = np.zeros((len(data["u"]), n)), np.zeros((n, n))
    for k in range(data["u"].shape[1]):
        A, B, C, D, Q, R = (model[name][k] for name in "ABCDQR")
        u, y = data["u"][:, k], data["y"][:, k]
        S, e = C @ P @ C.T + R, y - x @ C.T - u @ D.T
        K = np.linalg.solve(S, C @ P).T
        np.testing.assert_allclose(model["K"][k], K, rtol=0, atol=1e-9 * (1 + abs(K).max()))
        total -= 0.5 * (len(e) * (np.linalg.slogdet(S)[1] + m * np.log(2 * np.pi)) + (e * np.linalg.solve(S, e.T).T).sum())
        x, P = (x + e @ K.T) @ A.T + u @ B.T, A @ (P - K @ S @ K.T) @ A.T + Q
    return total


@pytest.fixture(scope="module")
def refined(tokid, noisy):
    """The report; the model is noisy / "refined.npz"."""
    return tokid.json("refine", noisy / "model.npz", noisy / "data.npz", "-o", noisy / "refined.npz", "--smoothing", 0.3)


def one_step_rmse(tokid, model, data):
    return np.mean(tokid.json("validate", model, data)["one_step_rmse"])


def test_refine(tokid, noisy, refined):
    penalised = refined["penalised_log_likelihood"]
    assert len(penalised) == refined["iterations"] + 1
    assert all(b >= a for a, b in zip(penalised, penalised[1:]))
    assert refined["log_likelihood"][-1] > refined["start_log_likelihood"]
    assert refined["smoothing"] == 0.3 and refined["smoothing_choice"] is None
    model = load(noisy / "refined.npz")
    assert model["state_dim"].tolist() == [4] * 41
    assert str(model["method"]) == "em"
    assert json.loads(str(model["options"]))["refined"]["smoothing"] == 0.3
    found = log_likelihood(model, load(noisy / "data.npz"))
    assert found == pytest.approx(refined["log_likelihood"][-1], rel=1e-8)
    before, after = (one_step_rmse(tokid, noisy / name, noisy / "fresh.npz") for name in ("model.npz", "refined.npz"))
    assert after < before


def test_feedthrough_is_as_stated(tokid, noisy, tmp_path):
    start = noisy / "model.npz"
    for option, there in (("--no-feedthrough", False), ("--feedthrough", True)):
        tokid("refine", start, noisy / "data.npz", "-o", tmp_path / "r.npz", "--smoothing", 0.3, "--iterations", 2, option)
        assert load(tmp_path / "r.npz")["D"].any() == there
        start = tmp_path / "r.npz"


def test_every_format_has_the_same_model(tokid, noisy, tmp_path):
    models = []
    for extension in (".npz", ".h5", ".mat"):
        path = tmp_path / f"refined{extension}"
        tokid("refine", noisy / "model.npz", noisy / "data.npz", "-o", path, "--smoothing", 0.3, "--iterations", 2)
        models.append(tokid.arrays(path, tmp_path))
    for other in models[1:]:
        for name in "ABCDGKQR":
            np.testing.assert_array_equal(other[name], models[0][name])


def test_smoothing_is_chosen_and_remembered(tokid, noisy, tmp_path):
    first = tokid.json("refine", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "a.npz", "--iterations", 8)
    choice = first["smoothing_choice"]
    assert len(choice["candidates"]) == len(choice["log_likelihood"]) == len(choice["error"])
    assert choice["candidates"][0] == "infinity"
    assert first["smoothing"] in choice["candidates"]
    again = tokid.json("refine", tmp_path / "a.npz", noisy / "data.npz", "-o", tmp_path / "b.npz", "--iterations", 2)
    assert again["smoothing"] == first["smoothing"] and again["smoothing_choice"] is None


def test_threads_change_nothing(tokid, noisy, tmp_path):
    for threads in (1, 2):
        tokid("refine", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / f"{threads}.npz", "--smoothing", 1,
              "--iterations", 5, "--threads", threads)
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()


def test_missing_samples_and_the_text(tokid, noisy, refined, tmp_path):
    data = load(noisy / "data.npz")
    data["y"][np.random.default_rng(1).random(data["y"].shape) < 0.1] = np.nan
    np.savez(tmp_path / "gaps.npz", **data)
    result = tokid("refine", noisy / "model.npz", tmp_path / "gaps.npz", "-o", tmp_path / "r.npz", "--smoothing", 0.3)
    assert "log-likelihood" in result.stdout and "one step" in result.stdout
    assert all(isinstance(text, str) for text in refined["warnings"])
    errors = [one_step_rmse(tokid, path, noisy / "fresh.npz") for path in (tmp_path / "r.npz", noisy / "refined.npz")]
    assert errors[0] < 1.05 * errors[1]  # a tenth of the samples costs little


@pytest.mark.parametrize("arguments,words", [
    (["--smoothing", "-1"], ["--smoothing", "-1", "infinity"]),
    (["--smoothing", "much"], ["--smoothing", "much"]),
    (["--period", "0"], ["--period", "0"]),
    (["--iterations", "none"], ["--iterations", "none"]),
    (["--feedthrough", "--no-feedthrough"], ["--feedthrough", "--no-feedthrough"]),
])
def test_wrong_calls(tokid, noisy, tmp_path, arguments, words):
    result = tokid("refine", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "r.npz", *arguments, status=2)
    assert all(word in result.stderr for word in words)
    assert not (tmp_path / "r.npz").exists()


def test_wrong_data(tokid, noisy, tmp_path):
    data = load(noisy / "data.npz")
    np.savez(tmp_path / "narrow.npz", u=data["u"][:, :, :1], y=data["y"])
    result = tokid("refine", noisy / "model.npz", tmp_path / "narrow.npz", "-o", tmp_path / "r.npz", status=2)
    assert "narrow.npz" in result.stderr and "inputs: 1 found, the model has 2" in result.stderr
    tokid("refine", noisy / "data.npz", noisy / "data.npz", "-o", tmp_path / "r.npz", status=2)
    assert not (tmp_path / "r.npz").exists()
