# SPDX-License-Identifier: BSD-3-Clause
"""Prints the results of bench/zoo/run.py as Markdown tables.

    bench/zoo/table.py results.jsonl [older.jsonl]

Regret: the error 20 steps ahead of the default over the least one that is known of the cell: that of the best options
of the grid, of maximum likelihood from the truth, or of a rival. Of an older file, the error 20 steps ahead stands
beside the others. Of measured ensembles, a table has the errors relative to the best rival at each horizon. The last
table counts how far the models of each verdict are from the best that is known: from the truth, where the cell has no
other.
"""

import json
import sys
from pathlib import Path

import numpy as np

MEASURES = {"ahead": "20 steps", "one_step": "one step", "one_step_start": "start", "one_step_jump": "jump",
            "pulse": "pulse", "control": "LQG", "regret": "regret"}
ERRORS = ("one_step", "five_steps", "ahead")  # of measured ensembles, at the horizons of bench/compare


def read(path):
    """Results by cell and options."""
    lines = [json.loads(line) for line in Path(path).read_text().splitlines()]
    return {(line["cell"], line["options"]): line for line in lines}


def value(line, measure):
    """A measure of a line; NaN where it was not measured. Those of a run that failed are infinite."""
    found = line.get(measure, np.inf if "error" in line else None)
    return np.nan if found is None else found


def regret(results, cell):
    """The default's error over the least one that is known; NaN if there is no other."""
    errors = [value(line, "ahead") for (name, _), line in results.items() if name == cell]
    default, best = value(results[cell, "default"], "ahead"), min(errors)
    return np.nan if len(errors) == 1 else 1.0 if default == best else default / best


def shown(number):
    return "–" if np.isnan(number) else f"{number:.3g}"


def choice(line, name):
    found = line.get(name)
    return "–" if found is None else f"{found:.3g}" if isinstance(found, float) else str(found)


def row(*fields):
    print("|", " | ".join(fields), "|")


def cell_table(defaults, older):
    row("cell", *MEASURES.values(), *(["older"] if older else []), "n", "p", "λ", "EM", "s")
    row(*["---"] * (len(MEASURES) + 6 + bool(older)))
    for cell, line in sorted(defaults.items(), key=lambda item: -np.nan_to_num(item[1]["ahead"], nan=np.inf)):
        before = [shown(value(older.get((cell, "default"), {}), "ahead"))] if older else []
        choices = [choice(line, name) for name in ("states", "lags", "smoothing", "iterations", "seconds")]
        row(cell, *(shown(value(line, name)) for name in MEASURES), *before, *choices)


def percentiles(defaults):
    row("", "median", "95th percentile", "worst", "cells")
    row(*["---"] * 5)
    for name, words in MEASURES.items():
        values = np.array([value(line, name) for line in defaults.values()])
        values = np.sort(values[~np.isnan(values)])
        if len(values):
            places = (len(values) // 2, int(np.ceil(0.95 * len(values))) - 1, -1)
            row(words, *(shown(values[place]) for place in places), str(len(values)))


def recorded_table(results, cells):
    """The errors of the default over the least one of its rivals, at each horizon."""
    row("measured", "1 step", "5 steps", "20 steps", "verdict", "n", "p", "s")
    row(*["---"] * 8)
    ratios = []
    for cell in cells:
        default = results[cell, "default"]
        rivals = [line for (name, options), line in results.items() if name == cell and options != "default"]
        ratios.append([value(default, error) / min(value(line, error) for line in rivals)
                       for error in ERRORS])
        row(cell, *map(shown, ratios[-1]), *(choice(default, name) for name in ("verdict", "states", "lags", "seconds")))
    row("geometric mean", *map(shown, np.exp(np.log(ratios).mean(axis=0))), *[""] * 4)


def calibration(defaults):
    near = (1.05, 1.15, 1.5)
    row("verdict", "cells", *(f"at most {limit:g}" for limit in near))
    row(*["---"] * (2 + len(near)))
    for verdict in ("good", "look closer", "don't trust"):
        best = np.array([value(line, "ahead" if np.isnan(line["regret"]) else "regret") for line in defaults.values()
                         if line.get("verdict") == verdict])
        if len(best):
            row(verdict, str(len(best)), *(f"{100 * np.mean(best <= limit):.0f} %" for limit in near))


def main():
    results, older = read(sys.argv[1]), read(sys.argv[2]) if len(sys.argv) > 2 else {}
    defaults = {cell: {**line, "ahead": value(line, "ahead"), "regret": regret(results, cell)}
                for (cell, options), line in results.items() if options == "default"}
    recorded = {cell: line for cell, line in defaults.items() if line.get("recorded")}
    plants = {cell: line for cell, line in defaults.items() if cell not in recorded}
    if plants:
        cell_table(plants, older)
        print()
        percentiles(plants)
        print()
    if recorded:
        recorded_table(results, recorded)
        print()
    calibration(defaults)


if __name__ == "__main__":
    main()
