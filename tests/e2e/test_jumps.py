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
    jumps = found["refinement"]["jumps"]
    assert AT in [jump["step"] for jump in jumps] and {jump["step"] for jump in jumps} <= {AT - 1, AT, AT + 1}
    assert min(jump["loss"] for jump in jumps) > 2.5
    text = tokid("identify", data, "-o", data.with_name("again.npz")).stdout
    assert "Jumps          at step" in text and f"{jumps[0]['step']} ({jumps[0]['loss']:.3g} standard errors), " in text
    none = tokid.json("identify", data, "-o", data.with_name("none.npz"), "--jumps", "none")
    assert none["refinement"]["jumps"] == []
    assert one_step_misfit(tokid, data, "found.npz") < 0.95 * one_step_misfit(tokid, data, "none.npz")


def test_regressions_use_jumps_too(tokid, data):
    """Without EM, also with a λ that would smooth the jump."""
    stiff = ["--no-refine", "--smoothing", 100]
    found = tokid.json("identify", data, "-o", data.with_name("alone.npz"), *stiff)
    assert AT in [jump["step"] for jump in found["refinement"]["jumps"]]
    tokid("identify", data, "-o", data.with_name("smeared.npz"), *stiff, "--jumps", "none")
    assert one_step_misfit(tokid, data, "alone.npz") < 0.95 * one_step_misfit(tokid, data, "smeared.npz")


def tried(report):
    """The trials of EM: number of states, λ, iterations."""
    return [(t["states"], f"{t['smoothing']:.4g}", t["iterations"]) for t in report["refinement"]["trials"]]


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


def test_stated_jumps_are_used(tokid, tmp_path):
    """Also outside the samples that decide."""
    found = tokid.json("identify", long_record(tmp_path, 8, 4), "-o", tmp_path / "m.npz", "--states", 2, "--lags", 6,
                       "--jumps", "290,500")
    assert [jump["step"] for jump in found["refinement"]["jumps"]] == [290, 500]


def test_blocks_have_no_jumps(tokid, data, tmp_path):
    with np.load(data) as whole, h5py.File(tmp_path / "data.h5", "w") as file:
        for name in ("u", "y"):
            file[name] = np.tile(whole[name][:8], (1, 10, 1))
        file["dt"] = 0.1
    tokid("identify", tmp_path / "data.h5", "-o", tmp_path / "m.h5", "--block", 200, "--lags", 6, "--states", 2,
          "--no-refine")
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
    (["--jumps", "30", "--method", "tvera"], "jumps: steps found, but each step has its own matrices"),
])
def test_wrong_jumps_are_refused(tokid, data, tmp_path, options, complaint):
    answer = tokid("identify", data, "-o", tmp_path / "model.npz", *options, status=2)
    assert complaint in answer.stderr
