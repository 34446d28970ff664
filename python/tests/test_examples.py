# SPDX-License-Identifier: BSD-3-Clause
"""The examples in examples/python do what they claim, as scripts and as notebooks."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "python"
NAMES = ["cd_player", "learning", "modes", "mujoco_crane", "mujoco_swing_up", "own_regression", "paper_example", "pendubot",
         "plan", "robot_arm"]


@pytest.fixture
def notebook(tmp_path, monkeypatch):
    """Runs the code of a notebook cell by cell, in a folder of its own; gives the variables that it ends with.

    `changes` are numbers of the code, by the names of arguments: those that the tests have instead.
    """
    pyplot.switch_backend("agg")
    monkeypatch.chdir(tmp_path)

    def run(name, **changes):
        names, found = {"__name__": "__main__"}, 0
        cells = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
        for number, cell in enumerate(cells, 1):
            if cell["cell_type"] == "code":
                code = "".join(cell["source"])
                for argument, value in changes.items():
                    code, count = re.subn(rf"\b{argument}=\d+", f"{argument}={value}", code)
                    found += count
                exec(compile(code, f"{name}.ipynb, cell {number}", "exec"), names)
        assert found == len(changes)
        assert "<svg" in (tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        return names

    yield run
    pyplot.close("all")


def test_notebooks_are_the_scripts():
    module = runpy.run_path(str(FOLDER / "notebooks.py"))
    assert [path.stem for path in module["SCRIPTS"]] == NAMES == sorted(p.stem for p in FOLDER.glob("*.ipynb"))
    for path in module["SCRIPTS"]:
        script = path.read_text(encoding="utf-8")
        made = module["notebook"](script)
        kept = json.loads(path.with_suffix(".ipynb").read_text(encoding="utf-8"))
        # The outputs are what the gallery of the site shows: a picture at least, and no error.
        outputs = [output for c in kept["cells"] for output in c.pop("outputs", [])]
        assert any("image/png" in output.get("data", {}) for output in outputs), "run notebooks.py --run"
        assert all(output["output_type"] != "error" for output in outputs)
        assert kept == {**made, "cells": [{k: v for k, v in c.items() if k != "outputs"} for c in made["cells"]]}, \
            "run examples/python/notebooks.py"
        # Every line of code of the script is in the notebook, in its order.
        cells = [c for c in made["cells"] if c["cell_type"] == "code"]
        code = [line for c in cells for line in "".join(c["source"]).split("\n")]
        wanted = [line for line in script.split("\n") if line and not line.startswith("#")]
        assert [line for line in code if line and not line.startswith("#")] == wanted


def test_a_script_runs_by_itself(tmp_path):
    subprocess.run([sys.executable, FOLDER / "plan.py"], cwd=tmp_path, check=True, timeout=120,
                   env={**os.environ, "MPLBACKEND": "agg"}, stdout=subprocess.DEVNULL)
    assert (tmp_path / "plan.svg").exists()


def test_paper_example(notebook):
    found = notebook("paper_example")
    assert max(found["pulse_error"], found["output_error"], found["matrix_error"]) < 1e-9
    assert found["products"].max() < 1e-9 < 1 < found["single"]
    identified, best = found["fits"]["identified"], found["fits"]["true system"]
    assert found["noisy"].states == 4
    # Nothing beats the truth, by more than chance; the identified model comes within a point of it.
    assert np.all(np.subtract(best, identified) > -0.05) and np.all(np.subtract(best, identified) < 1)


def test_own_regression(notebook):
    table = notebook("own_regression")["table"]
    best = np.array(table["true system", ""])
    figures = {stage: np.array([table[name, stage] for name, kind in table if kind == stage]) for stage in ("subspace", "EM")}
    alone, ridge, coupled = figures["subspace"]
    # With few experiments, a ridge or a penalty on variation reduces the shortfall of simulations by 40 % or more, and the
    # errors of pulse responses by 30 % or more.
    for better in (ridge, coupled):
        assert best[1] - better[1] < 0.6 * (best[1] - alone[1]) and better[2] < 0.7 * alone[2]
    # EM makes similar models of all, which come close to the truth, the best predictor but for chance.
    assert np.all(figures["EM"][:, 0] > best[0] - 0.4) and np.all(figures["EM"][:, 0] < best[0] + 0.05)
    assert np.all(figures["EM"][:, 1] > best[1] - 2) and np.all(figures["EM"][:, 2] < 3.5)


def test_modes(notebook):
    found = notebook("modes", replicates=10)  # the intervals of the picture come from four times as many
    assert found["found"].valid[:, [0, 2]].mean() > 0.95
    # The page says within 2 % of the truth where the variation is slow.
    assert np.median(found["errors"], axis=0).max() < 1 and np.mean(found["errors"] < 2) > 0.95
    # Neighbouring steps of one model have nearly the same error: 95 % hold over many ensembles, fewer in some of them.
    assert found["held"].min() > 0.6


@pytest.fixture
def on_measured_data(notebook, monkeypatch):
    """Runs a notebook on measured data."""
    data = Path(os.environ.get("TOKID_DATA") or ROOT.parent / "shared" / "data")
    if not data.exists():
        pytest.skip(f"{data} is absent: the measured data are no part of the project")
    monkeypatch.setenv("TOKID_DATA", str(data))
    return notebook


def test_pendubot(on_measured_data):
    found = on_measured_data("pendubot")
    assert found["model"].identification.nominal and len(found["training"]) == 7
    fits = found["fits"]
    # An ARX model varying in time has 96.8, 81.5, 60.5 and 33.5 in the mean of 15 splits (docs/how-to/robot.md).
    assert np.all(fits.mean(axis=1) > [95, 80, 60, 33])
    assert np.all(np.diff(fits, axis=0) < 0)


@pytest.mark.parametrize("name", ["pendubot", "robot_arm", "cd_player"])
def test_absent_data_are_named(notebook, name, tmp_path, monkeypatch):
    monkeypatch.setenv("TOKID_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(SystemExit, match="nowhere"):
        notebook(name)


def test_robot_arm(on_measured_data):
    fits = on_measured_data("robot_arm")["fits"]
    # n4sid has 95.8 % and 98.6 %. Simulations of two resonances at the limit of stability differ by a point or two.
    assert fits["simulation"] > 95.8 - 2 and fits["one step ahead"] > 98.6


def test_cd_player(on_measured_data):
    simulation, _, one_step = on_measured_data("cd_player")["table"][8]
    # n4sid with eight states has no better fit in any column.
    assert np.all(simulation > [57.9 - 0.5, 77.0]) and np.all(one_step > [81.8, 80.6])


def test_plan(notebook):
    errors = notebook("plan")["errors"]
    # With a quarter of the planned experiments, the error is a few times larger; with twice as many, by √2 or more smaller.
    assert errors["planned inputs"][1] < 0.5 * errors["planned inputs"][0]
    assert errors["planned inputs"][2] < 0.8 * errors["planned inputs"][1]
    assert np.all(np.array(errors["step tests"]) > 10 * np.array(errors["planned inputs"]))


def test_learning(notebook):
    errors = notebook("learning")["errors"]
    # The noise of the sensor, 0.02 K, remains; inputs that follow the noise of the last run add as much again at most.
    assert errors[0] > 5 and 0.015 < min(errors[2:]) and max(errors[2:]) < 2 * 0.02


def test_mujoco_crane(notebook, capsys):
    found = notebook("mujoco_crane")
    assert found["model"].states == 5  # trolley, rope and motor
    assert len(found["boards"]) == 20 and all(len(trip.log) == 150 for trip in found["boards"])
    lost = np.mean([np.isnan(samples) for trip in found["boards"] for _, samples in trip.log])
    assert 0.08 < lost < 0.12
    # Rounding errors of float, 1.2e-7, in sums of at most eight products, for some 20 steps until they have decayed
    assert 0 < found["difference"] < 8 * 20 * 1.2e-7 * found["largest"]
    table = found["table"]
    assert np.all(np.divide(table["open loop"], table["C code"]) > 1.5) and np.all(found["end_ratio"] > 5)
    # The page says what comes out, up to the digits of the machine and to times.
    page = (ROOT / "docs" / "how-to" / "deploy.md").read_text(encoding="utf-8")
    printed = capsys.readouterr().out.splitlines()
    told = re.search(r"^Runs  .*?^Forces .*?$", page, re.MULTILINE | re.DOTALL)[0].splitlines()
    number = r"\d[-\d.e]*"
    assert [re.sub(number, "#", line).split() for line in told] == [re.sub(number, "#", line).split() for line in printed]
    for a, b in zip(told, printed):
        if a.startswith(("Model", "Forces")):
            continue
        assert list(map(float, re.findall(number, a))) == pytest.approx(list(map(float, re.findall(number, b))), rel=0.1)


def test_mujoco_swing_up(notebook, capsys):
    found = notebook("mujoco_swing_up")
    # At least ten times nearer to the plan than in open loop: cart and pole together, the tip, and at the end.
    assert min(found["ratio"], found["tip_ratio"], found["end_ratio"]) >= 10
    assert found["upright"]["open loop"] <= 2
    assert found["upright"]["identified model"] == found["STARTS"] == 20
    errors = found["errors"]
    assert errors["open loop"][1] > 0.5  # the pole falls
    # No worse by half than with everything known and measured.
    assert np.all(np.less(errors["identified model"][:4], np.multiply(errors["all known"][:4], 1.5)))
    # The page says what comes out.
    page = (ROOT / "docs" / "how-to" / "mujoco.md").read_text(encoding="utf-8")
    ratios = r"departures are ([\d.]+) times smaller than in open loop,\s+those of the tip ([\d.]+) times"
    told, printed = (np.array(re.search(ratios, text).groups(), float) for text in (page, capsys.readouterr().out))
    assert told == pytest.approx(printed, rel=0.1)
