# SPDX-License-Identifier: BSD-3-Clause
"""identify --block: blocks of time from .h5, with the model of all steps at once, and files that appear whole or not at
all."""

import os
import re
import shutil
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest
import scipy.signal

from faults import room
from support import leftovers, markov, write_ensemble


@pytest.mark.parametrize("options", [{}, {"chunks": (7, 50, 1), "compression": "gzip"}, {"dtype": "f4"}],
                         ids=["contiguous", "compressed", "single"])
def test_same_model_as_from_all_steps(tokid, tmp_path, options):
    data = write_ensemble(tmp_path / "data.h5", **options)
    given = ["--lags", 2, "--states", 2, "--method", "tvera"]
    whole = tokid.json("identify", data, "-o", tmp_path / "whole.h5", "--block", "all", *given)
    blocks = tokid.json("identify", data, "-o", tmp_path / "blocks.h5", "--block", 90, *given)
    assert whole["block"] is None
    assert 0 < blocks["block"] <= 90
    for key in set(whole) - {"block", "model", "seconds", "one_step_fit", "simulation_fit", "condition_max",
                             "singular_value_gap", "lag_order_errors", "nominal_test", "whiteness_p", "warnings",
                             "feedthrough_choice", "verdict", "no_verdict"}:
        assert blocks[key] == whole[key], key
    assert blocks["feedthrough_choice"]["reason"] == whole["feedthrough_choice"]["reason"]
    assert blocks["one_step_fit"] == pytest.approx(whole["one_step_fit"], abs=1e-4)
    # Rounded samples leave their rounding errors to each of the two.
    tolerance = 1e-4 if options.get("dtype") == "f4" else 1e-9
    assert np.abs(markov(tmp_path / "blocks.h5") - markov(tmp_path / "whole.h5")).max() < tolerance
    with h5py.File(tmp_path / "whole.h5") as a, h5py.File(tmp_path / "blocks.h5") as b:
        assert {name: a[name].shape for name in a} == {name: b[name].shape for name in b}
    tokid("validate", tmp_path / "blocks.h5", data)
    assert leftovers(tmp_path) == []


def test_same_bytes_however_they_are_stored(tokid, tmp_path):
    """Blocks that end within chunks."""
    options = ("--block", 90, "--lags", 2, "--states", 2, "--method", "tvera")
    write_ensemble(tmp_path / "plain.h5")
    with h5py.File(tmp_path / "plain.h5") as file:
        values = {name: file[name][()] for name in file}
    tokid("identify", tmp_path / "plain.h5", "-o", tmp_path / "model.h5", *options)
    expected = (tmp_path / "model.h5").read_bytes()

    def creation_with(chunks, *filters):
        creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        creation.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        creation.set_chunk(chunks)
        for number, parameters in filters:
            creation.set_filter(number, 0, parameters)
        return creation

    shuffle, gzip = (h5py.h5z.FILTER_SHUFFLE, (8,)), (h5py.h5z.FILTER_DEFLATE, (4,))
    fletcher32 = (h5py.h5z.FILTER_FLETCHER32, ())
    for chunks, filters in (((10, 100, 1), ()), ((10, 100, 1), (gzip,)), ((5, 50, 1), (shuffle, gzip, fletcher32)),
                            ((1, 20, 1), (shuffle, gzip)), ((2, 25, 1), (fletcher32,))):
        with h5py.File(tmp_path / "data.h5", "w") as file:
            for name, array in values.items():
                if name not in "uy":
                    file[name] = array
                    continue
                space, creation = h5py.h5s.create_simple(array.shape), creation_with(chunks, *filters)
                data = h5py.Dataset(h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, space, creation))
                data[...] = array
        tokid("identify", tmp_path / "data.h5", "-o", tmp_path / "model.h5", *options)
        assert (tmp_path / "model.h5").read_bytes() == expected, (chunks, filters)


def test_same_bytes_for_any_number_of_threads(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5")
    for threads in (1, 3):
        tokid("identify", data, "-o", tmp_path / f"{threads}.h5", "--block", 60, "--threads", threads)
    assert (tmp_path / "1.h5").read_bytes() == (tmp_path / "3.h5").read_bytes()


def peak_memory(command):
    """[kB] of a process that succeeds. What wait4 tells counts the memory of the Python that it comes from."""
    peak = 0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            with open(f"/proc/{process.pid}/status") as status:
                found = re.search(r"^Name:\s+tokid\n.*^VmHWM:\s+(\d+)", status.read(), re.MULTILINE | re.DOTALL)
            peak = max(peak, int(found[1]) if found else 0)
            time.sleep(0.005)
    assert process.returncode == 0
    return peak


@pytest.mark.skipif("TOKID_SANITIZED" in os.environ, reason="sanitizers keep what is freed for a while")
def test_memory_does_not_grow_with_time(tokid, tmp_path):
    peaks = []
    for steps in (2000, 8000):  # 64 and 256 MB of samples
        path = tmp_path / "data.h5"
        random = np.random.default_rng(1)
        with h5py.File(path, "w") as file:
            u, y = (file.create_dataset(name, (1000, steps, 2), "f8") for name in "uy")
            before = np.zeros((1000, 1, 2))
            for k in range(0, steps, 500):
                u[:, k:k + 500] = samples = random.standard_normal((1000, 500, 2))
                y[:, k:k + 500] = np.concatenate([before, samples[:, :-1]], axis=1)
                before = samples[:, -1:]
            file["initial_state"] = "zero"
        peaks.append(peak_memory([tokid.executable, "identify", path, "-o", tmp_path / "model.h5", "--block", "200",
                                  "--quiet"]))
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < 200_000  # kB: the first steps, which decide, have 16 MB


@pytest.mark.skipif("TOKID_SANITIZED" in os.environ, reason="sanitizers keep what is freed for a while")
def test_memory_without_blocks(tokid, tmp_path):
    """Without noise, at most four times the samples."""
    peaks = []
    for steps in (50_000, 250_000):  # 8 and 40 MB of samples
        u = np.random.default_rng(2).standard_normal((10, steps, 1))
        gain = 1 + 0.5 * np.sin(np.arange(steps) / 300)
        y = scipy.signal.lfilter([0, 1, 0.5], [1, -1.2, 0.5], gain * u[:, :, 0])
        np.savez(tmp_path / "data.npz", u=u, y=y[:, :, None], dt=0.1, initial_state="zero")
        command = [tokid.executable, "identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--quiet"]
        peaks.append(1024 * peak_memory(command))
    assert peaks[1] - peaks[0] < 4 * 32e6


@pytest.mark.parametrize("arguments, words", [
    (["--block", "0"], ["--block", "'0' found"]),
    (["--block", "4"], ["data.h5", "block: 4 steps found", "needed"]),
    (["--block", "100", "--period", "5"], ["period: 5 found", "needs all steps at once"]),
    (["--block", "100", "--time-invariant"], ["period: 1 found"]),
    (["--block", "100", "--smoothing", "infinity"], ["smoothing: infinity found"]),
    (["--block", "100", "--frame", "reference"], ["frame: reference found", "raw or smooth"]),
    (["--block", "100", "--report", "page.html"], ["--report", "--block"]),
    (["--block", "100", "-o", "model.npz"], ["model.npz", "'.npz' found", "tokid convert"]),
])
def test_refused_calls(tokid, tmp_path, arguments, words):
    write_ensemble(tmp_path / "data.h5")
    output = [] if "-o" in arguments else ["-o", "model.h5"]
    result = tokid("identify", "data.h5", *output, *arguments, status=2, cwd=tmp_path)
    for word in words:
        assert word in result.stderr
    assert sorted(os.listdir(tmp_path)) == ["data.h5"]


def test_other_formats_are_not_read_in_blocks(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5")
    for name in ("data.npz", "data.mat"):
        tokid("convert", data, tmp_path / name)
        result = tokid("identify", tmp_path / name, "-o", tmp_path / "model.h5", "--block", 100, status=2)
        assert name in result.stderr and "--block" in result.stderr and "an .h5 needed" in result.stderr
    result = tokid("identify", tmp_path / "none.npz", "-o", tmp_path / "model.h5", "--block", 100, status=2)
    assert "none.npz: no such file" in result.stderr
    tokid("convert", data, tmp_path / "mat.mat", "--mat73")
    shutil.copy(tmp_path / "mat.mat", tmp_path / "mat.h5")
    result = tokid("identify", tmp_path / "mat.h5", "-o", tmp_path / "model.h5", "--block", 100, status=2)
    assert "MATLAB" in result.stderr
    tokid("identify", tmp_path / "mat.h5", "-o", tmp_path / "model.h5")


def test_broken_samples_are_named(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5")
    with h5py.File(data, "a") as file:
        file["y"][3, 400, 1] = np.inf
    result = tokid("identify", data, "-o", tmp_path / "model.h5", "--block", 100, "--lags", 2, status=2)
    assert "output rate: infinite value in experiment 3 at step 400" in result.stderr
    with h5py.File(data, "a") as file:
        file["y"][:, :, 1] = np.nan
    result = tokid("identify", data, "-o", tmp_path / "model.h5", "--block", 100, status=2)
    assert "samples are missing" in result.stderr
    assert sorted(os.listdir(tmp_path)) == ["data.h5"]


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.95])
def test_truncated_files(tokid, tmp_path, kept):
    data = write_ensemble(tmp_path / "data.h5", chunks=(40, 50, 1))
    os.truncate(data, int(kept * data.stat().st_size))
    result = tokid("identify", data, "-o", tmp_path / "model.h5", "--block", 100, status=2)
    assert "data.h5" in result.stderr
    assert sorted(os.listdir(tmp_path)) == ["data.h5"]


def test_no_room_for_the_model(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5", experiments=20, steps=3000)

    result = tokid("identify", data, "-o", tmp_path / "model.h5", "--block", 200, status=1, preexec_fn=room(300_000))
    assert "can't be written: File too large" in result.stderr
    assert sorted(os.listdir(tmp_path)) == ["data.h5"]


def writes(pid):
    """Has the process begun to keep blocks of a model?"""
    with os.scandir(f"/proc/{pid}/fd") as files:
        return any("(deleted)" in os.readlink(file.path) for file in files)


def test_what_is_killed_leaves_nothing(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5", experiments=200, steps=6000)
    with subprocess.Popen([tokid.executable, "identify", data, "-o", tmp_path / "model.h5", "--block", "60",
                           "--quiet"]) as process:
        while not writes(process.pid):
            time.sleep(0.001)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    assert sorted(os.listdir(tmp_path)) == ["data.h5"]


def test_noisy_blocks(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5", steps=400, noise=0.1)
    given = ["--lags", 3, "--no-refine", "--hold-out", 0.25]
    found = tokid.json("identify", data, "-o", tmp_path / "blocks.h5", "--block", 200, *given)
    whole = tokid.json("identify", data, "-o", tmp_path / "whole.h5", *given)
    assert found["held_out_experiments"] == 10
    assert found["states"] == whole["states"]
    assert found["one_step_fit"] == pytest.approx(whole["one_step_fit"], abs=0.5)
    assert found["whiteness_p"] is not None


def test_a_wrong_experiment_is_told_without_noise(tokid, tmp_path):
    data = write_ensemble(tmp_path / "data.h5")
    call = ["identify", data, "-o", tmp_path / "model.h5", "--block", 200, "--states", 2, "--lags", 2, "--no-refine"]
    assert tokid.json(*call)["outliers"] == []
    with h5py.File(data, "a") as file:
        file["y"][7] *= -1
    found = tokid.json(*call)
    assert [other["experiment"] for other in found["outliers"]] == [7]
    assert any("in the first steps, on which tokid made its choices, experiment 7 does not fit the other experiments" in text for text in found["warnings"])
