# SPDX-License-Identifier: BSD-3-Clause
"""Experiments that are in the data twice are used once, however they were rounded."""

import h5py
import numpy as np
import pytest

from support import load, random_system, simulate


def campaign(experiments, seed=3, noise=0.02, steps=60):
    rng = np.random.default_rng(seed)
    system = random_system(7, steps, 3, 1, 2)
    u = rng.standard_normal((experiments, steps, 1))
    y = simulate(system, u)
    return u, y + noise * y.std() * rng.standard_normal(y.shape)


def write(path, u, y):
    np.savez(path, u=u, y=y, dt=0.1, initial_state="zero")
    return path


CHANGES = {
    "exact": lambda v, rng: v,
    "float32": lambda v, rng: v.astype(np.float32).astype(float),
    "five digits": lambda v, rng: np.vectorize(lambda x: float(f"{x:.5g}"))(v),
}


@pytest.fixture(scope="module", params=[0.0, 0.02])
def once(request, tokid, tmp_path_factory):
    """Experiments without and with noise, what is told of their model, its arrays and its folds."""
    folder = tmp_path_factory.mktemp("once")
    u, y = campaign(12, noise=request.param, steps=40)
    data = write(folder / "once.npz", u, y)
    told = tokid.json("identify", data, "-o", folder / "plain.npz", "--no-refine")
    own = tokid.json("validate", folder / "plain.npz", data, "--cross-validate", 3)["cross_validation"]
    return u, y, told, load(folder / "plain.npz"), own


@pytest.mark.parametrize("change", CHANGES)
def test_the_model_is_that_of_each_experiment_once(tokid, tmp_path, once, change):
    u, y, plain, expected, own = once
    rng = np.random.default_rng(1)
    twice = write(tmp_path / "twice.npz", *(np.concatenate([v, CHANGES[change](v, rng)]) for v in (u, y)))
    found = tokid.json("identify", twice, "-o", tmp_path / "found.npz", "--report", tmp_path / "page.html", "--no-refine")
    assert found["copies"] == [[n, 12 + n] for n in range(12)]
    assert found["warnings"][0].startswith("12 of 24 experiments are copies of other experiments, within rounding: "
                                           "experiment 12 of experiment 0; experiment 13 of experiment 1; ")
    assert found["experiments"] == 12 and found["states"] == plain["states"] and found["one_step_fit"] == plain["one_step_fit"]
    model = load(tmp_path / "found.npz")
    for name in "ABCDG":
        assert np.array_equal(model[name], expected[name])
    assert "12 of 24 experiments are copies of other experiments" in (tmp_path / "page.html").read_text()
    # The data are known as those of the identification, and folds share no experiment.
    tokid("report", tmp_path / "found.npz", twice, "-o", tmp_path / "again.html")
    assert "12 of 24 experiments are copies of other experiments" in (tmp_path / "again.html").read_text()
    folds = tokid.json("validate", tmp_path / "found.npz", twice, "--cross-validate", 3)["cross_validation"]
    assert folds["one_step_fit"] == own["one_step_fit"]


def test_validation_judges_each_experiment_once(tokid, tmp_path):
    u, y = campaign(24)
    tokid("identify", write(tmp_path / "data.npz", u, y), "-o", tmp_path / "model.npz", "--no-refine")
    fresh, fresh_y = campaign(12, seed=4)
    once = write(tmp_path / "once.npz", fresh, fresh_y)
    copied = write(tmp_path / "copied.npz", *(np.concatenate([v, v[:4], v[:4]]) for v in (fresh, fresh_y)))
    plain = tokid.json("validate", tmp_path / "model.npz", once)
    found = tokid.json("validate", tmp_path / "model.npz", copied)
    assert found["warnings"][0].startswith(
        "8 of 20 experiments are copies of other experiments, within rounding: experiments 12 and 16 of experiment 0; "
        "experiments 13 and 17 of experiment 1; ")
    assert not any("copies" in text for text in plain["warnings"])
    for name in ("one_step_fit", "simulation_fit", "whiteness_p", "nis", "samples"):
        assert found[name] == plain[name]


def test_text_with_few_digits(tokid, tmp_path):
    """A file of four decimals, in which some experiments come from others in single precision."""
    u, y = campaign(12)
    u, y = (np.concatenate([v, v[:5].astype(np.float32)]) for v in (u, y))
    with open(tmp_path / "data.csv", "w") as file:
        file.write("experiment,k,u1,y1,y2\n")
        for n in range(len(u)):
            for k in range(u.shape[1]):
                file.write(f"{n},{k},{u[n, k, 0]:.4f},{y[n, k, 0]:.4f},{y[n, k, 1]:.4f}\n")
    found = tokid.json("identify", tmp_path / "data.csv", "-o", tmp_path / "model.npz", "--no-refine")
    assert found["copies"] == [[n, 12 + n] for n in range(5)] and found["experiments"] == 12


@pytest.mark.parametrize("noise", [1e-1, 1e-3, 1e-5])
def test_repeated_designs_lose_no_experiment(tokid, tmp_path, noise):
    u, _ = campaign(5)
    u = np.tile(u, (10, 1, 1))
    y = simulate(random_system(7, 60, 3, 1, 2), u)
    y += noise * y.std() * np.random.default_rng(8).standard_normal(y.shape)
    found = tokid.json("identify", write(tmp_path / "data.npz", u, y), "-o", tmp_path / "model.npz", "--lags", 1, "--no-refine")
    assert found["copies"] == [] and found["experiments"] == 50


def test_updates_use_each_experiment_once(tokid, tmp_path):
    u, y = campaign(40)
    first, later = write(tmp_path / "first.npz", u[:24], y[:24]), write(tmp_path / "later.npz", u[24:], y[24:])
    twice = write(tmp_path / "twice.npz", np.tile(u[24:], (2, 1, 1)), np.tile(y[24:], (2, 1, 1)))
    for name, data in (("plain", later), ("found", twice)):
        tokid("identify", first, "-o", tmp_path / "model.npz", "--state", tmp_path / f"{name}.h5", "--no-refine")
        told = tokid.json("update", tmp_path / f"{name}.h5", data, "-o", tmp_path / f"{name}.npz")
        assert (told["new_experiments"], told["experiments"]) == (16, 40)
    assert "twice.npz: 16 of 32 experiments are copies of other experiments, within rounding: experiment 16 of experiment 0;" in told["warnings"][0]
    with h5py.File(tmp_path / "plain.h5") as plain, h5py.File(tmp_path / "found.h5") as found:
        assert np.array_equal(plain["window_factors"][()], found["window_factors"][()])


def test_remarks_on_the_file_are_kept_beside_copies(tokid, tmp_path):
    u, y = campaign(24)
    u, y = np.concatenate([u, u[:2]]), np.concatenate([y, y[:2]])
    names = [f"u{i + 1}" for i in range(u.shape[2])] + [f"y{j + 1}" for j in range(y.shape[2])]
    lines = ["experiment,k," + ",".join(names) + ",wind"]
    lines += [",".join([str(n), str(k), *map(repr, u[n, k].tolist() + y[n, k].tolist()), "0"])
              for n in range(len(u)) for k in range(u.shape[1])]
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    said = tokid("identify", tmp_path / "data.csv", "-o", tmp_path / "model.npz", "--no-refine").stderr
    assert "2 of 26 experiments are copies" in said and "wind" in said
