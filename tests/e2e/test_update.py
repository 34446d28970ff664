# SPDX-License-Identifier: BSD-3-Clause
"""identify --state, update: later experiments give the model of all of them; nothing is lost where something fails."""

import os
import shutil
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from support import markov


def copied(made, folder):
    """What several tests begin with, in the folder of one: states and models are changed there."""
    for file in made.iterdir():
        shutil.copy(file, folder)
    return folder


@pytest.fixture
def campaign(tokid, tmp_path):
    """60 experiments, and the same as 40 and 20; the 20 as 12 and 8, too."""
    tokid("example", "oscillator", "-o", tmp_path / "all.npz", "--experiments", 60, "--steps", 80, "--seed", 4)
    whole = dict(np.load(tmp_path / "all.npz"))
    for name, part in (("first", slice(0, 40)), ("later", slice(40, 60)), ("tuesday", slice(40, 52)),
                       ("wednesday", slice(52, 60))):
        np.savez(tmp_path / f"{name}.npz", **{k: v[part] if k in ("u", "y") else v for k, v in whole.items()})
    return tmp_path


@pytest.mark.parametrize("extension", ["h5", "npz", "mat"])
def test_the_model_is_that_of_all_experiments(tokid, campaign, extension):
    state = campaign / f"state.{extension}"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    told = tokid.json("update", state, campaign / "later.npz", "-o", campaign / "updated.npz")
    assert (told["experiments"], told["new_experiments"], told["states"]) == (60, 20, 4)
    assert min(told["simulation_fit"]) > 99.9999 and told["evaluated_on"] == "new"
    tokid("identify", campaign / "all.npz", "-o", campaign / "whole.npz", "--lags", 2)
    updated, whole = markov(campaign / "updated.npz"), markov(campaign / "whole.npz")
    assert np.abs(updated - whole).max() <= 1e-10 * np.abs(whole).max()
    fit = tokid.json("validate", campaign / "updated.npz", campaign / "later.npz")
    assert min(fit["simulation_fit"]) > 99.9999


@pytest.fixture(scope="module")
def noisy_files(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("noisy")
    for name, seed in ("first", 1), ("later", 2):
        tokid("example", "oscillator", "-o", folder / f"{name}.npz", "--experiments", 40, "--steps", 60, "--seed", seed,
              "--measurement-noise", 0.05, "--process-noise", 0.01)
    tokid("identify", folder / "first.npz", "-o", folder / "model.npz", "--state", folder / "state.h5", "--no-refine")
    return folder


@pytest.fixture
def noisy(noisy_files, tmp_path):
    """Two campaigns with noise, of which EM wants another start than what is best without it, and the state of one."""
    return copied(noisy_files, tmp_path)


@pytest.mark.parametrize("few", [False, True])
def test_a_state_is_not_bent_to_what_refines(tokid, noisy, few):
    """The model of an update is not refined: its choices are those of identify --no-refine, to the last bit.

    The lag order is stated, because without EM more lags may predict better.
    """
    if few:
        for name, seed in ("first", 4), ("later", 51):
            tokid("example", "oscillator", "-o", noisy / f"{name}.npz", "--experiments", 15, "--steps", 30, "--seed", seed,
                  "--measurement-noise", 0.2, "--process-noise", 0.1)
    models, states = [], []
    for options in [], ["--no-refine"]:
        told = tokid.json("identify", noisy / "first.npz", "--lags", 6 if few else 4, "-o", noisy / "model.npz", "--state", noisy / "state.h5", *options)
        assert (told["method"] == "em") == (not options)
        states.append(told["states"])
        tokid("update", noisy / "state.h5", noisy / "later.npz", "-o", noisy / "updated.npz")
        models.append(markov(noisy / "updated.npz"))
    assert np.array_equal(*models)
    assert (states[0] != states[1]) == few  # EM does with another number


def test_experiments_of_another_system_are_told(tokid, noisy):
    shutil.copy(noisy / "state.h5", noisy / "other.h5")
    assert tokid.json("update", noisy / "state.h5", noisy / "later.npz")["warnings"] == []
    values = dict(np.load(noisy / "later.npz"))
    np.savez(noisy / "later.npz", **{**values, "y": -values["y"]})
    told = tokid("update", noisy / "other.h5", noisy / "later.npz").stderr.splitlines()
    assert len(told) == values["y"].shape[2]
    for j, line in enumerate(told, 1):
        assert line.startswith(f"tokid: warning: test of the old model on the new experiments: the simulation of output y{j} is worse")
        assert line.endswith("Check that the new experiments are runs of the same system with the same channels")


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_an_output_that_rests_in_new_experiments_is_told(tokid, noisy, value):
    values = dict(np.load(noisy / "later.npz"))
    values["y"][:, :, 1] = value
    np.savez(noisy / "later.npz", **values)
    told = tokid.json("update", noisy / "state.h5", noisy / "later.npz")["warnings"]
    assert any("test of the old model on the new experiments: output y2 is constant in the new experiments" in text for text in told)


def test_several_files_are_added_one_by_one(tokid, campaign):
    first, days = campaign / "state.h5", [campaign / "tuesday.npz", campaign / "wednesday.npz"]
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", first)
    single, at_once = campaign / "single.h5", campaign / "at-once.h5"
    shutil.copy(first, single), shutil.copy(first, at_once)
    for day in days:
        tokid("update", single, day, "-o", campaign / "single.npz")
    page = tokid("update", first, *days, "-o", campaign / "page.npz").stdout
    told = tokid.json("update", at_once, *days, "-o", campaign / "at-once.npz")
    assert at_once.read_bytes() == single.read_bytes() == first.read_bytes()
    assert (campaign / "at-once.npz").read_bytes() == (campaign / "single.npz").read_bytes()
    assert told["data"] == [str(day) for day in days]
    assert (told["experiments"], told["new_experiments"]) == (60, 20)
    shown = " ".join(page.split())
    assert "tuesday.npz: 12 experiments" in shown and "wednesday.npz: 8 experiments" in shown
    assert "60, 20 of them new" in page
    before = tokid.json("validate", campaign / "first-model.npz", campaign / "later.npz")
    assert told["simulation_fit"] == pytest.approx(before["simulation_fit"], abs=1e-9)
    assert told["one_step_fit"] == pytest.approx(before["one_step_fit"], abs=1e-9)
    tokid("identify", campaign / "all.npz", "-o", campaign / "whole.npz", "--lags", 2)
    updated, whole = markov(campaign / "at-once.npz"), markov(campaign / "whole.npz")
    assert np.abs(updated - whole).max() <= 1e-10 * np.abs(whole).max()


def test_without_a_model_only_the_state_is_written(tokid, campaign):
    state = campaign / "state.h5"
    tokid("identify", campaign / "first.npz", "-o", campaign / "model.npz", "--state", state)
    page = tokid("update", state, campaign / "later.npz")
    assert "60, 20 of them new" in page.stdout
    assert sorted(p.name for p in campaign.iterdir()) == [
        "all.npz", "first.npz", "later.npz", "model.npz", "state.h5", "tuesday.npz", "wednesday.npz"]


def test_refusals_leave_the_state_as_it_was(tokid, campaign):
    state = campaign / "state.h5"
    tokid("identify", campaign / "first.npz", "-o", campaign / "model.npz", "--state", state)
    before = state.read_bytes()
    tokid("example", "oscillator", "-o", campaign / "short.npz", "--experiments", 5, "--steps", 50)
    for arguments, reason in [
        ([state, campaign / "short.npz"], "steps: 50 found, 80 needed"),
        ([state, campaign / "later.npz", "-o", campaign / "none" / "m.npz"], "does not exist"),
        ([campaign / "model.npz", campaign / "later.npz"], "a state file that identify --state writes"),
        ([campaign / "later.npz", campaign / "later.npz"], "Use another name"),
        ([campaign / "none.h5", campaign / "later.npz"], "none.h5"),
        ([campaign / "none.h5", campaign / "later.npz", campaign / "neither.npz"], "neither.npz: no such file"),
        ([state, campaign / "later.npz", campaign / "short.npz", "-o", campaign / "m.npz"], "short.npz: steps: 50 found"),
        ([state, campaign / "later.npz", campaign / "missing.npz"], "missing.npz: no such file"),
        ([state, campaign / "later.npz", campaign / "tuesday.npz", "-o", campaign / "tuesday.npz"], "Use another name"),
    ]:
        failed = tokid("update", *arguments, status=2)
        assert reason in failed.stderr, (arguments, failed.stderr)
        assert failed.stderr.count("\n") == 1
    assert state.read_bytes() == before
    assert not (campaign / "m.npz").exists()
    assert "hold-out" in tokid("identify", campaign / "first.npz", "-o", campaign / "x.npz", "--state",
                               campaign / "y.h5", "--hold-out", 0.3, status=2).stderr
    assert not (campaign / "x.npz").exists() and not (campaign / "y.h5").exists()


def test_experiments_of_the_state_are_not_added_again(tokid, campaign):
    """Runs 0 to 39 yesterday, a file with runs 20 to 59 today: 20 of them join, as if they had been given alone."""
    whole = dict(np.load(campaign / "all.npz"))
    np.savez(campaign / "today.npz", **{k: v[20:] if k in ("u", "y") else v for k, v in whole.items()})
    state, alone = campaign / "state.h5", campaign / "alone.h5"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    shutil.copy(state, alone)
    told = tokid.json("update", state, campaign / "today.npz", "-o", campaign / "model.npz")
    plain = tokid.json("update", alone, campaign / "later.npz", "-o", campaign / "plain.npz")
    assert (told["experiments"], told["new_experiments"]) == (60, 20)
    assert told["known_experiments"] == [list(range(20))] and plain["known_experiments"] == [[]]
    assert told["warnings"] == [
        f"{campaign / 'today.npz'}: 20 of 40 experiments are in the state file already: 0–19. These experiments are not added again"]
    for name in "simulation_fit", "one_step_fit", "states", "condition_max":
        assert told[name] == plain[name], name
    one, other = np.load(campaign / "model.npz"), np.load(campaign / "plain.npz")
    assert all(one[name].tobytes() == other[name].tobytes() for name in one.files if name != "options")
    with h5py.File(state) as found, h5py.File(alone) as expected:
        assert found["experiment_digests"].shape == (60, 4)
        for name in expected:
            if name != "options":  # these name the files
                assert np.array_equal(found[name][()], expected[name][()]), name


def test_files_that_add_nothing_leave_the_state_as_it_is(tokid, campaign):
    """So that a call which was stopped can be made once more."""
    state, model = campaign / "state.npz", campaign / "model.npz"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    tokid("update", state, campaign / "later.npz", "-o", model)
    before, content = state.read_bytes(), model.read_bytes()
    model.unlink()
    again = tokid("update", state, campaign / "later.npz", "-o", model)
    assert again.stderr.splitlines() == [
        f"tokid: warning: {campaign / 'later.npz'}: all 20 experiments are in the state file already. Nothing is added"]
    assert "60, 0 of them new" in again.stdout and "Fit" not in again.stdout
    assert state.read_bytes() == before and model.read_bytes() == content
    told = tokid.json("update", state, campaign / "first.npz", campaign / "tuesday.npz")
    assert (told["experiments"], told["new_experiments"]) == (60, 0)
    assert told["known_experiments"] == [list(range(40)), list(range(12))]
    assert told["simulation_fit"] == told["one_step_fit"] == [None, None]


def test_files_of_one_call_that_share_experiments(tokid, campaign):
    state = campaign / "state.h5"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    digests, models = [], []
    for i, names in enumerate([["tuesday", "later", "wednesday"], ["wednesday", "tuesday", "later"], ["later"]]):
        own = campaign / f"own-{i}.h5"
        shutil.copy(state, own)
        told = tokid.json("update", own, *(campaign / f"{name}.npz" for name in names), "-o", campaign / "model.npz")
        assert (told["experiments"], told["new_experiments"]) == (60, 20)
        assert sum(map(len, told["known_experiments"])) == 20 * (len(names) == 3)
        with h5py.File(own) as file:
            digests.append(file["experiment_digests"][()])
        models.append(markov(campaign / "model.npz"))
    for i in 0, 1:
        assert np.array_equal(digests[i], digests[2])
        # The order of the merges differs, and with it the rounding of factors that have condition numbers of some hundred.
        assert np.abs(models[i] - models[2]).max() <= 1e-10 * np.abs(models[2]).max()


def test_experiments_are_known_in_any_format_and_order_of_channels(tokid, campaign):
    state = campaign / "state.h5"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    for extension in "csv", "mat", "h5":
        other = campaign / f"other.{extension}"
        tokid("convert", campaign / "first.npz", other)
        assert tokid.json("update", state, other)["known_experiments"] == [list(range(40))]
    values = dict(np.load(campaign / "first.npz"))
    values["y"], values["output_names"] = values["y"][:, :, ::-1], np.array(["y2", "y1"])
    np.savez(campaign / "other.npz", **values)
    assert tokid.json("update", state, campaign / "other.npz")["known_experiments"] == [list(range(40))]


def test_states_of_earlier_versions_say_that_they_cannot_tell(tokid, campaign):
    state = campaign / "state.npz"
    tokid("identify", campaign / "first.npz", "-o", campaign / "first-model.npz", "--state", state)
    values = dict(np.load(state))
    del values["experiment_digests"], values["without_digest"]
    np.savez(state, **values)
    said = tokid("update", state, campaign / "first.npz").stderr  # a whole file is known by its fingerprint
    assert said.count("\n") == 1 and "all 40 experiments are in the state file already. Nothing is added" in said
    for name, new in ("tuesday", 12), ("later", 8), ("wednesday", 0):
        told = tokid.json("update", state, campaign / f"{name}.npz")
        assert told["new_experiments"] == new
        assert any("no digests of 40 experiments" in text for text in told["warnings"]) == (new > 0)
    with np.load(state) as now:
        # The first file has left its digests, given once more.
        assert (now["without_digest"], now["experiments"], len(now["experiment_digests"])) == (40, 60, 60)


def test_damaged_states_are_refused(tokid, campaign):
    state = campaign / "state.npz"
    tokid("identify", campaign / "first.npz", "-o", campaign / "model.npz", "--state", state)
    sound = dict(np.load(state))
    for change, reason in [
        ({"lags": np.int64(7)}, "window_factors"),
        ({"inputs": np.int64(9)}, "window_factors"),
        ({"window_rows": sound["window_rows"][:-1]}, "window_rows"),
        ({"sample_sums": sound["sample_sums"][:, :-1]}, "sample_sums"),
        ({"window_factors": sound["window_factors"] * np.nan}, "window_factors"),
        ({"method": np.array("magic")}, "magic"),
        ({"experiment_digests": sound["experiment_digests"][::-1]}, "'experiment_digests': rows in another order found, ascending order needed"),
        ({"experiment_digests": sound["experiment_digests"][1:]}, "'experiment_digests': 39 rows found, at least 40 needed"),
        ({"experiment_digests": sound["experiment_digests"][:, 1:]}, "'experiment_digests': shape (40, 3) found"),
        ({"experiment_digests": sound["experiment_digests"] + 2**32}, "'experiment_digests': other values found, whole numbers"),
        ({"experiment_digests": sound["experiment_digests"] * np.nan}, "'experiment_digests': other values found, whole numbers"),
        ({"without_digest": np.int64(41)}, "'without_digest': 41 found, 0 to 40 needed"),
    ]:
        np.savez(campaign / "damaged.npz", **{**sound, **change})
        failed = tokid("update", campaign / "damaged.npz", campaign / "later.npz", status=2)
        assert reason in failed.stderr, failed.stderr


# Concurrent updates

@pytest.fixture(scope="module")
def rounds_files(tokid, tmp_path_factory):
    folder, sizes = tmp_path_factory.mktemp("rounds"), ["--steps", 40, "--measurement-noise", 0.02]
    tokid("example", "oscillator", "-o", folder / "first.npz", "--experiments", 60, "--seed", 1, *sizes)
    tokid("identify", folder / "first.npz", "-o", folder / "model.npz", "--state", folder / "state.h5", "--no-refine")
    for i in range(6):
        tokid("example", "oscillator", "-o", folder / f"part{i}.npz", "--experiments", 40, "--seed", 10 + i, *sizes)
    return folder


@pytest.fixture
def rounds(rounds_files, tmp_path):
    """60 experiments that a state is made of, and six files of 40 others each."""
    return copied(rounds_files, tmp_path), [tmp_path / f"part{i}.npz" for i in range(6)]


def update_at_once(tokid, state, parts, *options):
    calls = [subprocess.Popen([tokid.executable, "update", str(state), str(part), "--quiet", *map(str, options)],
                              stderr=subprocess.PIPE, text=True) for part in parts]
    return [(call.communicate(timeout=120)[1], call.returncode) for call in calls]


def hidden(folder):
    return sorted(p.name for p in folder.iterdir() if p.name.startswith("."))


def test_concurrent_updates_lose_nothing(tokid, rounds):
    folder, parts = rounds
    together, single = folder / "together.h5", folder / "single.h5"
    shutil.copy(folder / "state.h5", together), shutil.copy(folder / "state.h5", single)
    for said, status in update_at_once(tokid, together, parts, "-o", folder / "together.npz"):
        assert status == 0, said
        for line in said.splitlines():
            assert "has locked the file; waiting for up to 60 s" in line
    for part in parts:
        tokid("update", single, part, "-o", folder / "single.npz")
    with h5py.File(together) as file:
        assert file["experiments"][()] == 60 + 6 * 40
    one, other = markov(folder / "together.npz"), markov(folder / "single.npz")
    # The order of the merges differs, and with it the rounding of factors that have condition numbers of some hundred.
    assert np.abs(one - other).max() <= 1e-10 * np.abs(other).max()
    assert hidden(folder) == []


HOLDER = """
import fcntl, os, struct, sys, time
lock = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT, 0o666)
fcntl.fcntl(lock, 37, struct.pack("hhqqi4x", fcntl.F_WRLCK, 0, 0, 0, 0))  # F_OFD_SETLK
os.write(lock, b"process 17 on rig")
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def held(tokid, rounds):
    """A process that holds the lock of the state, under the name that the tool gives it."""
    folder, parts = rounds
    state = folder / "state.h5"
    seen = set()
    for _ in range(50):
        call = subprocess.Popen([tokid.executable, "update", str(state), str(parts[5]), "--quiet"], stderr=subprocess.DEVNULL)
        while call.poll() is None:
            seen.update(name for name in hidden(folder) if name.endswith(".lock"))
        if seen:
            break
    (name,) = seen
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(folder / name)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == "held\n"
    yield folder, parts, holder
    holder.kill()
    holder.wait()


def test_an_update_waits_for_another_one_and_says_so(tokid, held):
    folder, parts, holder = held
    state = folder / "state.h5"
    before = state.read_bytes()
    begin = time.monotonic()
    refused = tokid("update", state, parts[0], "-o", folder / "m.npz", "--wait", 0.5, status=2).stderr.splitlines()
    assert 0.5 <= time.monotonic() - begin < 20
    assert refused == [
        f"tokid: {state}: process 17 on rig has locked the file; waiting for up to 0.5 s",
        f"tokid: {state}: process 17 on rig has locked the file, for more than 0.5 s; try again when the lock is free, or wait longer"]
    (only,) = tokid("update", state, parts[0], "--wait", 0, status=2).stderr.splitlines()
    assert only == f"tokid: {state}: process 17 on rig has locked the file; try again when the lock is free, or wait longer"
    link = folder / "link.h5"  # another name of the same state
    link.symlink_to("state.h5")
    assert "has locked the file" in tokid("update", link, parts[0], "--wait", 0, status=2).stderr
    assert state.read_bytes() == before and not (folder / "m.npz").exists()
    waiting = subprocess.Popen([tokid.executable, "update", str(state), str(parts[0]), "--quiet"],
                               stderr=subprocess.PIPE, text=True)
    assert "waiting for up to 60 s" in waiting.stderr.readline()
    holder.kill()  # nothing of its lock outlives it
    assert waiting.wait(timeout=30) == 0 and waiting.stderr.read() == ""
    waiting.stderr.close()
    assert state.read_bytes() != before
    assert hidden(folder) == []
    tokid("update", state, parts[1], "--wait", 0)


def test_identify_does_not_replace_a_state_that_is_updated(tokid, held):
    folder, parts, holder = held
    before = (folder / "state.h5").read_bytes()
    call = subprocess.Popen([tokid.executable, "identify", str(parts[0]), "-o", str(folder / "new.npz"), "--state",
                             str(folder / "state.h5"), "--states", "4", "--lags", "2", "--no-refine", "--quiet"],
                            stderr=subprocess.PIPE, text=True)
    assert "process 17 on rig has locked the file; waiting" in call.stderr.readline()
    assert (folder / "state.h5").read_bytes() == before and not (folder / "new.npz").exists()
    holder.kill()
    call.communicate(timeout=60)
    assert call.returncode == 0 and (folder / "state.h5").read_bytes() != before


def test_a_state_that_is_changed_without_the_lock_is_told(tokid, rounds):
    folder, parts = rounds
    state = folder / "state.h5"
    before = state.stat().st_mtime_ns
    change = "import itertools, os, sys\nfor time in itertools.count(1): os.utime(sys.argv[1], ns=(time, time))"
    other = subprocess.Popen([sys.executable, "-c", change, state])
    try:
        while state.stat().st_mtime_ns == before:
            time.sleep(0.01)
        said = tokid("update", state, *parts, "-o", folder / "m.npz", status=2).stderr
    finally:
        other.kill()
        other.wait()
    assert "another program has changed the file" in said or "changed while it was read" in said
    assert not (folder / "m.npz").exists()


def test_a_model_that_refines_itself_is_locked(tokid, rounds):
    folder, parts = rounds
    model, copy = folder / "model.npz", folder / "copy.npz"
    content = model.read_bytes()
    busy = subprocess.Popen([tokid.executable, "refine", str(model), str(folder / "first.npz"), "-o", str(model),
                             "--iterations", "200"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while busy.poll() is None:  # others write it meanwhile
        copy.write_bytes(content)
        os.replace(copy, model)
    _, said = busy.communicate()
    assert busy.returncode == 2 and "another program has changed the file" in said
    assert model.read_bytes() == content


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_no_lock(tokid, rounds, end):
    folder, parts = rounds
    state, model, data = folder / "state.h5", folder / "model.npz", folder / "first.npz"
    before = state.read_bytes(), model.read_bytes()
    for command in (["update", state, *(40 * parts)], ["refine", model, data, "-o", model, "--iterations", 100000],
                    ["identify", data, "-o", folder / "new.npz", "--state", state, "--refine"]):
        call = subprocess.Popen([tokid.executable, *map(str, command)], stderr=subprocess.DEVNULL)
        while not any((folder / name).stat().st_size for name in hidden(folder) if name.endswith(".lock")):
            assert call.poll() is None
        time.sleep(0.01)  # the lock has its holder's name just before the handlers of signals are set
        call.send_signal(end)
        assert call.wait(timeout=60) == -end, command
        assert hidden(folder) == [] and (state.read_bytes(), model.read_bytes()) == before


@pytest.mark.parametrize("wait", ["-1", "nan", "soon"])
def test_a_limit_is_no_less_than_zero(tokid, rounds, wait):
    folder, parts = rounds
    assert "--wait" in tokid("update", folder / "state.h5", parts[0], f"--wait={wait}", status=2).stderr
