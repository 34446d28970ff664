#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures tokid beside other methods and writes the tables and the picture of docs/comparison.md.

    bench/compare/run.py [-o build/compare.jsonl] [--short] [--only NAME ...] [--print]

`make compare` does so, with the Python package of tokid on the path. The program appends one JSON line for each data
set and method, and does not measure again what is in the file. The robot's runs come from the folder TOKID_DATA;
examples/pendubot.py says where they are public. Where they are absent, their table stays as it is. --short measures
small data sets. --print prints the tables and leaves the document alone.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np  # noqa: E402 - after the number of threads is set

from contenders import CONTENDERS, HINDSIGHT  # noqa: E402
from ensembles import PLANTS, ROBOT, ROOT, of_plant, of_robot, robot_path  # noqa: E402
from judge import HORIZONS, errors, squares  # noqa: E402

DOCUMENT, PICTURE = ROOT / "docs" / "comparison.md", ROOT / "docs" / "images" / "comparison.svg"
NOISES, SPLITS = ("low", "high"), 10
SEEDS = {20: 2, 60: 1}  # experiments -> ensembles of each plant and noise
COUNTS = tuple(SEEDS)
BEST = "Kalman filter of the true plant"
MEMORY_OF = ("crane", 60, "low", 0)
UNMEASURED = "–"


def cells(short):
    """Data sets: (plant, experiments, noise, seed), or (robot, None, None, split)."""
    if short:
        plants = [(name, 20, "low", 0) for name in ("stiffness_jump", "invariant_structure")]
    else:
        plants = [(name, count, noise, seed) for count, seeds in SEEDS.items() for seed in range(seeds)
                  for noise in NOISES for name in PLANTS]
    robot = [(ROBOT, None, None, split) for split in range(1 if short else SPLITS)]
    if not robot_path().exists():
        print("The robot's runs are absent, so their table stays as it is. examples/pendubot.py says where they come "
              "from.", file=sys.stderr)
        robot = []
    return robot + plants


def data_of(cell):
    name, count, noise, seed = cell
    return of_robot(seed) if name == ROBOT else of_plant(name, count, noise, seed)


@np.errstate(all="ignore")
def judged(predictor, data):
    """Errors [%] on the fresh experiments."""
    predictions = predictor.predict(data.fresh_u, data.fresh_y, HORIZONS)
    return errors(squares(predictions, data.fresh_y, data.y.mean(axis=0))).tolist()


@np.errstate(all="ignore")
def measured(contender, data):
    """Errors, seconds and options of one identification; its first line of words where it fails."""
    try:
        found = (CONTENDERS | HINDSIGHT)[contender](data)
    except (ImportError, OSError, subprocess.CalledProcessError) as error:
        return {"missing": f"{type(error).__name__}: {error}".splitlines()[0]}
    return {"errors": judged(found.predictor, data), "seconds": found.seconds, "fit_seconds": found.fit_seconds,
            "options": found.options, "versions": found.versions}


def peak_memory(contender):
    """[bytes] of a process that identifies MEMORY_OF, with Python and NumPy; of n4sid, that of Octave."""
    data = data_of(MEMORY_OF)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "data.npz")
        np.savez(path, u=data.u, y=data.y, free_y=data.free_y, dt=data.dt)
        here = Path(__file__).parent
        command = [sys.executable, "-S", "-E", here.parent / "measured.py", sys.executable, here / "memory.py",
                   contender, path]
        done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    return json.loads(done.stdout.splitlines()[-1])["peak_bytes"] if done.returncode == 0 else None


def jobs(short, only):
    """Pairs of a data set and a contender; of `memory`, the data set is the name of the measurement."""
    contenders = [name for name in CONTENDERS if not only or name in only]
    for cell in cells(short):
        for name in contenders:
            if cell[0] != ROBOT or name != "SystemID":  # free responses of the robot do not exist
                yield list(cell), name
        for name in HINDSIGHT if cell[0] == ROBOT else [BEST]:
            yield list(cell), name
    if not short:
        for name in ["nothing", *contenders]:
            yield "memory", name


def read(path):
    """{(data set, contender): line}"""
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    return {(json.dumps(line["data"]), line["contender"]): line for line in lines}


def study(path, short, only):
    known = read(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    cell_of_data, data = None, None
    with path.open("a") as file:
        for cell, name in jobs(short, only):
            if "missing" not in known.get((json.dumps(cell), name), {"missing": ""}):
                continue
            if cell == "memory":
                line = {"bytes": peak_memory(name)}
            else:
                if cell != cell_of_data:
                    cell_of_data, data = cell, data_of(cell)
                line = {"errors": judged(data.truth, data)} if name == BEST else measured(name, data)
            line = {"data": cell, "contender": name, **line}
            file.write(json.dumps(line) + "\n")
            file.flush()
            known[json.dumps(cell), name] = line
            print(*np.atleast_1d(cell), name, line.get("errors", line.get("missing", "")), file=sys.stderr)
    return known


# ---- tables ----


def figure(value):
    """Three significant digits."""
    if np.isnan(value):
        return UNMEASURED
    return f"{value:#.3g}".rstrip(".") if np.isfinite(value) else "unstable"


def medians(results, name, which, field):
    """The median of a field of the lines of a method over the data sets that which(cell) selects; NaN without any."""
    values = [line[field] for line in results.values()
              if line["contender"] == name and line["data"] != "memory" and which(line["data"]) and field in line]
    return np.median(values, axis=0) if values else np.full(len(HORIZONS) if field == "errors" else (), np.nan)


def table(head, body):
    """Lines of a table, figures to the right."""
    rows = [head, ["---", *["---:"] * (len(head) - 1)], *body]
    return ["| " + " | ".join(row) + " |" for row in rows]


def error_rows(values):
    """Rows of the errors {method: columns}. The least figure of a column is in bold, also where several methods show it.

    Methods that are no contenders stand last, and not in bold.
    """
    values = {name: row for name, row in values.items() if not np.isnan(row).all()}
    rows = [row for name, row in values.items() if name in CONTENDERS]
    least = [figure(low) for low in np.min(np.nan_to_num(rows, nan=np.inf), axis=0)] if rows else []
    for name, row in values.items():
        if name in CONTENDERS:
            yield [name, *(f"**{cell}**" if cell == low else cell for cell, low in zip(map(figure, row), least))]
        else:
            yield [f"*{name}*", *map(figure, row)]


def errors_of(results, groups):
    """Errors {method: (groups * horizons)}."""
    return {name: np.concatenate([medians(results, name, which, "errors") for which in groups])
            for name in [*CONTENDERS, BEST, *HINDSIGHT]}


def of_noise(noise, count):
    return lambda cell: cell[0] != ROBOT and cell[1] == count and cell[2] == noise


def tables(results):
    """(name, lines) of each table that was measured."""
    versions = {}
    for line in results.values():
        versions |= line.get("versions", {})
    versions = {"tokid": versions.pop("tokid", UNMEASURED), "NumPy": np.__version__, **versions}
    names = {"octave": "GNU Octave", "control": "its control package"}
    rows = [[names.get(name, name), version] for name, version in versions.items()]
    yield "programs", table(["program", "version"], rows)
    steps = [f"{horizon} step{'s' * (horizon > 1)}" for horizon in HORIZONS]
    if any(line["data"][0] == ROBOT for line in results.values()):
        yield "robot", table(["method", *steps], error_rows(errors_of(results, [lambda cell: cell[0] == ROBOT])))
    for noise in NOISES:
        head = ["method", *(f"N = {count}: {step}" if step == steps[0] else step for count in COUNTS for step in steps)]
        groups = [of_noise(noise, count) for count in COUNTS]
        yield f"{noise}-noise", table(head, error_rows(errors_of(results, groups)))
    last = slice(len(HORIZONS) - 1, None, len(HORIZONS))
    for noise in NOISES:
        groups = [lambda cell, n=noise, p=plant: of_noise(n, COUNTS[0])(cell) and cell[0] == p for plant in PLANTS]
        values = {name: row[last] for name, row in errors_of(results, groups).items()}
        yield f"plants-{noise}", table(["method", *(name.replace("_", " ") for name in PLANTS)], error_rows(values))
    yield "costs", table(["method", *(f"N = {count} [s]" for count in COUNTS), "final fit [s]", "memory [MB]"],
                         cost_rows(results))


def cost_rows(results):
    """Medians over the plants, and the memory of one of them."""
    memory = {line["contender"]: line["bytes"] or np.nan for line in results.values() if line["data"] == "memory"}
    for name in CONTENDERS:
        seconds = [medians(results, name, lambda cell, c=count: cell[1] == c, field)
                   for count, field in (*((count, "seconds") for count in COUNTS), (COUNTS[-1], "fit_seconds"))]
        yield [name, *map(figure, seconds), figure(memory.get(name, np.nan) / 1e6)]
    yield ["*Python and NumPy alone*", "", "", "", figure(memory.get("nothing", np.nan) / 1e6)]


def write(results):
    """The tables into the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    for name, lines in tables(results):
        block = re.search(rf"(<!-- table: {name} -->\n)(.*?)(<!-- end -->)", text, re.DOTALL)
        text = text[: block.end(1)] + "\n".join([*lines, ""]) + text[block.start(3) :]
    DOCUMENT.write_text(text, encoding="utf-8")


# ---- picture ----


def draw(results):
    """Errors over horizons: a dot for each method and horizon, in a panel for each kind of data."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "tokid", "svg.fonttype": "path", "font.size": 9})
    import matplotlib.pyplot as plt

    ink, rule = "#24292f", "#d5d9de"
    colours = ("#9ec5e8", "#3f8ac9", "#123f6d")
    panels = {"Robot, 14 runs": lambda cell: cell[0] == ROBOT}
    panels |= {f"Plants, {count} experiments, low noise": of_noise("low", count) for count in COUNTS}
    panels = {title: which for title, which in panels.items()
              if np.isfinite(medians(results, "tokid", which, "errors")).all()}
    names = list(CONTENDERS)[::-1]
    figure_, axes = plt.subplots(1, len(panels), figsize=(9, 3.6), sharey=True, layout="constrained")
    for axis, (title, which) in zip(np.atleast_1d(axes), panels.items()):
        for row, name in enumerate(names):
            found = medians(results, name, which, "errors")
            axis.plot([found.min(), found.max()], [row, row], color=rule, linewidth=2, zorder=1)
            for value, colour, horizon in zip(found, colours, HORIZONS):
                axis.scatter(value, row, s=34, color=colour, zorder=2,
                             label=f"{horizon} step{'s' * (horizon > 1)} ahead" if row == len(names) - 1 else None)
        axis.axvline(100, color=ink, linewidth=0.8, linestyle=":")
        axis.set_title(title, fontsize=9)
        axis.set(xscale="log", xlabel="error [%]", xlim=(1, 200), yticks=range(len(names)), yticklabels=names)
        axis.set_xticks([1, 10, 100], ["1", "10", "100"])
        axis.grid(axis="x", color=rule, linewidth=0.5)
        axis.set_axisbelow(True)
        for side in ("top", "right", "left"):
            axis.spines[side].set_visible(False)
        axis.tick_params(axis="y", length=0)
    handles, labels = np.atleast_1d(axes)[0].get_legend_handles_labels()
    figure_.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure_.savefig(PICTURE, metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build" / "compare.jsonl", help="results")
    parser.add_argument("--short", action="store_true", help="two plants and one split of the robot; prints the tables")
    parser.add_argument("--only", nargs="+", choices=CONTENDERS, help="methods (default all)")
    parser.add_argument("--print", action="store_true", help="print the tables instead of writing them")
    call = parser.parse_args()
    results = study(call.output, call.short, call.only)
    if call.short or call.print:
        for name, lines in tables(results):
            print(f"\n{name}\n", *lines, sep="\n")
    else:
        write(results)
        draw(results)


if __name__ == "__main__":
    main()
