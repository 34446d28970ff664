# SPDX-License-Identifier: BSD-3-Clause
"""What the tool says of degenerate experiments is in the table of docs/troubleshooting.md, word for word.

With TOKID_UPDATE_DOCS=1 in the environment, the messages of the table are written anew instead of compared.
"""

import os
import re
import subprocess

import h5py
import numpy as np
import pytest
from conftest import ROOT
from support import load

PAGE = ROOT / "docs" / "troubleshooting.md"
N, T = 40, 40


def experiments(u, noise=0.0, states=2, outputs=2, seed=3):
    """Outputs of a slowly varying system from rest, (N, T, m), the noise as a share of them."""
    rng = np.random.default_rng(seed)
    count, steps, inputs = u.shape
    A = 0.85 * np.linalg.qr(rng.standard_normal((states, states)))[0]
    B, C = rng.standard_normal((states, inputs)), rng.standard_normal((outputs, states))
    D = 0.3 * rng.standard_normal((outputs, inputs))
    x, y = np.zeros((count, states)), np.empty((count, steps, outputs))
    for k in range(steps):
        y[:, k] = x @ C.T + u[:, k] @ D.T
        x = (1 + 0.1 * np.sin(0.2 * k)) * x @ A.T + u[:, k] @ B.T
    return y + noise * y.std((0, 1)) * rng.standard_normal(y.shape)


def gaussian(inputs=2, count=N, steps=T):
    return np.random.default_rng(7).standard_normal((count, steps, inputs))


def data(folder, u, y, name="data.npz", **more):
    np.savez(folder / name, **{"u": u, "y": y, "dt": 0.1, "initial_state": "zero", **more})
    return folder / name


def identify(folder, u, y, *options, **more):
    return ["identify", data(folder, u, y, **more), "-o", folder / "model.npz", *options]


CASES = {}


def case(name):
    def add(make):
        CASES[name] = make
        return make
    return add


@case("an input that is zero at some steps")
def _(folder, tokid):
    u = gaussian()
    u[:, 10:15, 1] = 0
    return identify(folder, u, experiments(u), input_names=["torque", "valve"])


@case("an input that is the same in all experiments")
def _(folder, tokid):
    u = gaussian()
    u[:, 20:, 0] = 1.5
    return identify(folder, u, experiments(u), "--nominal", "none")


@case("an input that is zero in a whole record")
def _(folder, tokid):
    u = gaussian(count=1, steps=400)
    u[:, :, 1] = 0
    return identify(folder, u, experiments(u, 0.02), "--time-invariant", "--states", 2, "--no-refine")


@case("an input that is constant in a whole record")
def _(folder, tokid):
    u = gaussian(count=1, steps=400)
    u[:, :, 1] = 2.5
    return identify(folder, u, experiments(u, 0.02), "--time-invariant", "--states", 2, "--no-refine")


@case("an input that is zero at some steps of a period")
def _(folder, tokid):
    u = gaussian(count=8, steps=80)
    u[:, 1::4, 1] = u[:, 2::4, 1] = 0
    return identify(folder, u, experiments(u, 0.02), "--period", 4, "--states", 2, "--no-refine")


@case("inputs that move together")
def _(folder, tokid):
    u = gaussian(3)
    u[:, 3:, 2] = 0.5 * u[:, 3:, 0]
    return identify(folder, u, experiments(u))


@case("an input that is held for some steps")
def _(folder, tokid):
    u = gaussian(1)
    u[:, 10:20] = u[:, 10:11]
    return identify(folder, u, experiments(u))


@case("an input that is a feedback and nothing more")
def _(folder, tokid):
    u = gaussian(1)
    for k in range(21, T):
        u[:, k] = -0.5 * experiments(u)[:, k - 1, :1]
    return identify(folder, u, experiments(u))


@case("one sine as the input of a single record")
def _(folder, tokid):
    u = np.sin(0.3 * np.arange(400))[None, :, None]
    rng = np.random.default_rng(1)
    y = np.convolve(u[0, :, 0], 0.8 ** np.arange(30))[:400] + 0.01 * rng.standard_normal(400)
    return identify(folder, u, y[None, :, None], "--time-invariant", "--lags", 3, "--initial-state", "unknown")


@case("fewer experiments than a lag order needs")
def _(folder, tokid):
    u = gaussian(count=9)
    return identify(folder, u, experiments(u), "--method", "tvera", "--lags", 2)


@case("a single experiment")
def _(folder, tokid):
    u = gaussian(count=1)
    return identify(folder, u, experiments(u))


@case("fewer experiments than unknowns, with smoothing")
def _(folder, tokid):
    u = gaussian(count=3)
    return identify(folder, u, experiments(u, 0.05), "--states", 2, "--no-refine")


@case("few experiments without smoothing")
def _(folder, tokid):
    u = gaussian(count=5)
    return identify(folder, u, experiments(u, 0.05), "--states", 2, "--lags", 1, "--smoothing", 0, "--no-refine")


@case("steps without samples in any experiment")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u, 0.02)
    y[:, 20:30] = np.nan
    return identify(folder, u, y, "--states", 2, "--no-refine")


@case("a constant output")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u)
    y[:, :, 1] = 3.2
    return identify(folder, u, y)


@case("an output that is the same in all experiments at some steps")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u)
    y[:, 20:25, 0] = 1
    return identify(folder, u, y, "--method", "tvera", "--lags", 2)


@case("outputs that move together")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u)
    y[:, :, 1] = 2 * y[:, :, 0]
    return identify(folder, u, y)


@case("more states than the outputs show")
def _(folder, tokid):
    u = gaussian()
    return identify(folder, u, experiments(u), "--states", 6)


@case("states that are hidden at some steps")
def _(folder, tokid):
    u = gaussian(1)
    y = np.zeros((N, T, 1))
    x = np.zeros((N, 2))
    for k in range(T):
        seen = k < 15 or k >= 25
        y[:, k, 0] = x[:, 0] + seen * x[:, 1]
        x = np.column_stack([0.8 * x[:, 0] + u[:, k, 0], (-0.6 if seen else 0.0) * x[:, 1] + u[:, k, 0]])
    return identify(folder, u, y, "--states", 2, "--lags", 2)


@case("experiments that are in the file twice")
def _(folder, tokid):
    u = gaussian()
    u[7] = u[3]
    y = experiments(u)
    return identify(folder, u, y)


@case("repetitions of a few experiments")
def _(folder, tokid):
    u = np.repeat(gaussian(count=4), 10, axis=0)
    return identify(folder, u, experiments(u, 0.02), "--method", "tvera", "--lags", 2)


def wild(change, noise=0.05):
    u = gaussian()
    y = experiments(u, noise)
    change(u[12], y[12])
    return u, y


@case("one experiment in other units")
def _(folder, tokid):
    def change(u, y):
        y[:, 0] *= 1000
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("one experiment with swapped channels")
def _(folder, tokid):
    def change(u, y):
        y[:] = y[:, ::-1].copy()
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("one experiment with swapped channels, without noise")
def _(folder, tokid):
    u, y = wild(lambda u, y: y.__setitem__(slice(None), y[:, ::-1].copy()), noise=0.0)
    np.savez(folder / "data.npz", u=u, y=y, dt=0.1)
    return ["identify", folder / "data.npz", "-o", folder / "model.npz"]


@case("one experiment with a wrong sign")
def _(folder, tokid):
    def change(u, y):
        u[:, 0] *= -1
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("one experiment with shifted outputs")
def _(folder, tokid):
    def change(u, y):
        y[2:] = y[:-2].copy()
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("one experiment unlike the others")
def _(folder, tokid):
    def change(u, y):
        y[:] = np.random.default_rng(5).standard_normal(y.shape) * y.std(0)
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("a sensor that is stuck in one experiment")
def _(folder, tokid):
    def change(u, y):
        y[17:, 0] = y[17, 0]
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("an experiment that stopped early, filled with zeros")
def _(folder, tokid):
    def change(u, y):
        u[25:] = y[25:] = 0
    return identify(folder, *wild(change), "--states", 2, "--lags", 2, "--no-refine")


@case("an angle between −π and π")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u, 0.001)
    y[:, :, 0] *= 1.2 / np.abs(np.diff(y[:, :, 0], axis=1)).max()  # at most a fifth of a turn in a step
    y[:, :, 0] = (y[:, :, 0] + 3 + np.pi) % (2 * np.pi) - np.pi
    return identify(folder, u, y, "--states", 2, "--lags", 2, "--no-refine")


def csv(folder, times, name="data.csv"):
    """Experiments a, b, … of random samples at these times."""
    rng = np.random.default_rng(4)
    with open(folder / name, "w") as file:
        print("experiment,time,u1,y1", file=file)
        for n, own in enumerate(times):
            for t in own:
                print("abcdefgh"[n], f"{t:.6g}", *(f"{x:.4f}" for x in rng.standard_normal(2)), sep=",", file=file)
    return ["identify", folder / name, "-o", folder / "model.npz"]


@case("another sample time in one experiment")
def _(folder, tokid):
    return csv(folder, [0.1 * np.arange(30), 0.2 * np.arange(15), 0.1 * np.arange(30)])


@case("experiments at different times of the day")
def _(folder, tokid):
    return csv(folder, [0.1 * np.arange(30), 100 + 0.1 * np.arange(30)])


@case("uneven times")
def _(folder, tokid):
    return csv(folder, [np.array([0, 60, 97, 180, 240, 300, 360, 420, 480.0])])


@case("times that jitter")
def _(folder, tokid):
    rng = np.random.default_rng(2)
    return csv(folder, [np.round(0.1 * np.arange(30) + 0.002 * rng.standard_normal(30) * (np.arange(30) > 4), 4)] * 2)


@case("a gap in rounded times")
def _(folder, tokid):
    k = np.r_[:12, 312:324]
    return csv(folder, [np.round(k / 30, 2)] * 2)


@case("one wrong time")
def _(folder, tokid):
    wild = 0.1 * np.arange(30)
    wild[17] = 77.77
    return csv(folder, [wild, 0.1 * np.arange(30)])


@case("experiments that begin between the steps of others")
def _(folder, tokid):
    return csv(folder, [0.1 * np.arange(30), 0.03 + 0.1 * np.arange(30)])


@case("a clock with a wrong rate")
def _(folder, tokid):
    return csv(folder, [0.1 * np.arange(60), 0.1005 * np.arange(60)])


@case("outputs with fewer steps than the inputs")
def _(folder, tokid):
    u = gaussian()
    return identify(folder, u, experiments(u)[:, :-1])


@case("a column of times with an unknown name")
def _(folder, tokid):
    csv(folder, [0.1 * np.arange(30)] * 2)
    file = folder / "data.csv"
    file.write_text(file.read_text().replace("time", "clock"))
    return ["info", file]


@case("rows without times or step numbers")
def _(folder, tokid):
    file = csv(folder, [0.1 * np.arange(30)] * 2)[1]
    file.write_text(re.sub("^([^,]*),[^,]*", r"\1", file.read_text(), flags=re.MULTILINE))
    return ["info", file]


@case("experiments in a column with another name")
def _(folder, tokid):
    rows = "".join(f"{k},{n},{k % 7},{k % 5}\n" for n in range(2) for k in range(160))
    (folder / "data.csv").write_text("time,run,u1,y1\n" + rows)
    return ["info", folder / "data.csv"]


def texts(folder, title, *cells):
    rows = "".join(f"{k},1,2,{cell}\n" for k, cell in enumerate(cells))
    (folder / "data.csv").write_text(f"time,u1,y1,{title}\n" + rows)
    return ["info", folder / "data.csv"]


@case("a channel of texts")
def _(folder, tokid):
    return [*texts(folder, "valve", "ZU", "ZU", "AUF"), "--inputs", "u1,valve"]


@case("a table that was changed")
def _(folder, tokid):
    u = gaussian()
    tokid("convert", data(folder, u, experiments(u)), folder / "data.csv")
    file = folder / "data.csv"
    file.write_text(file.read_text().replace("\n1,0,", "\n1,0,1", 1).replace("1,0,1-", "1,0,-1"))
    return ["info", file]


@case("a file that may have been cut")
def _(folder, tokid):
    csv(folder, [0.1 * np.arange(30)] * 2)
    file = folder / "data.csv"
    file.write_text(file.read_text().rstrip("\n"))
    return ["info", file]


@case("two sample times")
def _(folder, tokid):
    csv(folder, [0.1 * np.arange(30)] * 2)
    file = folder / "data.csv"
    file.write_text("# dt = 0.1\n# dt = 0.2\n" + file.read_text())
    return ["info", file]


@case("uneven times in a file of arrays")
def _(folder, tokid):
    u = gaussian()
    np.savez(folder / "data.npz", u=u, y=experiments(u), initial_state="zero", time=0.1 * np.arange(T) ** 1.1)
    return ["identify", folder / "data.npz", "-o", folder / "model.npz"]


@case("data without a sample time")
def _(folder, tokid):
    u = gaussian()
    np.savez(folder / "data.npz", u=u, y=experiments(u), initial_state="zero")
    return ["identify", folder / "data.npz", "-o", folder / "model.npz"]


@case("axes in the order steps, experiments, channels")
def _(folder, tokid):
    u = gaussian(count=50)
    return identify(folder, u.swapaxes(0, 1), experiments(u).swapaxes(0, 1), "--states", 2, "--lags", 2, "--no-refine")


@case("axes in the order experiments, channels, steps")
def _(folder, tokid):
    u = gaussian()
    return ["info", data(folder, u.swapaxes(1, 2), experiments(u).swapaxes(1, 2))]


@case("two axes in the order channels, steps")
def _(folder, tokid):
    u = gaussian(count=1, steps=200)
    return ["info", data(folder, u[0].T, experiments(u, outputs=1)[0].T)]


@case("an array of two axes for many experiments")
def _(folder, tokid):
    u = gaussian(1, count=20)
    return ["info", data(folder, u[..., 0], experiments(u, outputs=1)[..., 0])]


@case("fresh data of another sample time")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u)
    tokid(*identify(folder, u, y))
    return ["validate", folder / "model.npz", data(folder, u[:5], y[:5], "fresh.npz", dt=0.2)]


@case("more experiments of another sample time")
def _(folder, tokid):
    u = gaussian()
    y = experiments(u)
    tokid(*identify(folder, u, y), "--state", folder / "state.npz")
    return ["update", folder / "state.npz", data(folder, u[:5] + 1, y[:5], "fresh.npz", dt=0.2), "-o",
            folder / "model.npz"]


@case("no sample time")
def _(folder, tokid):
    u = gaussian()
    return identify(folder, u, experiments(u), dt=0.0)


def messages(tokid, arguments):
    """What is said on stderr, without the names of files."""
    result = subprocess.run([tokid.executable, *map(str, arguments)], capture_output=True, text=True,
                                          check=False)
    assert result.returncode in (0, 2), result.stderr
    assert (result.returncode == 2) == ("warning: " not in result.stderr and result.stderr != "")
    lines = [line.removeprefix("tokid: ").removeprefix("warning: ") for line in result.stderr.splitlines()]
    lines = [re.sub(r"^\S*/(data|fresh)\.(npz|csv): ", "", line) for line in lines]
    return [re.sub(r"'\S*/data\.csv'", "'data.csv'", line) for line in lines]


def rows():
    section = PAGE.read_text().split("## Degenerate experiments")[1].split("\n## ")[0]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in section.splitlines()
            if line.startswith("| ")][1:]


def test_the_table_has_all_cases():
    assert [row[0] for row in rows()] == list(CASES)


@pytest.mark.parametrize("name", CASES)
def test_case(tokid, tmp_path, name):
    said = messages(tokid, CASES[name](tmp_path, tokid))
    shown, = (row[1] for row in rows() if row[0] == name)
    if os.environ.get("TOKID_UPDATE_DOCS") == "1":
        words = set(shown.split())
        best = max(said, key=lambda line: len(words & set(line.split())), default="nothing")
        PAGE.write_text(PAGE.read_text().replace(f"| {name} | {shown} |", f"| {name} | {best} |"))
        pytest.skip("docs/troubleshooting.md written anew")
    assert shown in said


def test_outliers_are_numbered_as_in_the_data(tokid, tmp_path):
    arguments = CASES["one experiment with swapped channels"](tmp_path, tokid)
    for more in ([], ["--hold-out", 0.25]):
        outlier, = tokid.json(*arguments, *more)["outliers"]
        assert outlier["experiment"] == 12 and outlier["ratio"] > 10
        assert {channel["name"] for channel in outlier["outputs"]} == {"y1", "y2"}


def test_a_stuck_sensor_is_told_once(tokid, tmp_path):
    """By its number in the data, whichever experiments are held out."""
    arguments = CASES["a sensor that is stuck in one experiment"](tmp_path, tokid)
    for more in ([], ["--hold-out", 0.25]):
        text, = (line for line in messages(tokid, [*arguments, *more]) if "experiment 12" in line)
        assert "Check whether the sensor of this output was stuck" in text


@pytest.mark.parametrize("third", ["at rest", "an input, a step later"])
@pytest.mark.parametrize("time", [(), ("--time-invariant",), ("--time-invariant", "--weighting", "projection")])
def test_exact_outputs_spoil_no_others(tokid, tmp_path, third, time):
    """A constant like 0.1, whose mean over many experiments is another number, or a recorded command."""
    u = gaussian(count=5 * N)
    y = experiments(u, 0.05)
    if time:  # one that does not change: responses to the same inputs, convolved
        weights = np.array([[0.3, 1, 0.7, 0.4, 0.2], [0, 0.5, -0.6, 0.4, -0.2]])
        y = np.stack([sum(w[i] * np.pad(u, ((0, 0), (i, 0), (0, 0)))[:, :T, 0] for i in range(5)) for w in weights], 2)
        y += 0.05 * np.random.default_rng(9).standard_normal(y.shape)
    exact = np.full((5 * N, T, 1), 0.1) if third == "at rest" else 0.7 * np.pad(u, ((0, 0), (1, 0), (0, 0)))[:, :T, 1:]

    def fits(outputs):
        arguments = ["--states", 5, "--lags", 3, "--no-refine", "--nominal", "mean", "--hold-out", 0.25]
        result = tokid.json(*identify(tmp_path, u, outputs, *arguments, *time))
        return [np.array(result[kind][:2]) for kind in ("one_step_fit", "simulation_fit")]

    for plain, beside in zip(fits(y), fits(np.concatenate([y, exact], 2))):
        assert np.all(beside > plain - 2), (plain, beside)


@pytest.fixture(scope="module")
def alone():
    """Steps → errors of predictions by the model without the exact output."""
    return {}


@pytest.mark.parametrize("exact", ["a command", "a command in single precision", "a copy with noise of its own"])
def test_exact_outputs_do_not_choose_the_model(tokid, tmp_path, alone, exact):
    """Nor does a gap in them spoil predictions, or EM fail, where gains cancel noise that outputs have in common."""
    # With the third output in single precision, the search for jumps and EM take most of the time.
    steps, options = (24, ["--jumps", "none"]) if exact == "a command in single precision" else (T, [])
    u = gaussian(count=80, steps=steps)
    rng = np.random.default_rng(11)
    y = experiments(u, 0.05, states=4)
    command = 0.7 * np.pad(u, ((0, 0), (1, 0), (0, 0)))[:, :steps, 1:]
    third = {"a command": command, "a command in single precision": command.astype(np.float32).astype(float),
             "a copy with noise of its own": y[:, :, :1] + 1e-6 * rng.standard_normal((80, steps, 1))}[exact]
    both = np.concatenate([y, third], 2)

    def errors(outputs, gap=False):
        given = outputs[50:].copy()
        if gap:
            given[:, 20, -1] = np.nan
        tokid("predict", tmp_path / "model.npz", data(tmp_path, u[50:], given, "fresh.npz"), "-o", tmp_path / "p.npz")
        return np.sqrt(np.mean((load(tmp_path / "p.npz")["y"] - outputs[50:])[:, 10:, :2] ** 2, (0, 1)))

    if steps not in alone:
        tokid(*identify(tmp_path, u[:50], y[:50], *options))
        alone[steps] = errors(y)
    tokid(*identify(tmp_path, u[:50], both[:50], *options))
    assert np.all(errors(both) < 1.2 * alone[steps])
    assert np.all(errors(both, gap=True) < 1.2 * alone[steps])


def test_steps_alone_are_given_orders_that_they_can_judge(tokid, tmp_path):
    """Of windows over many steps there are plenty, but each step has no more than the experiments."""
    u = gaussian(count=16, steps=120)
    result = tokid.json(*identify(tmp_path, u, experiments(u, 0.05), "--smoothing", 0, "--no-refine"))
    assert all(trial["lags"] * 4 + 2 < 16 for trial in result["smoothing_trials"])
    assert not any("no degree of freedom" in text for text in result["warnings"])


def test_streams_tell_what_the_first_steps_show(tokid, tmp_path):
    u = gaussian(steps=900)
    u[:, 60:70, 0] = u[:, 60:61, 0]
    y = experiments(u, 0.05)
    y[12, 70:170, 0] = y[12, 70, 0]
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"], file["y"], file["initial_state"] = u, y, "zero"
    said = messages(tokid, ["identify", tmp_path / "data.h5", "-o", tmp_path / "model.h5", "--block", 400,
                            "--lags", 2, "--states", 2, "--no-refine"])
    assert any(line.startswith("in the first steps, on which tokid made its choices, input u1 is determined by earlier inputs") and
               "61–69" in line for line in said), said
    text, = (line for line in said if "experiment 12" in line)
    assert text.startswith("in the first steps, on which tokid made its choices, output y1 stays at ") and "steps 70–169" in text


def test_streams_tell_of_copies_that_they_use(tokid, tmp_path):
    u = gaussian(steps=900)
    y = experiments(u)
    u[7], y[7] = u[3], y[3]
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"], file["y"], file["initial_state"] = u, y, "zero"
    assert ("in the first steps, on which tokid made its choices, 1 of 40 experiments is a copy of another experiment, within rounding: experiment 7 of experiment 3. An identification in "
            "blocks uses these experiments, too. If they agree at all steps, delete them from the data, or identify with --block all") in messages(
                tokid, ["identify", tmp_path / "data.h5", "-o", tmp_path / "model.h5", "--block", 400])
