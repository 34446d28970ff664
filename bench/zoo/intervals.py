# SPDX-License-Identifier: BSD-3-Clause
"""Counts how often the intervals of `tokid confidence` hold the true pulse responses.

    bench/zoo/intervals.py --tool build/bin/tokid [--plants REGEX] [--experiments N] [--seeds S]

Prints one line for each plant: the share of the entries h(k, i) whose nominal 95 % interval holds the truth,
away from the jumps of the plant and near them, and the size of the intervals. An entry is near a jump if a step from i
to k is within 10 steps of it. The experiments are those of the linear truth, so that only the identification errs.
"""

import argparse
import json
import re
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from conditions import Condition
from measures import of_truth
from plants import PLANTS as EVERY
from run import make_data
from truth import truth_of

NEAR = 10  # steps
PLANTS = ["oscillator", "battery", "launch_vehicle", "rotor", "gear_shift", "stage_separation", "stiffness_jump"]


def true_responses(truth, begin, band):
    """The entries h(k, k-g) in the layout of the file (S, band+1, m, r); NaN before the step `begin`."""
    p = of_truth(truth.system)
    steps, m, r = len(p.A), p.C.shape[1], p.B.shape[2]
    found = np.full((steps, band + 1, m, r), np.nan)
    found[:, 0] = p.D
    for k in range(steps):
        back = p.C[k]
        for g in range(1, min(band, k - begin) + 1):
            found[k, g] = back @ p.B[k - g]
            back = back @ p.A[k - g]
    return found[begin:]


def near_jump(truth, begin, shape):
    """Which entries of the layout above are near a jump."""
    jump = truth.plant.jump
    k, g = np.arange(begin, begin + shape[0])[:, None], np.arange(shape[1])
    near = np.zeros(shape[:2], bool) if jump is None else (k >= jump - NEAR) & (k - g < jump + NEAR)
    return np.broadcast_to(near[:, :, None, None], shape)


def run(tool, *words):
    """The JSON that a command of the tool prints, and its seconds."""
    begin = time.monotonic()
    done = subprocess.run([tool, *map(str, words), "--threads", "1", "--json"], capture_output=True, text=True,
                          check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip())
    return json.loads(done.stdout), time.monotonic() - begin


def counts(file, truth, factor):
    """Of the entries away from jumps and near them: held, all, finite; squares of half widths, errors and responses."""
    lower, value, upper = (file[f"markov{end}"] for end in ("_lower", "", "_upper"))
    begin = int(file["k_begin"])
    right = true_responses(truth, begin, lower.shape[1] - 1) * factor
    judged, near = ~np.isnan(lower) & ~np.isnan(right), near_jump(truth, begin, lower.shape)
    held, sums = (lower <= right) & (right <= upper), []
    for part in (judged & ~near, judged & near):
        finite = part & np.isfinite(lower)
        squares = ((upper - lower) / 2, value - right, right)
        sums.append([held[part].sum(), part.sum(), finite.sum(), *((each[finite] ** 2).sum() for each in squares)])
    return np.array(sums)


def measure(tool, plant, condition, seed, replicates=100):
    """One ensemble: the counts, the seconds of identify and confidence, and the kinds of findings."""
    truth = truth_of(plant, condition)
    with tempfile.TemporaryDirectory() as folder:
        data, model, bounds = (Path(folder, name) for name in ("data.npz", "model.npz", "bounds.npz"))
        u_scale, y_scale = make_data(f"{plant}/{condition.name}/{seed}", condition, truth, data, nonlinear=False)
        _, identified = run(tool, "identify", data, "-o", model)
        report, seconds = run(tool, "confidence", model, data, "-o", bounds, "--replicates", replicates)
        kinds = {finding["kind"] for finding in report["findings"]}
        return counts(np.load(bounds), truth, y_scale[:, None] / u_scale), identified, seconds, kinds


def shown(sums):
    """Coverage, half width and error over the size of the responses, and the share of finite intervals, in per cent."""
    held, judged, finite, width, error, size = sums
    figures = [100 * held / judged if judged else np.nan, 100 * np.sqrt(width / size) if finite else np.nan,
               100 * np.sqrt(error / size) if finite else np.nan, 100 * finite / judged if judged else np.nan]
    return " ".join("     –" if np.isnan(figure) else f"{figure:6.1f}" for figure in figures)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tool", required=True, help="path of tokid")
    parser.add_argument("--plants", default="|".join(PLANTS), help="regular expression of the names of plants")
    parser.add_argument("--experiments", type=int, nargs="+", default=[40])
    parser.add_argument("--noise", choices=["low", "high"], default="low")
    parser.add_argument("--initial", choices=["zero", "unknown"], default="zero")
    parser.add_argument("--seeds", type=int, default=5, help="number of ensembles")
    parser.add_argument("--first", type=int, default=1, help="seed of the first ensemble")
    parser.add_argument("--replicates", type=int, default=100)
    given = parser.parse_args()

    print(f"{'':23} {'away from jumps':^27}   {'near a jump':^27}")
    print(f"{'plant':18} {'N':>4}  " + "   ".join([" holds  width  error finite"] * 2)
          + "   identify  bounds  findings")
    for plant in [name for name in EVERY if re.fullmatch(given.plants, name)]:
        for experiments in given.experiments:
            condition = Condition(experiments=experiments, noise=given.noise, initial=given.initial)
            seeds = range(given.first, given.first + given.seeds)
            sums, identified, seconds, kinds = zip(*(measure(given.tool, plant, condition, seed, given.replicates)
                                                     for seed in seeds))
            away, near = sum(sums)
            print(f"{plant:18} {experiments:4}  {shown(away)}   {shown(near)}   "
                  f"{np.mean(identified):6.1f} s {np.mean(seconds):5.1f} s  {' '.join(sorted(set.union(*kinds)))}",
                  flush=True)


if __name__ == "__main__":
    main()
