# SPDX-License-Identifier: BSD-3-Clause
"""Noisy experiments that were made of others are left out, and named; without noise nothing is."""

import numpy as np
import pytest

from support import load, random_system, simulate

def campaign(experiments, seed=3, noise=0.1, steps=60):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((experiments, steps, 1))
    y = simulate(random_system(11, steps, 3, 1, 2), u)
    return u, y + noise * y.std() * rng.standard_normal(y.shape)


def write(path, u, y, **more):
    np.savez(path, u=u, y=y, dt=0.1, initial_state="zero", **more)
    return path


def augmented(v):
    """20 experiments, sums of pairs, and doubles."""
    return np.concatenate([v, v[:10] + v[10:20], 2 * v[:10]])


def test_the_model_is_that_of_the_independent_experiments(tokid, tmp_path):
    u, y = campaign(20)
    own = write(tmp_path / "own.npz", u, y)
    made = write(tmp_path / "made.npz", augmented(u), augmented(y), experiment_names=[f"run {n}" for n in range(1, 41)])
    fresh = write(tmp_path / "fresh.npz", *campaign(30, seed=5, noise=0.0))
    plain = tokid.json("identify", own, "-o", tmp_path / "plain.npz", "--no-refine")
    found = tokid.json("identify", made, "-o", tmp_path / "found.npz", "--no-refine", "--report", tmp_path / "page.html")
    assert plain["dependent"] == [] and found["copies"] == []
    assert [c["experiment"] for c in found["dependent"]] == list(range(20, 40))
    assert [c["of"] for c in found["dependent"]] == [[n, n + 10] for n in range(10)] + [[n] for n in range(10)]
    assert np.allclose(found["dependent"][0]["weights"], [1, 1], rtol=1e-12)  # digits of a least squares solution
    assert np.allclose(found["dependent"][10]["weights"], [2], rtol=1e-12)
    said = ('20 of 40 experiments are sums or multiples of other experiments, within rounding: '
            'experiment "run 21" (row 20) of experiments "run 1" (row 0) and "run 11" (row 10); ')
    assert found["warnings"][0].startswith(said) and "; and 16 more experiments. These experiments add no information" in found["warnings"][0]
    assert found["experiments"] == 20 and found["states"] == plain["states"]
    model, expected = load(tmp_path / "found.npz"), load(tmp_path / "plain.npz")
    for name in "ABCDG":
        assert np.array_equal(model[name], expected[name])
    judged = tokid.json("validate", tmp_path / "found.npz", fresh)
    assert min(judged["simulation_fit"]) > 70  # noise of a tenth, in 20 experiments, without EM: 74
    assert "20 of 40 experiments are sums or multiples of other experiments" in (tmp_path / "page.html").read_text()

    # What was made of training experiments is on neither side of a fold, and judges no model.
    tokid("report", tmp_path / "found.npz", made, "-o", tmp_path / "again.html")
    assert "20 of 40 experiments are sums or multiples of other experiments" in (tmp_path / "again.html").read_text()
    again = tokid.json("validate", tmp_path / "found.npz", made, "--cross-validate", 3)
    once = tokid.json("validate", tmp_path / "plain.npz", own, "--cross-validate", 3)
    assert again["warnings"][0].startswith("20 of 40 experiments are sums or multiples of other experiments")
    assert again["simulation_fit"] == once["simulation_fit"]
    assert again["cross_validation"]["one_step_fit"] == once["cross_validation"]["one_step_fit"]
    assert max(max(fold["experiments"]) for fold in again["cross_validation"]["per_fold"]) == 19


@pytest.mark.parametrize("method", ["automatic", "subspace"])
def test_experiments_without_noise_are_all_used(tokid, tmp_path, method):
    u, y = campaign(20, noise=0.0)
    options = [] if method == "automatic" else ["--method", method]
    found = tokid.json("identify", write(tmp_path / "data.npz", augmented(u), augmented(y)), "-o", tmp_path / "model.npz",
                       *options)
    assert found["dependent"] == [] and found["experiments"] == 40
    assert min(found["simulation_fit"]) > 99.999


def test_blocks_report_them(tokid, tmp_path):
    u, y = campaign(20, steps=400)
    write(tmp_path / "made.npz", augmented(u), augmented(y))
    tokid("convert", tmp_path / "made.npz", tmp_path / "made.h5")
    found = tokid.json("identify", tmp_path / "made.h5", "-o", tmp_path / "model.h5", "--block", 200,
                       "--lags", 3, "--states", 3, "--no-refine")
    assert [c["experiment"] for c in found["dependent"]] == list(range(20, 40))
    assert any("are sums or multiples of other experiments" in text and "An identification in blocks uses these experiments" in text for text in found["warnings"])
