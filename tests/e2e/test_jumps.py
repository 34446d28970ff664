# SPDX-License-Identifier: BSD-3-Clause
"""Systems whose matrices jump at one step: found, stated, or denied."""

import h5py
import numpy as np
import plants
import pytest

AT = 30


def write(path, plant, count, seed):
    size = plants.noise(plant, 0.02, 0.01)
    u, y, _ = plants.experiments(plant, count, seed, *size)
    np.savez(path, u=u, y=y, dt=0.1, initial_state="zero")
    return path


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("jumps")
    write(folder / "fresh.npz", plants.valve(at=AT), 200, 2)
    return write(folder / "data.npz", plants.valve(at=AT), 30, 1)


@pytest.fixture(scope="module")
def found(tokid, data):
    return tokid.json("identify", data, "-o", data.with_name("found.npz"))


def one_step_misfit(tokid, data, name):
    validation = tokid.json("validate", data.with_name(name), data.with_name("fresh.npz"))
    return 100 - validation["one_step_fit"][0]


def test_a_jump_is_found(tokid, data, found):
    """Where it is, with significance, in text and JSON; and the model is better for it."""
    (jump,) = found["refinement"]["jumps"]
    assert jump["step"] == AT and jump["loss"] > 2
    assert {tuple(trial["jumps"]) for trial in found["refinement"]["trials"]} >= {(), (AT,)}
    text = tokid("identify", data, "-o", data.with_name("again.npz")).stdout
    assert f"Jumps          at step {AT} ({jump['loss']:.3g} standard errors), " in text
    none = tokid.json("identify", data, "-o", data.with_name("none.npz"), "--jumps", "none")
    assert none["refinement"]["jumps"] == []
    assert one_step_misfit(tokid, data, "found.npz") < 0.95 * one_step_misfit(tokid, data, "none.npz")


def tried(report):
    """The trials of EM: number of states, λ, iterations, jumps."""
    return [(t["states"], f"{t['smoothing']:.4g}", t["iterations"], *t["jumps"]) for t in report["refinement"]["trials"]]


def test_orders_that_are_much_worse_are_given_up(found):
    trials, best = found["refinement"]["trials"], found["refinement"]["states"]
    chosen = min(t["error"] for t in trials if t["states"] == best)
    worse = [t for t in trials if t["states"] != best and t["error"] > 2.5 * chosen]
    assert worse and max(t["iterations"] for t in worse) < 168


def test_a_stated_jump_is_used(tokid, data, found):
    stated = tokid.json("identify", data, "-o", data.with_name("stated.npz"), "--jumps", AT, "--states", 2, "--lags", 6)
    assert stated["refinement"]["jumps"] == [{"step": AT, "loss": None}]
    assert len(set(tried(stated))) == len(tried(stated))
    assert one_step_misfit(tokid, data, "stated.npz") < 1.02 * one_step_misfit(tokid, data, "found.npz")


def test_refine_keeps_the_jumps_of_the_model(tokid, data, found):
    """Without them, the penalty would smooth the jump over its neighbours."""
    tokid("refine", data.with_name("found.npz"), data, "-o", data.with_name("refined.npz"))
    assert one_step_misfit(tokid, data, "refined.npz") < 1.02 * one_step_misfit(tokid, data, "found.npz")


def test_refine_leaves_out_jumps_beyond_its_data(tokid, tmp_path, data, found):
    whole = np.load(data)
    np.savez(tmp_path / "short.npz", u=whole["u"][:, :AT - 5], y=whole["y"][:, :AT - 5], dt=0.1, initial_state="zero")
    tokid("refine", data.with_name("found.npz"), tmp_path / "short.npz", "-o", tmp_path / "refined.npz")


def long_record(folder, count, seed):
    """So long that only its middle decides, with a jump there."""
    return write(folder / "data.npz", plants.valve(steps=520, at=290), count, seed)


def test_jumps_of_long_records_have_the_steps_of_the_record(tokid, tmp_path):
    found = tokid.json("identify", long_record(tmp_path, 12, 5), "-o", tmp_path / "m.npz", "--states", 2, "--lags", 6)
    assert 290 in [jump["step"] for jump in found["refinement"]["jumps"]]
    assert len(set(tried(found))) == len(tried(found))


def test_stated_jumps_are_used_or_told(tokid, tmp_path):
    """Also outside the samples that decide. EM alone uses them, and with few experiments it may not help."""
    found = tokid.json("identify", long_record(tmp_path, 8, 4), "-o", tmp_path / "m.npz", "--states", 2, "--lags", 6,
                       "--jumps", "290,500")
    used = [jump["step"] for jump in found["refinement"]["jumps"]]
    told = any("the stated jumps at steps 290 and 500 are not used" in text for text in found["warnings"])
    assert (used, told) in (([290, 500], False), ([], True)), found["warnings"]


def test_blocks_have_no_jumps(tokid, data, tmp_path):
    with np.load(data) as whole, h5py.File(tmp_path / "data.h5", "w") as file:
        for name in ("u", "y"):
            file[name] = np.tile(whole[name][:8], (1, 10, 1))
        file["dt"] = 0.1
    tokid("identify", tmp_path / "data.h5", "-o", tmp_path / "m.h5", "--block", 200, "--lags", 6)
    with h5py.File(tmp_path / "m.h5") as model:
        options = model["options"][()].decode()
    assert '"jumps":[]' in options


def test_a_smooth_system_has_no_jumps(tokid, tmp_path):
    k = np.arange(60)[:, None, None]
    smooth = plants.drift(60)
    smooth.A = smooth.A * (1 - 0.1 * np.sin(0.1 * k) ** 2)
    report = tokid.json("identify", write(tmp_path / "data.npz", smooth, 30, 3), "-o", tmp_path / "model.npz")
    assert report["refinement"]["jumps"] == []


@pytest.mark.parametrize("options, complaint", [
    (["--jumps", "0"], "--jumps: '0' found, ascending steps from 1 to 1000000000, none or auto needed"),
    (["--jumps", "30,20"], "--jumps: '30,20' found, ascending steps"),
    (["--jumps", "60"], "jumps: 60 found, steps from 1 to 59 needed"),
    (["--jumps", "30", "--time-invariant"], "jumps: steps found, but the steps of a period share a model"),
    (["--jumps", "30", "--smoothing", "infinity"], "jumps: steps found, but one model serves all steps"),
    (["--jumps", "30", "--no-refine"], "jumps: steps found, which only EM uses"),
    (["--jumps", "30", "--method", "tvera"], "jumps: steps found, which only EM uses"),
])
def test_wrong_jumps_are_refused(tokid, data, tmp_path, options, complaint):
    answer = tokid("identify", data, "-o", tmp_path / "model.npz", *options, status=2)
    assert complaint in answer.stderr
