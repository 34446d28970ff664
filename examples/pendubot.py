#!/usr/bin/env python3
"""A real robot: predictions of twenty measured swing-ups, by models that have not seen them.

    make build
    python3 examples/pendubot.py [--splits 15] [--jobs 2] [--data pendubot.npz]

The pendubot is a double pendulum whose upper joint alone has a motor. Ten runs of its swing-up are plain, ten are
disturbed by random bumps of the torque. A feedback controller is at work in all of them, the joints stick, and the
equilibrium is not stable: no model can simulate the whole manoeuvre, so predictions are judged.

The runs come from github.com/dfki-ric-underactuated-lab/double_pendulum, leaderboard/pendubot/real_hardware_v2 and
real_hardware_perturbed_v2, ilqr_tvlqr_lqr/experiment01 ... 10/trajectory.csv. Please cite Wiebe, Kumar et al., "An Open
Source Dual Purpose Acrobot and Pendubot Platform". pendubot.npz holds them on an even grid of 195 steps of 20 ms:

    u          (20, 195, 2)  measured joint torques [N m], mean from one step to the next
    y          (20, 195, 4)  positions [rad] and velocities [rad/s] of both joints, at the step
    perturbed  (20)          runs with bumps

In split s, numpy.random.default_rng(s).permutation(N), the first int(0.7 N) runs identify, and the others are predicted
over 1, 5, 10 and 20 steps. Predictions over h steps are judged from step 3 + h on. The fit is 100 % for a perfect
prediction and 0 % for the mean of the training runs, which also stands in where there is no prediction. The tool
chooses everything: mean motion, lag order, smoothing over time, states, refinement.
"""
# SPDX-License-Identifier: BSD-3-Clause

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import tool

HORIZONS = (1, 5, 10, 20)
FIRST = 4  # step that is judged of predictions over one step
POSITIONS = 2

# Fits [pos1, pos2] over 1, 5, 10, 20 steps of ARX models on the same splits: coefficients of each step from 1 to 8
# neighbouring steps together, and coefficients with a penalty on their variation.
PUBLISHED = {
    "all": {"ARX varying in time, pooled": [(96.8, 95.5), (84, 71), (67, 38), (41, 3)],
            "ARX smoothed over time": [(97.5, 96.7), (86, 76), (65, 42), (28, -3)]},
    "plain": {"ARX varying in time, pooled": [(94.7, 91.6), (82, 64), (69, 35), (43, 11)],
              "ARX smoothed over time": [(95.1, 92.8), (86, 73), (75, 49), (53, 25)]},
    "perturbed": {"ARX varying in time, pooled": [(97.1, 96.4), (86, 77), (71, 50), (53, 14)],
                  "ARX smoothed over time": [(97.5, 96.7), (88, 78), (74, 46), (55, -1)]},
}


def fits(u, y, split):
    """Fit [%] (horizons, positions) on the runs that split keeps back, and the report of the identification."""
    order = np.random.default_rng(split).permutation(len(y))
    training, fresh = np.split(order, [int(0.7 * len(y))])
    with tempfile.TemporaryDirectory() as folder:
        paths = {name: Path(folder) / f"{name}.npz" for name in ("training", "fresh", "model", "predicted")}
        np.savez(paths["training"], u=u[training], y=y[training], dt=0.02)
        np.savez(paths["fresh"], u=u[fresh], y=y[fresh], dt=0.02)
        report = tool.report("identify", paths["training"], "-o", paths["model"])
        mean = y[training].mean(axis=0)
        result = []
        for horizon in HORIZONS:
            tool.run("predict", paths["model"], paths["fresh"], "-o", paths["predicted"], "--horizon", horizon)
            with np.load(paths["predicted"]) as file:
                predicted = file["y"]
            predicted = np.where(np.isnan(predicted), mean, predicted)
            judged = np.s_[:, FIRST + horizon - 1:, :POSITIONS]
            error = np.sum((y[fresh] - predicted)[judged] ** 2, axis=(0, 1))
            departure = np.sum((y[fresh] - mean)[judged] ** 2, axis=(0, 1))
            result.append(100 * (1 - np.sqrt(error / departure)))
    return np.array(result), report


def row(name, values):
    """One line of the table: both positions and their mean, for each horizon."""
    cells = [f"{a:6.1f} {b:6.1f} {(a + b) / 2:6.1f}" for a, b in values]
    return f"{name:<30}" + "  ".join(cells)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splits", type=int, default=15, help="random splits (default 15)")
    parser.add_argument("--sets", nargs="+", choices=PUBLISHED, default=list(PUBLISHED), help="runs (default all sets)")
    parser.add_argument("--jobs", type=int, default=2, help="splits at a time (default 2)")
    parser.add_argument("--data", type=Path, help="pendubot.npz (default: in $TOKID_DATA/pendubot)")
    call = parser.parse_args()
    path = call.data or tool.data_folder() / "pendubot" / "pendubot.npz"
    if not path.exists():
        sys.exit(f"{path} is absent; examples/pendubot.py says where the runs come from")
    with np.load(path) as file:
        u, y, perturbed = file["u"], file["y"], file["perturbed"].astype(bool)
    runs = {"all": np.arange(len(y)), "plain": np.flatnonzero(~perturbed), "perturbed": np.flatnonzero(perturbed)}

    print(f"Fit of held-out runs [%], mean of {call.splits} splits: pos1, pos2, their mean")
    print(f"{'':<30}" + "  ".join(f"{f'{h} step' + 's' * (h > 1):>20}" for h in HORIZONS))
    for name in call.sets:
        print(f"{name} ({len(runs[name])} runs)")
        for model, values in PUBLISHED[name].items():
            print(row(f"  {model}", values))
        for outputs, label in ((POSITIONS, "tokid"), (y.shape[2], "tokid, with velocities")):
            part = u[runs[name]], y[runs[name]][:, :, :outputs]
            with ThreadPoolExecutor(call.jobs) as pool:
                results = list(pool.map(lambda split, part=part: fits(*part, split), range(call.splits)))
            print(row(f"  {label}"[:30], np.mean([values for values, _ in results], axis=0)), flush=True)


if __name__ == "__main__":
    main()
