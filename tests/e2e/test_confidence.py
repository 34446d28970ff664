# SPDX-License-Identifier: BSD-3-Clause
"""confidence: bounds in files of every format, and calls that are refused."""

import re

import numpy as np
import pytest
import scipy.io
import h5py
from support import load, simulate

N, T = 60, 20


@pytest.fixture(scope="module")
def noisy(tokid, tmp_path_factory):
    directory = tmp_path_factory.mktemp("noisy")
    tokid("example", "oscillator", "-o", directory / "data.npz", "--experiments", N, "--steps", T,
          "--process-noise", 0.01, "--measurement-noise", 0.03)
    tokid("identify", directory / "data.npz", "-o", directory / "model.npz", "--lags", 3, "--states", 4,
          "--method", "tvera")
    return directory


def read(path):
    """Every format in NumPy's order of axes."""
    if path.suffix == ".npz":
        return load(path)
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            return {name: file[name][()] for name in file}
    found = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
    return {name: value.transpose(3, 2, 0, 1) if name.startswith("markov") else np.squeeze(value) if value.size == 1
            else value for name, value in found.items()}


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_bounds_surround_the_estimates(tokid, tmp_path, noisy, extension):
    path = tmp_path / f"bounds{extension}"
    result = tokid.json("confidence", noisy / "model.npz", noisy / "data.npz", "-o", path, "--replicates", 20,
                        "--band", 5)
    assert result["warnings"] == []
    assert (result["level"], result["experiments"], result["band"], result["replicates"]) == (0.95, N, 5, 20)
    bounds = read(path)
    assert bounds["markov"].shape == (T, 6, 2, 2)
    assert bounds["simulated"].shape == (N, T, 2)
    for name in ["markov", "simulated"]:
        lower, value, upper = bounds[f"{name}_lower"], bounds[name], bounds[f"{name}_upper"]
        known = ~np.isnan(value)
        assert known.any()
        assert (lower[known] < upper[known]).all()
        np.testing.assert_allclose(value[known], (lower + upper)[known] / 2, atol=1e-9)
    half = (bounds["markov_upper"] - bounds["markov_lower"]) / 2
    size = np.sqrt(np.nansum(bounds["markov"] ** 2, axis=(0, 1)))
    np.testing.assert_allclose(result["relative_error_limit"], np.sqrt(np.nansum(half**2, axis=(0, 1))) / size, rtol=1e-9)
    assert (np.array(result["relative_error"]) < result["relative_error_limit"]).all()
    model = load(noisy / "model.npz")
    # Markov parameters of the model: h_{k,k} = D_k, h_{k,k-1} = C_k B_{k-1}; none from before the first step.
    np.testing.assert_array_equal(np.isnan(bounds["markov"][0]).all(axis=(1, 2)), np.arange(6) > 0)
    first = np.einsum("kmn,knr->kmr", model["C"][1:], model["B"][:-1])
    inside = (bounds["markov_lower"][1:, 1] <= first) & (first <= bounds["markov_upper"][1:, 1])
    assert inside.mean() > 0.9
    # The estimates are the model's own.
    np.testing.assert_allclose(bounds["markov"][1:, 1], first, atol=1e-9)
    np.testing.assert_allclose(bounds["simulated"], simulate(model, load(noisy / "data.npz")["u"]), atol=1e-9)
    simple = bounds["eigenvalues_simple"] == 1
    assert simple.shape == bounds["eigenvalues_real"].shape == bounds["eigenvalues_imag_upper"].shape
    assert simple.shape[1] == 4
    np.testing.assert_array_equal(simple, np.isfinite(bounds["eigenvalues_real_upper"]))
    assert result["eigenvalues"] == {"total": simple.size, "bounded": simple.sum(),
                                     "zero": result["eigenvalues"]["zero"],
                                     "half_width": result["eigenvalues"]["half_width"]}


def test_the_noise_free_system_lies_within(tokid, tmp_path, noisy, oscillator):
    """Pulse responses of the exact model of the same system, by and large: p = 3 is nearly enough for this noise."""
    tokid("confidence", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "bounds.npz")
    bounds, exact = load(tmp_path / "bounds.npz"), load(oscillator / "model.npz")
    first = np.einsum("kmn,knr->kmr", exact["C"][1:T], exact["B"][:T - 1])
    inside = (bounds["markov_lower"][1:, 1] <= first) & (first <= bounds["markov_upper"][1:, 1])
    assert 0.85 < inside.mean() < 1


def test_held_out_experiments_are_left_aside(tokid, tmp_path, noisy):
    tokid("identify", noisy / "data.npz", "-o", tmp_path / "model.npz", "--lags", 3, "--states", 4, "--hold-out", 0.2,
          "--nominal", "mean", "--method", "tvera")
    result = tokid.json("confidence", tmp_path / "model.npz", noisy / "data.npz", "-o", tmp_path / "bounds.npz")
    assert (result["experiments"], result["warnings"]) == (48, [])
    assert load(tmp_path / "bounds.npz")["simulated"].shape == (48, T, 2)


def test_numbers_for_people(tokid, tmp_path, noisy):
    arguments = ["confidence", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "bounds.npz"]
    shown = tokid(*arguments, "--level", 0.99).stdout
    assert "relative errors of the pulse responses from noise: expected, 99 % limit" in shown
    for text in ("99 % for each value", f"from {N} experiments", "200 bootstrap replicates", "y1", "y2", str(tmp_path / "bounds.npz")):
        assert text in shown
    narrow, wide = (tokid.json(*arguments, "--level", level)["markov_half_width"][0] for level in (0.5, 0.99))
    assert wide["median"] > 3 * narrow["median"]
    assert wide["worst_steps"][0] == np.nanargmax(wide["per_step"])


def test_threads_and_seeds(tokid, tmp_path, noisy):
    def bounds(*options):
        tokid("confidence", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "bounds.npz",
              "--replicates", 10, *options)
        return load(tmp_path / "bounds.npz")["simulated_upper"]
    one = bounds()
    np.testing.assert_array_equal(one, bounds("--threads", 2))
    assert (one != bounds("--seed", 2)).any()


def test_other_data_are_remarked_on(tokid, tmp_path, noisy):
    tokid("example", "oscillator", "-o", tmp_path / "other.npz", "--experiments", N, "--steps", T, "--seed", 5,
          "--measurement-noise", 0.03)
    result = tokid("confidence", noisy / "model.npz", tmp_path / "other.npz", "-o", tmp_path / "bounds.npz")
    assert "bounds need the data of its identification" in result.stderr


@pytest.mark.parametrize("arguments,words", [
    (["--level", 0], ["--level", "'0'"]),
    (["--level", 1], ["--level", "'1'"]),
    (["--level", 95], ["--level", "'95'"]),
    (["--replicates", 1], ["--replicates", "'1'", "2"]),
    (["--band", 0], ["--band", "'0'"]),
    (["--reference-step", T], ["reference frame", str(T)]),
])
def test_wrong_calls_are_refused(tokid, tmp_path, noisy, arguments, words):
    result = tokid("confidence", noisy / "model.npz", noisy / "data.npz", "-o", tmp_path / "bounds.npz", *arguments,
                   status=2)
    assert result.stdout == ""
    assert re.fullmatch(r"tokid: [^\n]+\n", result.stderr)
    for word in words:
        assert word in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_wrong_files_are_refused(tokid, tmp_path, noisy, oscillator):
    model, data, out = noisy / "model.npz", noisy / "data.npz", tmp_path / "bounds.npz"
    for arguments, words in [((model, oscillator / "fresh.npz", out), ["fresh.npz", "7 found", str(N)]),
                             ((data, model, out), ["data.npz", "model"]),
                             ((model, data, tmp_path / "bounds.csv"), ["bounds.csv", ".npz"]),
                             ((model, tmp_path / "missing.npz", out), ["missing.npz"])]:
        result = tokid("confidence", *arguments[:2], "-o", arguments[2], status=2)
        for word in words:
            assert word in result.stderr
        assert list(tmp_path.iterdir()) == []
