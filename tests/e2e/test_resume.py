# SPDX-License-Identifier: BSD-3-Clause
"""identify --resume: a call that was stopped goes on from the blocks that it had finished, to the same bits."""

import fcntl
import json
import os
import random
import shutil
import subprocess
import time

import h5py
import numpy as np
import pytest

from faults import UNCOUNTED, dying_at
from support import write_ensemble

BLOCKS = 10


@pytest.fixture(scope="module")
def given(tokid, tmp_path_factory):
    """data.h5, and the model that a call without --resume makes of it."""
    folder = tmp_path_factory.mktemp("given")
    write_ensemble(folder / "data.h5")
    told = tokid.json("identify", folder / "data.h5", "-o", folder / "model.h5", "--block", 60, "--lags", 2)
    assert told["resumed_blocks"] is None
    return folder


@pytest.fixture
def scene(given, tmp_path):
    shutil.copy2(given / "data.h5", tmp_path / "data.h5")
    return tmp_path


CALL = ["identify", "data.h5", "-o", "model.h5", "--block", "60", "--lags", "2", "--resume"]


def stopped(tokid, scene):
    """A call that has finished all blocks, but dies before the model has its name. Its journal."""
    result = subprocess.run([tokid.executable, *CALL, "--quiet"], cwd=scene, preexec_fn=dying_at("linkat"))
    assert result.returncode < 0
    assert sorted(os.listdir(scene)) == ["data.h5", "model.h5.resume"]
    return scene / "model.h5.resume"


def resumed(tokid, scene, *more):
    """How many blocks come from the journal."""
    result = tokid(*CALL, *more, "--json", cwd=scene)
    return json.loads(result.stdout)["resumed_blocks"]


def records(journal):
    """Where each of them begins, and the end of the last one."""
    content, at, found = journal.read_bytes(), 8, []
    while at < len(content):
        found.append(at)
        at += 16 + int.from_bytes(content[at:at + 8], "little")
    assert at == len(content)
    return [*found, at]


def test_a_call_that_was_not_stopped(tokid, given, scene):
    page = tokid(*CALL, cwd=scene).stdout
    assert "resumed" not in page
    assert (scene / "model.h5").read_bytes() == (given / "model.h5").read_bytes()
    assert sorted(os.listdir(scene)) == ["data.h5", "model.h5"]


@pytest.mark.parametrize("threads", [1, 2, 17])  # the last ones have all blocks at hand at once
def test_killed_again_and_again(tokid, given, tmp_path, threads):
    """Whenever the journal has grown, and a little later."""
    write_ensemble(tmp_path / "data.h5", experiments=100, steps=4000)
    command = [tokid.executable, "identify", "data.h5", "-o", "model.h5", "--block", "60", "--lags", "2"]
    subprocess.run([*command, "--quiet"], cwd=tmp_path, check=True)
    whole = (tmp_path / "model.h5").read_bytes()
    os.remove(tmp_path / "model.h5")
    journal = tmp_path / "model.h5.resume"
    dice = random.Random(threads)
    kills, kept = 0, bytes(1000)  # as long as what stands before the blocks
    while True:
        process = subprocess.Popen([*command, "--resume", "--json", "--threads", str(threads)], cwd=tmp_path,
                                   stdout=subprocess.PIPE, env=os.environ | UNCOUNTED)
        if kills < 6:
            while process.poll() is None and not (journal.exists() and journal.stat().st_size > len(kept)):
                time.sleep(0.001)
            time.sleep(dice.uniform(0.0, 0.02))
            process.kill()
        told = process.communicate()[0]
        if process.returncode == 0:
            break
        kills += 1
        if journal.exists():
            kept = journal.read_bytes()
            assert sorted(os.listdir(tmp_path)) == ["data.h5", "model.h5.resume"]
        else:  # killed after the model had its name: as if before
            (tmp_path / "model.h5").unlink()
            journal.write_bytes(kept)
    resumed_blocks = json.loads(told)["resumed_blocks"]
    assert kills > 0 and resumed_blocks > 0
    print(f"{kills} kills, then {resumed_blocks} blocks of 67")
    assert (tmp_path / "model.h5").read_bytes() == whole
    assert sorted(os.listdir(tmp_path)) == ["data.h5", "model.h5"]


@pytest.mark.parametrize("blocks", [0, 1, 7, BLOCKS])
def test_goes_on_behind_the_last_block_that_is_whole(tokid, given, scene, blocks):
    journal = stopped(tokid, scene)
    begins = records(journal)
    assert len(begins) == 1 + BLOCKS + 1  # what it is about, the blocks, the end
    content = journal.read_bytes()
    for more in 0, 7, 999:
        journal.write_bytes(content[:begins[1 + blocks] + more])
        assert resumed(tokid, scene, "--threads", 2) == blocks
        assert (scene / "model.h5").read_bytes() == (given / "model.h5").read_bytes()
        assert sorted(os.listdir(scene)) == ["data.h5", "model.h5"]


def test_noisy_blocks(tokid, tmp_path):
    write_ensemble(tmp_path / "data.h5", experiments=16, noise=0.1)
    call = ["identify", "data.h5", "-o", "model.h5", "--block", "200", "--lags", "2", "--states", "2", "--smoothing",
            "10", "--weighting", "one-step", "--no-refine", "--frame", "smooth", "--hold-out", "0.25"]
    tokid(*call, cwd=tmp_path)
    whole = (tmp_path / "model.h5").read_bytes()
    os.remove(tmp_path / "model.h5")
    subprocess.run([tokid.executable, *call, "--resume", "--quiet"], cwd=tmp_path, preexec_fn=dying_at("linkat"))
    journal = tmp_path / "model.h5.resume"
    os.truncate(journal, records(journal)[2])
    told = json.loads(tokid(*call, "--resume", "--json", cwd=tmp_path).stdout)
    assert (told["resumed_blocks"], told["held_out_experiments"]) == (1, 4)
    assert (tmp_path / "model.h5").read_bytes() == whole


@pytest.mark.parametrize("kept", [0, 3, 8, 20, 100])
def test_killed_while_the_journal_begins(tokid, given, scene, kept):
    os.truncate(stopped(tokid, scene), kept)
    assert resumed(tokid, scene) == 0
    assert (scene / "model.h5").read_bytes() == (given / "model.h5").read_bytes()


def test_says_that_it_was_resumed(tokid, scene):
    journal = stopped(tokid, scene)
    os.truncate(journal, records(journal)[5])
    assert "resumed after 4 of 10 blocks" in tokid(*CALL, cwd=scene).stdout


def test_damage_costs_what_lies_behind_it(tokid, given, scene):
    journal = stopped(tokid, scene)
    begins, content = records(journal), bytearray(journal.read_bytes())
    for block, place in ((3, 0), (3, 9), (6, 500)):
        damaged = content.copy()
        damaged[begins[1 + block] + place] ^= 1
        journal.write_bytes(damaged)
        assert resumed(tokid, scene) == block
        assert (scene / "model.h5").read_bytes() == (given / "model.h5").read_bytes()
    # Records at another place than theirs are no better.
    journal.write_bytes(content[:begins[2]] + content[begins[3]:])
    assert resumed(tokid, scene) == 1
    # As a power cut may leave it: as long as it should be, but without the bytes.
    journal.write_bytes(content[:begins[4]] + bytes(len(content) - begins[4]))
    assert resumed(tokid, scene) == 3
    assert (scene / "model.h5").read_bytes() == (given / "model.h5").read_bytes()


@pytest.mark.parametrize("change, words", [
    (["--lags", "3"], ["lags: 2 found, 3 needed"]),
    (["--block", "75"], ["blocks: 10 found, 8 needed"]),
    (["--no-refine", "--hold-out", "0.25"], ["hold_out: 0.0 found, 0.25 needed", "refine"]),
])
def test_a_journal_of_other_options_is_refused(tokid, scene, change, words):
    journal = stopped(tokid, scene)
    before = journal.read_bytes()
    call = [word for i, word in enumerate(CALL) if word not in change and CALL[i - 1] not in change]
    result = tokid(*call, *change, status=2, cwd=scene)
    for word in [*words, "model.h5.resume", "delete the journal to start anew"]:
        assert word in result.stderr
    assert journal.read_bytes() == before and not (scene / "model.h5").exists()


def test_a_journal_of_other_data_is_refused(tokid, scene):
    journal = stopped(tokid, scene)
    before, stat = journal.read_bytes(), (scene / "data.h5").stat()
    os.utime(scene / "data.h5", ns=(stat.st_atime_ns, stat.st_mtime_ns + 1))
    assert "time of the data" in tokid(*CALL, status=2, cwd=scene).stderr
    # Even where size and time are those of before, and the stretches that decide are the same.
    with h5py.File(scene / "data.h5", "a") as file:
        file["y"][3, 150, 1] *= 1 + 1e-14
    os.utime(scene / "data.h5", ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert (scene / "data.h5").stat().st_size == stat.st_size
    result = tokid(*CALL, status=2, cwd=scene)
    assert "change of the file" in result.stderr and "time of the data" not in result.stderr
    shutil.copy2(scene / "data.h5", scene / "other.h5")
    os.replace(scene / "other.h5", scene / "data.h5")
    assert "number of the file" in tokid(*CALL, status=2, cwd=scene).stderr
    assert journal.read_bytes() == before


def test_a_journal_is_of_the_file_that_was_read(tokid, scene):
    """Another file takes the name of the data while they are read: its blocks are none of the journal."""
    write_ensemble(scene / "other.h5", steps=2400, seed=9)
    write_ensemble(scene / "data.h5", steps=2400)
    process = subprocess.Popen([tokid.executable, *CALL, "--quiet"], cwd=scene)
    journal = scene / "model.h5.resume"
    while process.poll() is None and not journal.exists():
        time.sleep(0.0005)
    os.replace(scene / "other.h5", scene / "data.h5")
    process.kill()
    if process.wait() == 0:  # too late to be killed
        (scene / "model.h5").unlink()
    tokid("identify", "data.h5", "-o", "right.h5", "--block", "60", "--lags", "2", cwd=scene)
    result = subprocess.run([tokid.executable, *CALL, "--quiet"], cwd=scene, capture_output=True, text=True)
    if result.returncode == 0:  # nothing was kept
        assert (scene / "model.h5").read_bytes() == (scene / "right.h5").read_bytes()
    else:
        assert result.returncode == 2 and "number of the file" in result.stderr


def test_a_journal_without_blocks_stands_in_nobodys_way(tokid, scene):
    journal = stopped(tokid, scene)
    os.truncate(journal, records(journal)[1])
    call = [word if word != "2" else "3" for word in CALL]
    assert json.loads(tokid(*call, "--json", cwd=scene).stdout)["resumed_blocks"] == 0


def test_an_error_keeps_the_blocks_before_it(tokid, scene):
    """Of 40 blocks, the 30th has a sample that is none. Put right, it is another file."""
    write_ensemble(scene / "data.h5", steps=2400)
    with h5py.File(scene / "data.h5", "a") as file:
        right, file["y"][3, 1790, 1] = file["y"][3, 1790, 1], np.inf
    assert "infinite value in experiment 3 at step 1790" in tokid(*CALL, status=2, cwd=scene).stderr
    with h5py.File(scene / "data.h5", "a") as file:
        file["y"][3, 1790, 1] = right
    assert len(records(scene / "model.h5.resume")) == 1 + 29 + 1
    assert "time of the data" in tokid(*CALL, status=2, cwd=scene).stderr
    (scene / "model.h5.resume").unlink()
    assert resumed(tokid, scene) == 0


def test_what_is_no_journal_is_left_alone(tokid, scene):
    path = scene / "model.h5.resume"
    for content in b"hi", b"important", b"tokid has nothing to do with this file":
        path.write_bytes(content)
        assert "another file found" in tokid(*CALL, status=2, cwd=scene).stderr
        assert path.read_bytes() == content
    path.unlink()
    (scene / "important").write_bytes(b"important")
    path.symlink_to("important")
    assert "symbolic link" in tokid(*CALL, status=2, cwd=scene).stderr
    assert (scene / "important").read_bytes() == b"important"
    path.unlink()
    path.mkdir()
    assert "directory found" in tokid(*CALL, status=2, cwd=scene).stderr
    assert not (scene / "model.h5").exists()


def test_a_journal_that_is_in_the_way_shows_before_the_work(tokid, scene):
    """Data that are refused when they are looked at, after the journal."""
    with h5py.File(scene / "data.h5", "a") as file:
        file["y"][:, 100, 1] = np.inf
    (scene / "model.h5.resume").write_bytes(b"important")
    assert "another file found" in tokid(*CALL, status=2, cwd=scene).stderr
    (scene / "model.h5.resume").unlink()
    name = "m" * 247 + ".h5"  # which fits, but not with .resume
    call = [name if word == "model.h5" else word for word in CALL]
    assert "too long" in tokid(*call, status=1, cwd=scene).stderr
    assert os.listdir(scene) == ["data.h5"]


def test_a_call_that_fails_keeps_the_journal(tokid, given, scene):
    journal = stopped(tokid, scene)
    before = journal.read_bytes()
    with h5py.File(scene / "data.h5", "a") as file:
        file["y"][:, 100, 1] = np.inf
    tokid(*CALL, status=2, cwd=scene)
    assert journal.read_bytes() == before


def test_a_model_without_resume_takes_an_old_journal_away(tokid, given, scene):
    journal = stopped(tokid, scene)
    with open(journal, "r+b") as file:
        fcntl.lockf(file, fcntl.LOCK_EX)
        tokid(*CALL[:-1], cwd=scene)
        assert journal.exists()  # another process is at it
    tokid(*CALL[:-1], cwd=scene)
    assert sorted(os.listdir(scene)) == ["data.h5", "model.h5"]
    journal.write_bytes(b"important")
    tokid(*CALL[:-1], cwd=scene)
    assert journal.read_bytes() == b"important"


def test_two_calls_do_not_share_a_journal(tokid, given, scene):
    journal = stopped(tokid, scene)
    before = journal.read_bytes()
    with open(journal, "r+b") as file:
        fcntl.lockf(file, fcntl.LOCK_EX)
        result = tokid(*CALL, status=2, cwd=scene)
    assert "another process" in result.stderr
    assert journal.read_bytes() == before
    assert resumed(tokid, scene) == BLOCKS


def test_without_blocks_there_is_nothing_to_resume(tokid, given, scene):
    for call in (["data.h5"], ["data.h5", "--block", "all"]):
        result = tokid("identify", *call, "-o", "model.h5", "--resume", status=2, cwd=scene)
        assert "--resume" in result.stderr and "--block" in result.stderr
    tokid("identify", "data.h5", "-o", "model.npz", "--block", "60", "--resume", status=2, cwd=scene)
    assert os.listdir(scene) == ["data.h5"]


def test_a_call_that_fails_at_once_leaves_no_journal(tokid, scene):
    with h5py.File(scene / "data.h5", "a") as file:
        file["y"][:, 100, 1] = np.inf
    tokid(*CALL, status=2, cwd=scene)
    assert os.listdir(scene) == ["data.h5"]
