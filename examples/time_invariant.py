#!/usr/bin/env python3
"""Time-invariant systems as a special case: one long record, one model for all of its steps.

    make build
    python3 examples/time_invariant.py [--data FOLDER]

Three benchmarks of DaISy (KU Leuven), as github.com/SLICOT/SLICOT-SystemIdentification (robot arm, CD player arm) and
github.com/SLICOT/SLICOT-Reference (IB01BD.dat) distribute them. FOLDER holds slicot_ib01.csv, robot_arm.csv and
cd_player_arm.csv with a header and a column for each input u... and output y....

The first half of each record identifies a model of the given order, the second half judges it: fit of the simulation
and of predictions over one step, beside those of n4sid (Octave's control package 3.4.0) at the same order. Then the
poles of the first system, from the whole record, beside those that SLICOT publishes. At last the same record is cut
into 40 experiments of 25 steps, to see what it costs to let the model vary where the system doesn't: every fifth
experiment is held out.
"""
# SPDX-License-Identifier: BSD-3-Clause

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import tool

# states, detrended, fits of n4sid [%]: simulation and one step, for each output
RECORDS = {
    "slicot_ib01": (4, False, [85.7], [95.4]),
    "robot_arm": (4, False, [95.8], [98.6]),
    "cd_player_arm": (8, True, [57.9, 77.0], [81.8, 80.6]),
}
SLICOT_POLES = np.array([0.4758 - 0.2001j, 0.4758 + 0.2001j, 0.7455, 0.9611])
# The method and the number of block rows of that publication.
SLICOT_METHOD = ("--weighting", "projection", "--lags", 15, "--nominal", "none", "--no-refine")
LENGTH, EVERY = 25, 5  # steps of an experiment that is cut out; one experiment in so many is held out


def load(folder, name):
    """u (T, r) and y (T, m)."""
    path = folder / f"{name}.csv"
    if not path.exists():
        sys.exit(f"{path} is absent; examples/time_invariant.py says where the records come from")
    with open(path, encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        table = np.loadtxt(file, delimiter=",", ndmin=2)
    return tuple(table[:, [i for i, name in enumerate(names) if name.startswith(kind)]] for kind in "uy")


def identify(u, y, folder, *options):
    """The path of the model."""
    np.savez(folder / "data.npz", u=u, y=y)
    tool.run("identify", folder / "data.npz", "-o", folder / "model.npz", *options)
    return folder / "model.npz"


def validate(model, u, y, folder):
    np.savez(folder / "fresh.npz", u=u, y=y)
    return tool.report("validate", model, folder / "fresh.npz")


def compare(record, u, y, folder):
    """Identified from the first half, validated on the second."""
    states, detrended, *published = RECORDS[record]
    half = len(u) // 2
    if detrended:
        u, y = u - u[:half].mean(axis=0), y - y[:half].mean(axis=0)
    model = identify(u[:half], y[:half], folder, "--time-invariant", "--states", states)
    found = validate(model, u[half:], y[half:], folder)
    for j, output in enumerate(found["output_names"]):
        values = [found[key][j] for key in ("simulation_fit", "one_step_fit")]
        print(f"{record if j == 0 else '':<15}{output:<7}{values[0]:9.1f} {published[0][j]:9.1f}   "
              f"{values[1]:9.1f} {published[1][j]:9.1f}")


def poles(u, y, folder):
    with np.load(identify(u, y, folder, "--time-invariant", "--states", len(SLICOT_POLES), *SLICOT_METHOD)) as model:
        return np.sort_complex(np.linalg.eigvals(model["A"][0]))


def cut(u, y, folder):
    """Simulation fit on experiments held out, of the varying and of the time-invariant model."""
    u, y = (x[:len(x) // LENGTH * LENGTH].reshape(-1, LENGTH, x.shape[1]) for x in (u, y))
    fresh = np.arange(len(u)) % EVERY == EVERY - 1
    for label, options in (("varying", []), ("time-invariant", ["--time-invariant"])):
        model = identify(u[~fresh], y[~fresh], folder, *options)
        fit = validate(model, u[fresh], y[fresh], folder)["simulation_fit"][0]
        print(f"  {label:<20}{fit:6.1f} %")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder of the records (default: lti in $TOKID_DATA)")
    folder = parser.parse_args().data or tool.data_folder() / "lti"
    records = {name: load(folder, name) for name in RECORDS}
    with tempfile.TemporaryDirectory() as temporary:
        scratch = Path(temporary)
        print("Fit on the second half [%]   simulation              one step")
        print("record         output     tokid     n4sid       tokid     n4sid")
        for name, (u, y) in records.items():
            compare(name, u, y, scratch)
        found = poles(*records["slicot_ib01"], scratch)
        print("\nPoles of slicot_ib01, whole record\n  tokid   ", *(f"{p:.4f}" for p in found))
        print("  SLICOT  ", *(f"{p:.4f}" for p in SLICOT_POLES))
        print(f"  largest difference {np.abs(found - SLICOT_POLES).max():.4f}")
        print(f"\nsimulation fit of held-out experiments, slicot_ib01 cut into experiments of {LENGTH} steps")
        cut(*records["slicot_ib01"], scratch)


if __name__ == "__main__":
    main()
