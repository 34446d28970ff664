# SPDX-License-Identifier: BSD-3-Clause
"""Measures how well `tokid identify` does on plants whose truth is known.

    bench/zoo/run.py --tool build/bin/tokid -o results.jsonl [--cells REGEX] [--draws BEGIN END] [--rivals]
                     [--reference] [--grid] [--short] [--jobs J]
    bench/zoo/run.py --tool build/bin/tokid -o results.jsonl --recorded [FOLDER] [--splits BEGIN END] [--jobs J]

Appends one JSON line for each cell and each set of options. Those that are in the file already are skipped, so a study
that was stopped goes on. bench/zoo/table.py prints the tables.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from zlib import crc32

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np  # noqa: E402 - after the number of threads is set

from conditions import cells, drawn_cells, scales, short_cells  # noqa: E402
from measures import evaluate, predictions, read_model, write_truth  # noqa: E402
from rivals import RIVALS, SETTLED, rival  # noqa: E402
from ensembles import tool  # noqa: E402 - after the path that rivals sets
from recorded import by_rival, by_tool, errors_of, halves, recorded_cells  # noqa: E402
from table import read  # noqa: E402
from truth import experiments, truth_of  # noqa: E402

REFERENCE = "from-truth"  # `tokid refine` from the truth, which may well end elsewhere
CHOICES = ("method", "states", "lags", "smoothing", "period", "initial_state", "nominal")


def grid(states):
    """Sets of stated options, by name. states: true number of states of the plant."""
    chosen = {}
    for lags in (1, 2, 3, 4, 6, 8, 12, 16):
        chosen[f"p{lags}"] = ["--lags", lags]
    for smoothing in ("0", "1", "10", "100", "1000", "infinity"):
        chosen[f"lambda-{smoothing}"] = ["--smoothing", smoothing]
        chosen[f"lambda-{smoothing}-n"] = ["--smoothing", smoothing, "--states", states]
    for lags in (4, 8, 12):
        chosen[f"p{lags}-n-no-em"] = ["--lags", lags, "--states", states, "--no-refine"]
    chosen["n"] = ["--states", states]
    chosen["n-no-em"] = ["--states", states, "--no-refine"]
    chosen["tvera"] = ["--method", "tvera"]
    chosen["tvera-n"] = ["--method", "tvera", "--states", states]
    return {name: [str(word) for word in words] for name, words in chosen.items()}


def data_of(cell, condition, truth, nonlinear=True):
    """Inputs (N, T, r) and outputs (N, T, m) of the experiments of a cell, in the units of the plant."""
    u, y, _ = experiments(truth, condition.experiments, crc32(cell.encode()), nonlinear)
    return u.transpose(1, 0, 2), y.transpose(1, 0, 2)


def make_data(cell, condition, truth, path, nonlinear=True):
    """Write the experiments of a cell, in the units of its data. Returns the factors from the units of the plant."""
    u, y = data_of(cell, condition, truth, nonlinear)
    u_scale, y_scale = scales(cell, condition, u.shape[2], y.shape[2])
    np.savez(path, u=u * u_scale, y=y * y_scale, dt=truth.plant.dt)
    return u_scale, y_scale


def chosen_by(report):
    """The choices of the tool, from its report."""
    refinement, verdict = report.get("refinement") or {}, report.get("verdict") or {}
    choices = {name: report.get(name) for name in CHOICES}
    return {**choices, "iterations": refinement.get("iterations"), "em_smoothing": refinement.get("smoothing"),
            "ahead_ratio": refinement.get("ahead_ratio"), "jumps": refinement.get("jumps"),
            "verdict": verdict.get("trust"),
            "reasons": [check["name"] for check in verdict.get("checks", []) if check["reasons"]],
            "warnings": [found["kind"] for found in report.get("findings", [])]}


def measure_rival(line, cell, truth, condition):
    """The line of one cell with a regression."""
    u, y = data_of(cell, condition, truth)
    begin = time.process_time()
    try:
        model, nominal, options = rival(line["options"], u, y)
    except np.linalg.LinAlgError as error:
        return {**line, "error": str(error)}
    line.update(options, seconds=round(time.process_time() - begin, 2))
    return {**line, **predictions(model, truth, crc32(cell.encode()) + 1, nominal, SETTLED)}


def measure(tool, cell, plant, condition, name, options, limit):
    """The line of one cell with one set of options, or with a rival."""
    line = {"cell": cell, "plant": plant, **asdict(condition), "options": name}
    truth = truth_of(plant, condition)
    if name in RIVALS:
        return measure_rival(line, cell, truth, condition)
    with tempfile.TemporaryDirectory() as folder:
        data, model = Path(folder, "data.npz"), Path(folder, "model.npz")
        factors = make_data(cell, condition, truth, data)
        command = ["identify", data, *options]
        if name == REFERENCE:
            known = Path(folder, "truth.npz")
            write_truth(known, truth, *factors)
            command = ["refine", known, data, "--initial-state", str(np.load(known)["initial_state"])]
        begin = time.monotonic()
        try:
            done = subprocess.run([tool, *command, "-o", model, "--json"], capture_output=True, text=True, check=False,
                                  timeout=limit)
        except subprocess.TimeoutExpired:
            return {**line, "error": f"more than {limit:g} s"}
        line["seconds"] = round(time.monotonic() - begin, 2)
        if done.returncode != 0:
            return {**line, "error": done.stderr.strip().splitlines()[-1]}
        line.update(chosen_by(json.loads(done.stdout)))
        predictor, nominal = read_model(model, *factors)
    return {**line, **evaluate(predictor, truth, crc32(cell.encode()) + 1, nominal,
                                settled=SETTLED if plant.startswith("draw-") else 0)}


def measure_recorded(tool, cell, path, split, name, options, limit):
    """The line of one measured ensemble with one set of options, or with a rival."""
    training, fresh = halves(path, split)
    line = {"cell": cell, "plant": path.stem, "recorded": True, "experiments": len(training["u"]), "options": name}
    try:
        found, report, seconds = (by_rival(name, training, fresh) if name in RIVALS else
                                  by_tool(tool, options, limit, training, fresh))
    except subprocess.TimeoutExpired:
        return {**line, "error": f"more than {limit:g} s"}
    except subprocess.CalledProcessError as error:
        return {**line, "error": error.stderr.strip().splitlines()[-1]}
    chosen = report if name in RIVALS else chosen_by(report)
    return {**line, **chosen, "seconds": round(seconds, 2), **errors_of(found, training, fresh)}


def tasks(chosen, with_rivals, with_reference, with_grid):
    for cell, (plant, condition) in chosen.items():
        yield cell, plant, condition, "default", []
        for name in RIVALS if with_rivals else ():
            yield cell, plant, condition, name, []
        if with_reference or with_grid:
            yield cell, plant, condition, REFERENCE, []
        if with_grid:
            states = truth_of(plant, condition).plant.x.shape[1]
            for name, options in grid(states).items():
                yield cell, plant, condition, name, options


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tool", required=True, help="path of tokid")
    parser.add_argument("--cells", default="", help="regular expression of the names of cells")
    parser.add_argument("--draws", nargs=2, type=int, metavar=("BEGIN", "END"), help="cells drawn at random instead")
    parser.add_argument("--recorded", type=Path, nargs="?", const=tool.data_folder(), metavar="FOLDER",
                        help="measured ensembles (.npz) instead, with rivals (default: those in $TOKID_DATA)")
    parser.add_argument("--splits", nargs=2, type=int, default=(0, 3), metavar=("BEGIN", "END"),
                        help="of the runs of measured ensembles")
    parser.add_argument("--rivals", action="store_true", help="simple regressions beside the default")
    parser.add_argument("--grid", action="store_true", help="stated options beside the default")
    parser.add_argument("--reference", action="store_true", help="maximum likelihood from the truth beside the default")
    parser.add_argument("--short", action="store_true", help="a few quick cells")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=600, help="seconds for one identification")
    parser.add_argument("-o", "--output", type=Path, default=Path("results.jsonl"))
    given = parser.parse_args()

    chosen = (recorded_cells(given.recorded, *given.splits) if given.recorded else
              drawn_cells(*given.draws) if given.draws else short_cells() if given.short else cells())
    chosen = {cell: found for cell, found in chosen.items() if re.search(given.cells, cell)}
    known = read(given.output) if given.output.exists() else {}
    todo = [task for task in tasks(chosen, given.rivals or given.recorded, given.reference, given.grid)
            if "error" in known.get((task[0], task[3]), {"error": "not run"})]
    with ProcessPoolExecutor(given.jobs) as pool, given.output.open("a") as file:
        one = measure_recorded if given.recorded else measure
        for done in as_completed([pool.submit(one, given.tool, *task, given.limit) for task in todo]):
            line = done.result()
            file.write(json.dumps(line) + "\n")
            file.flush()
            print(line["cell"], line["options"], line.get("error") or line["ahead"], file=sys.stderr)


if __name__ == "__main__":
    main()
