# SPDX-License-Identifier: BSD-3-Clause
"""What no fault may leave: half a result. Processes that are killed at any time, disks that are full or read-only,
files that others shorten while they are read."""

import errno
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from faults import UNCOUNTED, dying_at, failing_at, room, without_unnamed_files
from support import leftovers, links, write_ensemble

OLD = b"what was there before"


@pytest.fixture(scope="module")
def campaign(tokid, tmp_path_factory):
    """Data, a model and a state of them, later experiments; long.h5 is for blocks."""
    folder = tmp_path_factory.mktemp("campaign")
    tokid("example", "oscillator", "-o", folder / "all.npz", "--experiments", 50, "--steps", 120)
    with np.load(folder / "all.npz") as file:
        whole = dict(file)
    for name, part in ("data", slice(0, 40)), ("later", slice(40, 50)):
        np.savez(folder / f"{name}.npz", **{k: v[part] if k in ("u", "y") else v for k, v in whole.items()})
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--state", folder / "state.h5")
    write_ensemble(folder / "long.h5")
    return folder


BLOCKS = ["identify", "long.h5", "-o", "out.h5", "--block", "60", "--lags", "2"]
UPDATE = ["update", "state.h5", "later.npz", "-o", "out.npz"]
COMMANDS = {
    "identify": ["identify", "data.npz", "-o", "out.h5"],
    "identify-page-state": ["identify", "data.npz", "-o", "out.npz", "--state", "kept.npz", "--report", "page.html"],
    "blocks": BLOCKS,
    "update": UPDATE,
    "to-npz": ["convert", "long.h5", "out.npz"],
    "to-h5": ["convert", "data.npz", "out.h5"],
    "to-mat": ["convert", "data.npz", "out.mat"],
    "to-mat73": ["convert", "data.npz", "out.mat", "--mat73"],
    "to-csv": ["convert", "data.npz", "out.csv"],
    "model-to-mat": ["convert", "model.npz", "out.mat"],
    "simulate": ["simulate", "model.npz", "data.npz", "-o", "out.npz"],
    "report": ["report", "model.npz", "data.npz", "-o", "out.html"],
}


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


class Scene:
    """A folder with all that one command needs, and what the command makes of it."""

    def __init__(self, tokid, campaign, folder, arguments):
        self.folder = folder
        self.command = [tokid.executable, *arguments]
        self.needed = {word: (campaign / word).read_bytes() for word in arguments if (campaign / word).is_file()}
        self.reset()
        begin = time.monotonic()
        result = self.run()
        assert result.returncode == 0, result.stderr
        self.seconds = time.monotonic() - begin
        self.done = contents(folder)
        self.written = {name: content for name, content in self.done.items() if self.needed.get(name) != content}

    def run(self, **options):
        return subprocess.run(self.command, cwd=self.folder, capture_output=True, text=True, **options)

    def reset(self, **old):
        for path in self.folder.iterdir():
            path.unlink()
        for name, content in (old | self.needed).items():
            (self.folder / name).write_bytes(content)
        self.before = contents(self.folder)

    def found(self):
        """What became of each file that the command writes: "new", "old" or "absent"; nothing else is there."""
        now = contents(self.folder)
        result = {}
        for name, new in self.written.items():
            assert now.get(name) in (new, self.before.get(name)), f"{name} is neither old nor new"
            result[name] = "new" if now.get(name) == new else "old" if name in self.before else "absent"
        for name in self.needed.keys() - self.written.keys():
            assert now[name] == self.needed[name]
        # Between a link and a rename what is whole already has another name, which the next call takes away.
        assert all(name.startswith(".tokid-") for name in now.keys() - self.done.keys())
        return result


KILLS = 9  # of each of twelve commands: more than a hundred


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_any_time(tokid, campaign, tmp_path, name):
    """Most of the times towards the end, where files are written."""
    scene = Scene(tokid, campaign, tmp_path, COMMANDS[name])
    dice = random.Random(name)
    tally = Counter()
    end = scene.seconds
    for i in range(100):
        scene.reset(**(dict.fromkeys(scene.written, OLD) if i % 2 else {}))
        process = subprocess.Popen(scene.command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   env=os.environ | UNCOUNTED)
        time.sleep(end * dice.uniform(0.0 if i % 12 < 5 else 0.7, 1.0))
        process.send_signal({10: signal.SIGTERM, 11: signal.SIGINT}.get(i % 12, signal.SIGKILL))
        status = process.wait()
        found = scene.found()
        tally.update(["killed" if status < 0 else "finished", *found.values(), *(".tmp" for _ in leftovers(tmp_path))])
        if status >= 0:
            assert set(found.values()) == {"new"}
            end *= 0.95  # the machine has become faster
        if name == "update":  # the state never has experiments that the model lacks
            assert (found["state.h5"], found["out.npz"]) in [("old", "old"), ("old", "absent"), ("old", "new"),
                                                             ("new", "new")]
        if tally["killed"] == KILLS:
            break
    print(f"{name}: {dict(tally)}, {scene.seconds:.3f} s")
    assert tally["killed"] == KILLS
    if name == "update":
        scene.reset()
    assert scene.run().returncode == 0
    assert contents(tmp_path) == scene.done


@pytest.mark.parametrize("call", ["fsync", "linkat", "rename"])
def test_killed_where_names_are_given(tokid, campaign, tmp_path, call):
    """The state of update is replaced: linked to a name of its own, then renamed. The model is new: linked."""
    scene = Scene(tokid, campaign, tmp_path, UPDATE)
    scene.reset()
    assert scene.run(preexec_fn=dying_at(call)).returncode == -signal.SIGSYS
    assert scene.found() == {"state.h5": "old", "out.npz": "new" if call == "rename" else "absent"}
    assert len(leftovers(tmp_path)) == (call == "rename")
    # The experiments can be added once more, to the same model; and what was left has gone.
    assert scene.run().returncode == 0
    assert contents(tmp_path) == scene.done


LEFT = Counter()
NAMED = ["identify", "blocks", "update", "to-npz", "to-mat", "to-csv"]


@pytest.mark.parametrize("name", NAMED)
def test_where_files_must_have_names(tokid, campaign, tmp_path, name):
    """What a killed process leaves on such a file system, the next call takes away; but not the file of another one."""
    scene = Scene(tokid, campaign, tmp_path, COMMANDS[name])
    named = without_unnamed_files()
    dice = random.Random(name)
    left = 0
    for _ in range(5):
        process = subprocess.Popen(scene.command, cwd=tmp_path, stdout=subprocess.DEVNULL, preexec_fn=named,
                                   stderr=subprocess.DEVNULL, env=os.environ | UNCOUNTED)
        time.sleep(scene.seconds * dice.uniform(0.5, 1.0))
        process.kill()
        process.wait()
        scene.found()
        left += len(leftovers(tmp_path))
    scene.reset(**{name: content for name, content in contents(tmp_path).items() if name.startswith(".tokid-")})
    assert scene.run(preexec_fn=named).returncode == 0
    assert contents(tmp_path) == scene.done
    print(f"{name}: {left} left and taken away")
    LEFT[name] = left


def test_something_was_left():
    if len(LEFT) < len(NAMED):
        pytest.skip("not all of the commands were killed in this run")
    assert LEFT.total() > 0


@pytest.mark.parametrize("name", ["identify", "blocks", "update", "to-npz"])
def test_where_nothing_can_be_linked(tokid, campaign, tmp_path, name):
    """What is finished is copied to a file with a name."""
    scene = Scene(tokid, campaign, tmp_path, COMMANDS[name])
    for old in {}, dict.fromkeys(scene.written, OLD):
        scene.reset(**old)
        result = scene.run(preexec_fn=failing_at("linkat", errno.EPERM))
        assert result.returncode == 0, result.stderr
        assert contents(tmp_path) == scene.done


def test_two_at_once_where_files_must_have_names(tokid, campaign, tmp_path):
    scene = Scene(tokid, campaign, tmp_path, COMMANDS["identify"])
    for _ in range(3):
        processes = [subprocess.Popen(scene.command, cwd=tmp_path, stdout=subprocess.DEVNULL,
                                      preexec_fn=without_unnamed_files()) for _ in range(3)]
        assert [process.wait() for process in processes] == [0, 0, 0]
        assert contents(tmp_path) == scene.done


# ---- no space, no permission ----

def refused(result, scene, reason):
    assert result.returncode == 1, result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith("tokid: ") and reason in line and any(name in line for name in scene.written)


@pytest.mark.parametrize("name", COMMANDS)
def test_files_may_not_be_so_large(tokid, campaign, tmp_path, name):
    scene = Scene(tokid, campaign, tmp_path, COMMANDS[name])
    for old in {}, dict.fromkeys(scene.written, OLD):
        scene.reset(**old)
        refused(scene.run(preexec_fn=room(8192)), scene, "File too large")
        assert contents(tmp_path) == scene.before


@pytest.mark.skipif("TOKID_SANITIZED" in os.environ, reason="sanitizers take more address space than any limit allows")
@pytest.mark.parametrize("output", ["out.h5", "out.mat", "out.npz"])
def test_no_memory_to_write(tokid, tmp_path, output):
    """The reason is that of the writing, where the reading still had enough."""
    write_ensemble(tmp_path / "data.h5", experiments=50, steps=10000)  # 12 MB
    found = Counter()
    for megabytes in range(40, 240, 4):
        def little(size=megabytes << 20):
            resource.setrlimit(resource.RLIMIT_AS, (size, size))

        result = subprocess.run([tokid.executable, "convert", "data.h5", output], cwd=tmp_path, capture_output=True,
                                text=True, preexec_fn=little)
        found[result.returncode] += 1
        if result.returncode == 0:
            break
        assert not (tmp_path / output).exists() and leftovers(tmp_path) == []
        if result.returncode == 1 and output in result.stderr:
            assert f"{output}: can't be written" in result.stderr, result.stderr
            found["written"] += 1
        else:
            assert output not in result.stderr, result.stderr
    print(output, dict(found))
    # An .npz and an .h5 are written from what has been read: they take no memory of their own.
    assert found[0] == 1 and (found["written"] > 0 or output != "out.mat")


@pytest.fixture(scope="module")
def private_mounts():
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True).returncode != 0:
        pytest.skip("unshare -rm: no disks of one's own may be mounted here")


ON_A_DISK = """
set -e
mount -t tmpfs -o size={size},mode=700 tmpfs "$1"
cp -a "$2"/. "$1"
[ -z "{ballast}" ] || head -c 1G /dev/zero >"$1/ballast" 2>/dev/null || true
[ -z "{read_only}" ] || mount -o remount,ro "$1"
cd "$1"
shift 2
status=0
"$@" || status=$?
[ -z "{ballast}" ] || rm ballast
cp -a . ../after
exit $status
"""


def run_on_a_disk(scene, disk, ballast="", read_only=""):
    """The command in a disk of its own, which holds what the scene does; its files are in `after` later."""
    after = disk / "after"
    shutil.rmtree(after, ignore_errors=True)
    (disk / "disk").mkdir(exist_ok=True)
    script = ON_A_DISK.format(size="8M", ballast=ballast, read_only=read_only)
    result = subprocess.run(["unshare", "-rm", "sh", "-c", script, "sh", disk / "disk", scene.folder, *scene.command],
                            capture_output=True, text=True)
    found = contents(after)
    found.pop("ballast", None)
    return result, found


@pytest.mark.parametrize("name", COMMANDS)
def test_full_and_read_only_disks(tokid, campaign, tmp_path, private_mounts, name):
    (tmp_path / "scene").mkdir()
    scene = Scene(tokid, campaign, tmp_path / "scene", COMMANDS[name])
    for old in {}, dict.fromkeys(scene.written, OLD):
        scene.reset(**old)
        for fault, reason in ("ballast", "No space left on device"), ("read_only", "Read-only file system"):
            result, found = run_on_a_disk(scene, tmp_path, **{fault: "yes"})
            refused(result, scene, reason)
            assert found == scene.before


def test_all_files_of_a_command_or_none(tokid, campaign, tmp_path):
    """A state that finds no room leaves no new model either."""
    scene = Scene(tokid, campaign, tmp_path, COMMANDS["identify-page-state"])
    sizes = sorted(len(content) for content in scene.written.values())
    scene.reset(**dict.fromkeys(scene.written, OLD))
    refused(scene.run(preexec_fn=room(sizes[-1] - 1)), scene, "File too large")
    assert contents(tmp_path) == scene.before


def test_a_folder_that_vanishes(tokid, campaign, tmp_path):
    (tmp_path / "gone").mkdir()
    process = subprocess.Popen([tokid.executable, "identify", campaign / "long.h5", "-o", tmp_path / "gone" / "out.h5",
                                "--block", "30", "--lags", "2"], stderr=subprocess.PIPE, text=True)
    descriptors = Path(f"/proc/{process.pid}/fd")
    while not any(link.startswith(f"{tmp_path / 'gone'}/") for link in links(descriptors)):
        assert process.poll() is None
    os.rmdir(tmp_path / "gone")
    _, errors = process.communicate()
    assert process.returncode == 1, errors
    assert "out.h5: can't be written: No such file or directory" in errors


# ---- files that change while they are read ----

@pytest.fixture(scope="module")
def large(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("large")
    write_ensemble(folder / "data.h5", experiments=60, steps=1500)
    for name in "data.npz", "data.mat", "data.csv":
        tokid("convert", folder / "data.h5", folder / name)
    return folder


def wait_until_read(process, file):
    """It is open twice then: for whoever reads it, and to see whether it stays as it is."""
    descriptors = Path(f"/proc/{process.pid}/fd")
    while process.poll() is None and list(links(descriptors)).count(str(file)) < 2:
        time.sleep(0.0005)


@pytest.mark.parametrize("name", ["data.npz", "data.mat", "data.csv", "data.h5"])
def test_files_that_become_shorter_while_they_are_read(tokid, large, tmp_path, name):
    """All of it, or a message: nothing is made of a part."""
    file, out = tmp_path / name, tmp_path / "out.h5"
    command = [tokid.executable, "convert", file, out]
    shutil.copy(large / name, file)
    begin = time.monotonic()
    subprocess.run(command, check=True, capture_output=True)
    seconds, whole = time.monotonic() - begin, out.read_bytes()
    dice = random.Random(name)
    tally = Counter()
    for i in range(12):
        shutil.copy(large / name, file)
        out.unlink(missing_ok=True)
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(seconds * dice.uniform(0.0, 0.8))
        wait_until_read(process, file)  # what is shorter before that is another file, and .csv may end anywhere
        os.truncate(file, int(dice.choice([0, 0.3, 0.9, 0.999]) * file.stat().st_size))
        _, errors = process.communicate()
        tally[process.returncode] += 1
        if process.returncode == 0:
            assert out.read_bytes() == whole
        else:
            assert process.returncode == 2 and not out.exists()
            (line,) = errors.splitlines()
            assert line.startswith(f"tokid: {file}: ")
    print(f"{name}: {dict(tally)}, {seconds:.3f} s")
    assert tally[2] > 0
    assert leftovers(tmp_path) == []
