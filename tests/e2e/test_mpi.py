# SPDX-License-Identifier: BSD-3-Clause
"""tokid-mpi: blocks shared by processes, with the same file for any number of them, or none where one of them dies."""

import os
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest

from support import leftovers, write_ensemble

pytestmark = pytest.mark.skipif("TOKID_MPI" not in os.environ, reason="built without MPI")

ENVIRONMENT = os.environ | {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_btl": "self,vader",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMPI_MCA_plm_rsh_agent": "false",
}


def command(processes, *arguments):
    return [os.environ.get("TOKID_MPIRUN", "mpirun"), "-n", str(processes), os.environ["TOKID_MPI"], *map(str, arguments)]


def mpi(processes, *arguments):
    return subprocess.run(command(processes, *arguments), env=ENVIRONMENT, capture_output=True, text=True, timeout=300)


def test_every_number_of_processes_writes_the_same_file(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", steps=900)
    alone = tmp_path / "alone.h5"
    subprocess.run([os.environ["TOKID"], "identify", data, "-o", alone, "--block", "70", "--quiet"], check=True)
    for processes in (1, 2, 4):
        model = tmp_path / f"model-{processes}.h5"
        result = mpi(processes, "identify", data, "-o", model, "--block", 70)
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("Written") == 1
        assert model.read_bytes() == alone.read_bytes()
    assert leftovers(tmp_path) == []


def test_processes_take_blocks_without_being_asked(tmp_path):
    data = write_ensemble(tmp_path / "data.h5", steps=300)
    result = mpi(2, "identify", data, "-o", tmp_path / "model.h5")
    assert result.returncode == 0, result.stderr
    assert "Blocks" in result.stdout


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
    assert sum(line.startswith("tokid: ") for line in result.stderr.splitlines()) == 1


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
