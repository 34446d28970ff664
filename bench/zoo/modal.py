# SPDX-License-Identifier: BSD-3-Clause
"""Compares the frozen modes of identified models with the true ones. docs/how-to/modes.md has the figures.

    bench/zoo/modal.py --tool build/bin/tokid [--plants REGEX] [--experiments N] [--seeds S] [--exact]

Prints one line for each oscillating mode of a plant: errors of natural frequency (in per cent) and damping ratio, over
all steps and ensembles at which the truth oscillates and `tokid modes` calls the mode valid, and the share of these
whose 95 % intervals hold the truth. The true modes are those of the plant's own matrices, between two steps their mean.
With --exact, the model is the truth in other coordinates, so that only the freezing errs.

    bench/zoo/modal.py --write launch.npz

Writes the experiments on the launch vehicle that docs/how-to/modes.md begins with.
"""

import argparse
import re
import tempfile
from pathlib import Path

import numpy as np
import scipy.linalg

from conditions import Condition
from intervals import run
from plants import PLANTS as EVERY
from run import make_data
from truth import linearise, plant_of, truth_of

PLANTS = ["launch_vehicle", "mass_chain", "crane", "beam", "aircraft", "stiffness_jump"]


def nearest(found, wanted):
    """The entries of `found` (n) in the order of `wanted`, each the nearest that is left, the nearest pair first."""
    distances, result = np.abs(found[:, None] - wanted), np.full(len(wanted), -1)
    for _ in wanted:
        i, j = np.unravel_index(np.argmin(distances), distances.shape)
        result[j], distances[i], distances[:, j] = i, np.inf, np.inf
    return result


def true_poles(plant):
    """Poles s (T, n) of the plant at the steps 1 ... T-1, in columns that follow them from the last step back."""
    found = [np.linalg.eigvals(scipy.linalg.logm(a)) / plant.dt for a in linearise(plant)[0]]
    found[-1] = found[-1][np.argsort(np.abs(found[-1]))]
    for k in range(len(found) - 2, -1, -1):
        found[k] = found[k][nearest(found[k], found[k + 1])]
    found = np.array(found)
    return np.vstack([found[:1], (found[:-1] + found[1:]) / 2])


def write_exact(plant, path, seed):
    """The truth as a model of tokid, in random coordinates at each step."""
    a, b, c, d = linearise(plant)
    steps, n, _ = b.shape
    t = np.random.default_rng(seed).normal(size=(steps + 1, n, n)) + 2 * np.eye(n)
    np.savez(path, A=t[1:] @ a @ np.linalg.inv(t[:-1]), B=t[1:] @ b, C=c @ np.linalg.inv(t[:-1]), D=d,
             G=np.zeros((steps, n, c.shape[1])), state_dim=np.full(steps + 1, n), k_begin=0, dt=plant.dt, frame="raw",
             method="known", initial_state="zero")


def compare(report, truth, jump):
    """Rows of mode, step, frequency, errors of frequency and damping, whether the intervals of both hold the truth, and the
    half width of that of the frequency, relative to the frequency."""
    names = ("frequency", "damping", "poles_real", "poles_imag", "valid", "frequency_lower", "frequency_upper",
             "damping_lower", "damping_upper")
    part = {name: np.array(report[name], float) for name in names if name in report}
    rows = []
    for i, step in enumerate(range(report["begin"], report["begin"] + len(part["frequency"]))):
        poles, wanted = part["poles_real"][i] + 1j * part["poles_imag"][i], truth[step]
        if np.isnan(poles).any() or (jump is not None and abs(step - jump) <= report["window"]):
            continue
        place = nearest(poles, wanted)
        for mode in np.flatnonzero((wanted.imag > 0.2 * np.abs(wanted)) & (np.abs(wanted) > 0.01)):
            j, w = place[mode], np.abs(wanted[mode])
            damping, held = -wanted[mode].real / w, (np.nan, np.nan, np.nan)
            if j < 0 or not part["valid"][i, j]:
                rows.append((mode, step, w, np.nan, np.nan, *held))
                continue
            if "frequency_lower" in part:
                held = [part[f"{name}_lower"][i, j] <= right <= part[f"{name}_upper"][i, j]
                        for name, right in (("frequency", w), ("damping", damping))]
                held.append((part["frequency_upper"][i, j] - part["frequency_lower"][i, j]) / 2 / w)
            rows.append((mode, step, w, part["frequency"][i, j] / w - 1, part["damping"][i, j] - damping, *held))
    return rows


def measure(tool, plant, condition, seed, truth, exact=False, replicates=0, options=()):
    """The rows of `compare` for one ensemble; without replicates, there are no intervals."""
    with tempfile.TemporaryDirectory() as folder:
        data, model, more = Path(folder, "data.npz"), Path(folder, "model.npz"), []
        if exact:
            write_exact(plant_of(plant), model, seed)
        else:
            make_data(f"{plant}/{condition.name}/{seed}", condition, truth_of(plant, condition), data, nonlinear=False)
            run(tool, "identify", data, "-o", model)
            if replicates > 0:
                more = ["--confidence", data, "--replicates", replicates]
        report, _ = run(tool, "modes", model, *more, *options)
    return compare(report, truth, plant_of(plant).jump)


def write_example(path):
    """The experiments of docs/how-to/modes.md on the launch vehicle."""
    condition = Condition()
    make_data("launch", condition, truth_of("launch_vehicle", condition), path, nonlinear=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tool", help="path of tokid")
    parser.add_argument("--write", metavar="FILE", help="write the experiments of docs/how-to/modes.md, and nothing else")
    parser.add_argument("--plants", default="|".join(PLANTS), help="regular expression of the names of plants")
    parser.add_argument("--experiments", type=int, default=40)
    parser.add_argument("--noise", choices=["low", "high"], default="low")
    parser.add_argument("--seeds", type=int, default=5, help="number of ensembles")
    parser.add_argument("--first", type=int, default=1, help="seed of the first ensemble")
    parser.add_argument("--from-step", type=int, default=0, help="first step that is compared")
    parser.add_argument("--replicates", type=int, default=100)
    parser.add_argument("--exact", action="store_true", help="the truth in other coordinates, without noise")
    parser.add_argument("--options", nargs="*", default=[], help="options of `tokid modes`, without their dashes")
    given = parser.parse_args()
    if given.write:
        return write_example(given.write)
    if not given.tool:
        parser.error("--tool: none found, the path of tokid needed")

    options = [f"--{word}" if i % 2 == 0 else word for i, word in enumerate(given.options)]
    print(f"{'plant':16} {'rad/s':>6} {'valid':>6}   {'frequency [%]: median':>8}  95th  worst  in 2 %  coverage"
          "   damping: median   95th  coverage")
    for plant in [name for name in EVERY if re.fullmatch(given.plants, name)]:
        condition = Condition(experiments=given.experiments, noise=given.noise)
        truth, rows = true_poles(plant_of(plant)), []
        for seed in range(given.first, given.first + given.seeds):
            rows += measure(given.tool, plant, condition, seed, truth, given.exact, given.replicates, options)
        rows = np.array([row for row in rows if row[1] >= given.from_step]).reshape(-1, 8)
        for mode in np.unique(rows[:, 0]):
            own = rows[rows[:, 0] == mode]
            valid = own[~np.isnan(own[:, 3])]
            if len(valid) == 0:
                continue
            f, d = 100 * np.abs(valid[:, 3]), np.abs(valid[:, 4])
            print(f"{plant:16} {np.median(own[:, 2]):6.2f} {100 * len(valid) / len(own):5.0f}% {np.median(f):22.3f} "
                  f"{np.percentile(f, 95):6.2f} {f.max():6.2f} {100 * np.mean(f < 2):6.1f}% "
                  f"{100 * np.mean(valid[:, 5]):5.1f} {np.median(d):17.4f} {np.percentile(d, 95):6.4f} "
                  f"{100 * np.mean(valid[:, 6]):5.1f}", flush=True)


if __name__ == "__main__":
    main()
