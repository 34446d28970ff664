# SPDX-License-Identifier: BSD-3-Clause
"""tokid-mpi: work shared by processes, with the same files for any number of them, or none where one of them dies."""

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np
import pytest

from support import leftovers, links, markov, write_ensemble

pytestmark = pytest.mark.skipif("TOKID_MPI" not in os.environ, reason="built without MPI")

ENVIRONMENT = os.environ | {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_btl": "self,vader",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMPI_MCA_plm_rsh_agent": "false",
}


def command(processes, *arguments):
    """More processes than cores need slots, and cores of their own for none: Open MPI 4 and 5 both read these options."""
    return [os.environ.get("TOKID_MPIRUN", "mpirun"), "--host", f"localhost:{processes}", "--bind-to", "none",
            "-n", str(processes), os.environ["TOKID_MPI"], *map(str, arguments)]


def mpi(processes, *arguments):
    return subprocess.run(command(processes, *arguments), env=ENVIRONMENT, capture_output=True, text=True, timeout=300)


def said_by_tokid(errors):
    """Open MPI 5 ends messages of its own with a zero byte, in front of the next line."""
    return [line for line in (line.strip("\0 ") for line in errors.splitlines()) if line.startswith("tokid: ")]


@pytest.mark.parametrize("noise, options", [(0.0, ["--block", "70"]), (0.1, ["--block", "300", "--lags", "2", "--states", "2", "--no-refine"])],
                         ids=["exact", "noisy"])
def test_every_number_of_processes_writes_the_same_file(tmp_path, noise, options):
    """They share the blocks."""
    data = write_ensemble(tmp_path / "data.h5", steps=900, noise=noise)
    alone = tmp_path / "alone.h5"
    subprocess.run([os.environ["TOKID"], "identify", data, "-o", alone, "--quiet", *options], check=True)
    for processes in (1, 2, 4):
        model = tmp_path / f"model-{processes}.h5"
        result = mpi(processes, "identify", data, "-o", model, *options)
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("Written") == 1
        assert model.read_bytes() == alone.read_bytes()
    assert leftovers(tmp_path) == []


def test_processes_take_blocks_without_being_asked(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", steps=300)
    result = mpi(2, "identify", data, "-o", tmp_path / "model.h5")
    assert result.returncode == 0, result.stderr
    assert "Blocks" in result.stdout


def test_help_is_printed_once():
    result = mpi(2, "update", "--help")
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("Usage:") == 1


def test_other_commands_run_once(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", steps=50)
    result = mpi(2, "info", data)
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("Ensemble") == 1


@pytest.mark.parametrize("arguments, status", [(["nothing.h5", "-o", "model.h5"], 2), (["data.h5", "-o", "x", "--lags", "0"], 2)])
def test_what_is_wrong_for_all_is_said_once(tmp_path, arguments, status):
    result = subprocess.run(command(2, "identify", *arguments), cwd=tmp_path, env=ENVIRONMENT, capture_output=True,
                            text=True, timeout=300)
    assert result.returncode == status
    assert len(said_by_tokid(result.stderr)) == 1


def processes_below(parent):
    listed = subprocess.run(["ps", "-o", "pid=,comm=", "--ppid", str(parent)], capture_output=True, text=True).stdout
    return [int(line.split()[0]) for line in listed.splitlines() if "tokid" in line]


def test_a_process_that_dies_ends_the_job_without_a_file(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", experiments=200, steps=6000)
    model = tmp_path / "model.h5"
    job = subprocess.Popen(command(2, "identify", data, "-o", model, "--block", 60), env=ENVIRONMENT,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while len(ranks := processes_below(job.pid)) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(ranks) == 2
    # At work: Open MPI may wait for ever for one that dies while all of them begin.
    while str(data) not in links(Path(f"/proc/{ranks[1]}/fd")) and time.monotonic() < deadline:
        time.sleep(0.001)
    os.kill(ranks[1], signal.SIGKILL)
    _, errors = job.communicate(timeout=120)
    assert job.returncode != 0
    assert "signal 9" in errors
    assert not model.exists()
    assert leftovers(tmp_path) == []


def test_an_error_of_one_process_ends_all(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", experiments=20, steps=900)
    with h5py.File(data, "a") as file:
        file["y"][3, 500, 0] = np.inf
    result = mpi(2, "identify", data, "-o", tmp_path / "model.h5", "--block", 70, "--lags", 2)
    assert result.returncode == 2
    assert "infinite value in experiment 3 at step 500" in result.stderr
    assert not (tmp_path / "model.h5").exists()
    assert leftovers(tmp_path) == []


def portions(folder, sizes, begin=40, **options):
    """first.h5, a state of it, and so many more experiments in each of later-0.h5, later-1.h5 …"""
    whole = write_ensemble(folder / "all.h5", experiments=begin + sum(sizes), **options)
    bounds = np.cumsum([0, begin, *sizes])
    names = ["first.h5", *(f"later-{i}.h5" for i in range(len(sizes)))]
    with h5py.File(whole) as file:
        for name, (a, b) in zip(names, zip(bounds, bounds[1:])):
            with h5py.File(folder / name, "w") as part:
                for key in file:
                    part[key] = file[key][a:b] if key in ("u", "y") else file[key][()]
    tokid("identify", folder / "first.h5", "-o", folder / "first-model.h5", "--state", folder / "state.h5")
    return folder / "state.h5", [folder / name for name in names[1:]]


def tokid(*arguments):
    return subprocess.run([os.environ["TOKID"], *map(str, arguments)], check=True, capture_output=True, text=True)


def test_every_number_of_processes_updates_alike(tmp_path):
    """Five files: more than processes, and no multiple of their number."""
    state, later = portions(tmp_path, [3, 10, 1, 7, 5], steps=150)
    alone = tmp_path / "alone-state.h5"
    shutil.copy(state, alone)
    told = json.loads(tokid("update", alone, *later, "-o", tmp_path / "alone.h5", "--json").stdout)
    assert (told["experiments"], told["new_experiments"]) == (66, 26)
    for processes in (1, 2, 4):
        own, model = tmp_path / f"state-{processes}.h5", tmp_path / f"model-{processes}.h5"
        shutil.copy(state, own)
        result = mpi(processes, "update", own, *later, "-o", model, "--json")
        assert result.returncode == 0, result.stderr
        assert own.read_bytes() == alone.read_bytes()
        assert model.read_bytes() == (tmp_path / "alone.h5").read_bytes()
        own_told = json.loads(result.stdout)
        for name in "one_step_fit", "simulation_fit", "new_experiments", "data":
            assert own_told[name] == told[name]
    with h5py.File(state) as file:
        lags = int(file["lags"][()])
    tokid("identify", tmp_path / "all.h5", "-o", tmp_path / "whole.h5", "--lags", lags)
    updated, whole = markov(tmp_path / "alone.h5"), markov(tmp_path / "whole.h5")
    assert np.abs(updated - whole).max() <= 1e-10 * np.abs(whole).max()
    assert leftovers(tmp_path) == []


def test_concurrent_jobs_lose_nothing(tmp_path):
    state, later = portions(tmp_path, [3, 4, 5, 6], steps=60)
    with ExitStack() as stack:
        # Open MPI 4 fails where two jobs create or remove its folder for this user at the same time.
        folders = [stack.enter_context(tempfile.TemporaryDirectory()) for _ in range(2)]
        jobs = [subprocess.Popen(command(2, "update", state, *later[2 * i:2 * i + 2]), stdout=subprocess.DEVNULL,
                                 env=ENVIRONMENT | {"TMPDIR": folder}, stderr=subprocess.PIPE, text=True)
                for i, folder in enumerate(folders)]
        for job in jobs:
            _, errors = job.communicate(timeout=120)
            assert job.returncode == 0, errors
    with h5py.File(state) as file:
        assert file["experiments"][()] == 40 + 18
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_more_processes_than_files_update(tmp_path):
    state, later = portions(tmp_path, [4], steps=60)
    alone = tmp_path / "alone.h5"
    shutil.copy(state, alone)
    tokid("update", alone, *later)
    result = mpi(3, "update", state, *later)
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("Written") == 1
    assert state.read_bytes() == alone.read_bytes()


@pytest.mark.parametrize("wrong, reason", [(0, "infinite"), (1, "infinite"), (3, "infinite"), (2, "no such file")])
def test_a_file_that_does_not_fit_leaves_the_state_as_it_was(tmp_path, wrong, reason):
    state, later = portions(tmp_path, [3, 4, 5, 6], steps=60)
    before = state.read_bytes()
    if reason == "infinite":
        with h5py.File(later[wrong], "a") as file:
            file["y"][2, 50, 0] = np.inf
    else:
        later[wrong].unlink()
    result = mpi(2, "update", state, *later, "-o", tmp_path / "model.h5")
    assert result.returncode == 2
    said = said_by_tokid(result.stderr)
    assert len(said) == 1 and f"{later[wrong]}: " in said[0] and reason in said[0], result.stderr
    assert state.read_bytes() == before
    assert not (tmp_path / "model.h5").exists()
    assert leftovers(tmp_path) == []


def test_files_that_share_experiments_update_alike(tmp_path):
    """With a file of the same round, and with one of a round before."""
    state, later = portions(tmp_path, [6, 8, 5, 7, 3], steps=60)
    shared = [later[0], tmp_path / "of-two.h5", later[1], later[0], *later[2:]]
    with h5py.File(later[0]) as one, h5py.File(later[1]) as other, h5py.File(shared[1], "w") as both:
        for key in one:
            both[key] = np.concatenate([one[key][3:], other[key][:5]]) if key in ("u", "y") else one[key][()]
    alone = tmp_path / "alone.h5"
    shutil.copy(state, alone)
    told = json.loads(tokid("update", alone, *shared, "--json").stdout)
    assert (told["experiments"], told["new_experiments"]) == (40 + 29, 29)
    assert told["known_experiments"] == [[], [0, 1, 2], [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5], [], [], []]
    for processes in (2, 3):
        own = tmp_path / f"state-{processes}.h5"
        shutil.copy(state, own)
        result = mpi(processes, "update", own, *shared, "--json")
        assert result.returncode == 0, result.stderr
        assert own.read_bytes() == alone.read_bytes()
        found = json.loads(result.stdout)
        assert found["known_experiments"] == told["known_experiments"] and found["warnings"] == told["warnings"]
        assert found["simulation_fit"] == told["simulation_fit"]


def opened_by(process):
    try:
        return [os.readlink(f"/proc/{process}/fd/{fd}") for fd in os.listdir(f"/proc/{process}/fd")]
    except OSError:
        return []


def test_a_process_that_dies_while_it_reads_leaves_the_state_as_it_was(tmp_path):
    state, later = portions(tmp_path, [3, 1000], steps=3000)
    before = state.read_bytes()
    job = subprocess.Popen(command(2, "update", state, *later, "-o", tmp_path / "model.h5"), env=ENVIRONMENT,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline, ranks, reader = time.monotonic() + 60, [], None
    while len(ranks) < 2 and time.monotonic() < deadline:
        ranks = processes_below(job.pid)
    while reader is None and job.poll() is None and time.monotonic() < deadline:
        reader = next((rank for rank in ranks if str(later[1]) in opened_by(rank)), None)
    assert reader is not None
    os.kill(reader, signal.SIGKILL)
    _, errors = job.communicate(timeout=120)
    assert job.returncode != 0
    assert "signal 9" in errors
    assert state.read_bytes() == before
    assert not (tmp_path / "model.h5").exists()
    assert leftovers(tmp_path) == []
