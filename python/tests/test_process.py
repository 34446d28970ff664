# SPDX-License-Identifier: BSD-3-Clause
"""Memory, threads, interruption, import: what a process sees of the package."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import tokid

PEAK = """
import sys
import numpy as np
import tokid
def peak():  # [MB]
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) / 1024 for line in file if line.startswith("VmHWM"))
tokid.Ensemble(np.zeros((1, 2, 1)), np.zeros((1, 2, 1)), dt=1.0)  # the first call imports modules
N, T, r, m = 400, 2500, 3, 2
whole = N * T * (r + m) * 8 / 2**20  # [MB] of all samples
def some(channels, dtype=np.float64, order="C"):  # made in place, so that nothing larger has been there before
    array = np.empty((N, T, channels), dtype, order)
    for n in range(N):
        array[n] = np.sin(0.1 * np.arange(T)[:, None] * (n + 1) + np.arange(channels))
    return array
"""


@pytest.mark.parametrize("make", ["some(r), some(m)", "some(r, np.float32), some(m, np.float32)",
                                  "some(r, order='F'), some(m, order='F')", "some(r + 1)[..., 1:], some(m)[::-1]"])
def test_arrays_are_copied_once(python, make):
    """The ensemble's own memory, and no array between it and the caller's."""
    script = PEAK + f"""
u, y = {make}
before = peak()
data = tokid.Ensemble(u, y)
print((peak() - before) / whole)
"""
    share = float(python(script).stdout)
    assert 0.9 < share < 1.1, share


def test_samples_in_place_are_not_copied(python):
    script = PEAK + """
data = tokid.Ensemble.empty(N, T, r, m)
for n in range(N):
    data.u[n] = np.sin(0.1 * np.arange(T)[:, None] * (n + 1) + np.arange(r))
    data.y[n] = np.cos(0.1 * np.arange(T)[:, None] * (n + 1) + np.arange(m))
before = peak()
data.fingerprint, data.missing, data.summary(), data.u[3].sum(), data.y.max()
print((peak() - before) / whole)
"""
    share = float(python(script).stdout)
    assert share < 0.1, share


def test_identification_adds_nothing_for_an_ensemble(python):
    """What arrays need beyond an ensemble is the ensemble."""
    script = PEAK.replace("T, r, m = 400, 2500", "T, r, m = 400, 300") + """
u, y = some(r), some(m)
y += 1e-3 * np.random.default_rng(0).standard_normal(y.shape)
u += np.random.default_rng(1).standard_normal(u.shape)
data = tokid.Ensemble(u, y) if sys.argv[1] == "ensemble" else None
before = peak()
options = dict(lags=2, states=2, method="tvera", nominal="none", initial_state="zero")
tokid.identify(data, **options) if data else tokid.identify(u, y, **options)
print((peak() - before) / whole)
"""
    of_arrays, of_ensemble = float(python(script, "arrays").stdout), float(python(script, "ensemble").stdout)
    assert of_arrays - of_ensemble < 1.2, (of_arrays, of_ensemble)


def test_a_thousand_identifications_leave_nothing_behind(python):
    script = """
import tokid
def resident():  # [kB]
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))
data = tokid.example("rotating-tube", experiments=12, steps=15)
u, y = data.u.copy(), data.y.copy()
def call():
    model = tokid.identify(u, y, lags=2, states=2, hold_out=0.2, method="tvera")
    model.simulate(u), model.predict(u, y), model.A.stack(), model.A[3]
    try:
        tokid.identify(u, y, lags=9, method="tvera")
    except ValueError:
        pass
for _ in range(200):
    call()
before = resident()
for _ in range(1000):
    call()
print(resident() - before)
"""
    # A matrix of the smallest size left behind by each call would be more than this.
    assert int(python(script).stdout) < 400


def test_threads_at_once(noisy):
    alone = tokid.identify(noisy, refine=False)
    found = [None] * 4

    def work(i):
        found[i] = tokid.identify(noisy, refine=False)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(model.A.stack(), alone.A.stack()) for model in found)


def test_threads_share_experiments_of_unequal_lengths(python):
    """Every use looks for what was written beyond the lengths, while other threads read both."""
    script = """
import threading
import numpy as np, tokid
rng = np.random.default_rng(0)
u = rng.normal(size=(100, 40, 1))
data = tokid.Ensemble(u, np.cumsum(u, 1) + rng.normal(size=u.shape), length=[40] * 50 + [39] * 50)
def found():
    return repr([(s.samples, s.missing, s.mean, s.std) for s in data.summary().values()])
alone, differ, stop = found(), [], threading.Event()
def use():
    while not stop.is_set():
        for _ in range(50):
            data._ready()
            [b"~" * n for n in range(700, 800, 8)]  # in the memory of lengths that are no more
def work():
    for _ in range(3000):
        if found() != alone:
            differ.append(1)
users = [threading.Thread(target=use) for _ in range(2)]
workers = [threading.Thread(target=work) for _ in range(2)]
for thread in users + workers:
    thread.start()
for thread in workers:
    thread.join()
stop.set()
print("differ:", len(differ))
data.u[70, 39], data.y[70, 39] = 1e3, np.nan  # beyond its length
assert data.missing == 0 and np.isnan(data.u[70, 39, 0]) and found() == alone
"""
    done = python(script, check=False)
    assert done.returncode == 0 and done.stdout == "differ: 0\n", done.stderr


@pytest.mark.filterwarnings("ignore:not converged")
@pytest.mark.parametrize("refine", [tokid.Model.refine, tokid.stages.refine])
def test_threads_in_parallel(noisy, refine):
    """A thread that sleeps and counts gets the GIL again and again while four calls are under way. Did one of them hold
    it, no other would be under way when it ends."""
    model = tokid.identify(noisy, refine=False)
    begin, within, left, ticks = threading.Barrier(5), set(), set(), 0

    def work(i):
        begin.wait()
        within.add(i)
        refine(model, noisy, smoothing=1.0, iterations=400, tolerance=0.0)
        left.add(i)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    begin.wait()
    while not left:
        time.sleep(0.001)
        ticks += len(within) == 4 and not left
    for thread in threads:
        thread.join()
    assert ticks >= 20


def test_python_goes_on_during_a_call(noisy):
    """Without the GIL released, the other thread would stand still from the first to the last line of a call."""
    counts, stop = [], threading.Event()

    def count():
        n = 0
        while not stop.is_set():
            n += 1
            counts.append(n) if n % 1000 == 0 else None

    thread = threading.Thread(target=count)
    thread.start()
    try:
        time.sleep(0.05)
        before, begin = len(counts), time.monotonic()
        tokid.identify(noisy, refine=False)
        during, seconds = len(counts) - before, time.monotonic() - begin
        before = len(counts)
        time.sleep(seconds)
        alone = len(counts) - before
    finally:
        stop.set()
        thread.join()
    assert during > 0.1 * alone, (during, alone, seconds)


# What a shell without a terminal starts in the background ignores Ctrl-C, and so do all that come from it.
HEEDS_CTRL_C = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
"""

LONG = HEEDS_CTRL_C + """
import sys, time
import tokid
data = tokid.example("oscillator", experiments=300, steps=1500, process_noise=0.05, measurement_noise=0.1)
model = tokid.example_system("oscillator", steps=1500, process_noise=0.05, measurement_noise=0.1)
print("begin", flush=True)
try:
    {call}
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


@pytest.mark.parametrize("call", ["tokid.identify(data)", "tokid.identify(data, threads=2)",
                                  "model.refine(data, iterations=100000, tolerance=0.0, smoothing=0.1)",
                                  "tokid.stages.refine(model, data, iterations=100000, tolerance=0.0, smoothing=0.1)",
                                  "tokid.cross_validate(data, folds=10)",
                                  "data.save('data.h5'); tokid.identify_file('data.h5', 'model.h5', block=400)"])
def test_ctrl_c_stops_a_long_call(tmp_path, call):
    process = subprocess.Popen([sys.executable, "-c", LONG.format(call=call)], stdout=subprocess.PIPE, text=True,
                               cwd=tmp_path)
    try:
        assert process.stdout.readline() == "begin\n"
        time.sleep(0.7)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        assert process.stdout.readline() == "stopped\n"
        assert time.monotonic() - begin < 5  # whole, it would take minutes
        assert process.wait(5) == 0
    finally:
        process.kill()
        process.wait()
    assert {path.name for path in tmp_path.iterdir()} <= {"data.h5"}  # no model, nothing half written


SHORT_CALLS = HEEDS_CTRL_C + """
import sys
import numpy as np
import tokid
import time
if "many" in "{call}":
    many = tokid.example_system("oscillator", steps=100000)
else:
    data = tokid.Ensemble(*np.random.default_rng(0).normal(size=(2, 150, 10000, 1)))
whole = 60.0
if sys.argv[1:]:
    data.save("data.csv")
    begin = time.monotonic()
    tokid.load("data.csv")
    whole = time.monotonic() - begin
begin = time.monotonic()
try:
    print("begin", flush=True)
    {call}
except KeyboardInterrupt:
    print((time.monotonic() - begin) / whole, flush=True)
"""


@pytest.mark.parametrize("call, file", [("many.difference(many, band=20000)", []), ("data.save('data.csv')", []),
                                        ("tokid.load('data.csv')", ["data.csv"])])
def test_ctrl_c_stops_loops_that_report_nothing(tmp_path, call, file):
    process = subprocess.Popen([sys.executable, "-c", SHORT_CALLS.format(call=call), *file],
                               stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    try:
        assert process.stdout.readline() == "begin\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert float(process.stdout.readline()) < 0.6  # of the time that it takes otherwise
        assert process.wait(5) == 0
    finally:
        process.kill()
        process.wait()
    assert [path.name for path in tmp_path.iterdir()] == file  # nothing half written


UPDATE = """
import sys
import tokid
data = tokid.example("oscillator", experiments=10, steps=30, seed=int(sys.argv[1]))
with tokid.FileLock("state.h5") as held:
    state = tokid.UpdateState.load(held)
    tokid.update(state, data).state.save(held)
tokid.update("state.h5", tokid.example("oscillator", experiments=10, steps=30, seed=100 + int(sys.argv[1])))
"""


def test_processes_that_update_one_state_lose_nothing(tmp_path):
    first = tokid.identify(tokid.example("oscillator", experiments=30, steps=30), keep_state=True)
    first.state.save(tmp_path / "state.h5")
    calls = [subprocess.Popen([sys.executable, "-c", UPDATE, str(i)], cwd=tmp_path) for i in range(2, 5)]
    assert [call.wait(120) for call in calls] == [0, 0, 0]
    assert tokid.UpdateState.load(tmp_path / "state.h5").experiments == 30 + 3 * 20
    assert [path.name for path in tmp_path.iterdir()] == ["state.h5"]


def test_a_state_is_locked_by_one_at_a_time(tmp_path):
    file = tmp_path / "state.h5"
    data = tokid.example("oscillator", experiments=30, steps=30)
    tokid.identify(data, keep_state=True).state.save(file)
    more = tokid.example("oscillator", experiments=10, steps=30, seed=2)
    with tokid.FileLock(file) as held:
        assert "held" in repr(held) and os.fspath(held) == str(file)
        with pytest.raises(tokid.IoError, match="this process has locked the file;"):
            tokid.update(file, more, wait=0)
        with (pytest.warns(tokid.TokidWarning, match="waiting for up to 0.1 s") as told,
              pytest.raises(tokid.IoError, match="for more than 0.1 s")):
            tokid.update(file, more, wait=0.1)
        assert told[0].filename == __file__
        assert tokid.update(held, more).updated.experiments == 40
        assert tokid.update(held, tokid.example("oscillator", experiments=10, steps=30, seed=3)).updated.experiments == 50
        tokid.UpdateState.load(file).save(file)  # by somebody who asks for no lock
        with pytest.raises(tokid.IoError, match="another program has changed the file"):
            tokid.update(held, tokid.example("oscillator", experiments=10, steps=30, seed=4))
    with pytest.raises(ValueError, match="released before"):
        tokid.update(held, more)
    assert tokid.UpdateState.load(file).experiments == 50
    with pytest.raises(ValueError, match="limit of a lock"):
        tokid.FileLock(file, wait=-1)
    with pytest.raises(FileNotFoundError):
        tokid.FileLock(tmp_path / "none" / "state.h5")


def test_ctrl_c_stops_a_wait(tmp_path):
    script = HEEDS_CTRL_C + """
import tokid
print("begin", flush=True)
try:
    tokid.FileLock("state.h5")
except KeyboardInterrupt:
    print("stopped", flush=True)
"""
    with tokid.FileLock(tmp_path / "state.h5"):
        process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                   text=True, cwd=tmp_path)
        assert process.stdout.readline() == "begin\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "stopped\n"
        assert process.wait(10) == 0
    assert not list(tmp_path.iterdir())


def test_progress(noisy, capfd):
    shares = []
    tokid.identify(noisy, progress=shares.append, threads=2, refine=False)
    assert shares and shares[-1] == 1.0 and all(0 <= s <= 1 for s in shares)
    with pytest.raises(ZeroDivisionError):
        tokid.identify(noisy, progress=lambda share: 1 / 0, refine=False)
    tokid.identify(noisy, refine=False)
    assert capfd.readouterr().err == ""
    tokid.identify(noisy, progress=True, refine=False)
    assert "identify: " in capfd.readouterr().err


def test_progress_names_stages_and_gives_the_first_model(noisy):
    shares, first = [], []
    model = tokid.identify(noisy, progress=shares.append, on_model=first.append)
    assert all(isinstance(share, tokid.ProgressShare) for share in shares) and shares == sorted(shares)
    assert any(share.stage.startswith("EM") for share in shares)
    assert shares[-1] == 1.0
    assert len(first) == 1 and first[0].states == model.states and first[0].identification is None
    assert not np.array_equal(first[0].A[5], model.A[5])  # EM has changed it
    with pytest.raises(ZeroDivisionError):
        tokid.identify(noisy, on_model=lambda model: 1 / 0)


def test_progress_is_a_bar_of_tqdm(noisy, monkeypatch, capfd):
    auto = pytest.importorskip("tqdm.auto")
    bars = []

    class Bar(auto.tqdm):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            bars.append(self)

    monkeypatch.setattr(auto, "tqdm", Bar)
    tokid.identify(noisy, progress=True, refine=False)
    (bar,) = bars
    assert bar.desc == "identify" and bar.n == bar.total == 100 and bar.disable  # closed
    assert "identify: 100%|" in capfd.readouterr().err
    with pytest.raises(ValueError):
        tokid.identify(noisy, lags=39, method="tvera", progress=True)
    assert len(bars) == 2 and bars[1].disable and bars[1].n < 100


def test_progress_is_a_line_without_tqdm(noisy, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    tokid.identify(noisy, progress=True, refine=False)
    lines = capfd.readouterr().err
    assert lines.startswith("\ridentify: ") and lines.endswith("\ridentify: 100 %\n")


@pytest.mark.skipif(not hasattr(sys, "stdlib_module_names"), reason="Python 3.9 does not know its own modules")
def test_import_brings_numpy_alone(python):
    script = """
import sys
import numpy
before = set(sys.modules)
import tokid
print(*{name.split(".")[0] for name in set(sys.modules) - before} - set(sys.stdlib_module_names))
"""
    assert set(python(script).stdout.split()) <= {"numpy", "tokid"}
