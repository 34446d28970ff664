#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Write 25 .csv files as a batch plant logs them: python3 batch_plant.py FOLDER

A jacketed reactor runs an exothermic reaction. The operators vary the cooling valve around its recipe. Each file has two
lines before the header, units in the header, samples that the logger marked as Bad, and a length of its own.
"""

import sys
from pathlib import Path

import numpy as np

SAMPLE_TIME = 10.0  # [s]
STEPS = 90


def recipe(k):
    """Cooling valve [%]: closed while the reaction starts, then open against the exotherm."""
    return 20.0 + 45.0 / (1.0 + np.exp(-(k - 30) / 6.0)) - 25.0 / (1.0 + np.exp(-(k - 65) / 8.0))


def batch(rng, steps):
    """Valve [%], temperature [degC] and pressure [bar] of one batch."""
    concentration = 1.0 + 0.02 * rng.standard_normal()  # of the reactant, relative to the recipe
    temperature, jacket = 45.0 + 0.5 * rng.standard_normal(), 40.0
    rows, move = [], 0.0
    for k in range(steps):
        if k % 3 == 0:
            move = 4.0 * rng.standard_normal()
        valve = recipe(k) + move
        pressure = 1.0 + 0.012 * (temperature - 40.0) + 0.8 * (1.0 - concentration)
        rows.append([valve, temperature, pressure])
        for _ in range(10):  # steps of integration in a sample
            h = SAMPLE_TIME / 10
            rate = 0.004 * np.exp(0.055 * (temperature - 55.0)) * max(concentration, 0.0)
            concentration -= h * rate
            heat = 45.0 * rate - 0.006 * (temperature - jacket)
            temperature += h * (heat + 0.003 * rng.standard_normal())
            jacket += h * (62.0 - 0.6 * valve - jacket) / 60.0
    noise = rng.standard_normal((steps, 2)) * [0.05, 0.002]
    return np.array(rows) + np.column_stack([np.zeros(steps), noise])


def write(path, number, samples, rng):
    lines = [f"Reactor R2, batch {number}", "logged by the process control system", "t [s],valve [%],T [degC],p [bar]"]
    for k, row in enumerate(samples):
        cells = [f"{SAMPLE_TIME * k:g}", *(f"{value:.3f}" for value in row)]
        if rng.random() < 0.01:
            cells[rng.integers(2, 4)] = "Bad"
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(folder, batches=25):
    rng = np.random.default_rng(7)
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    for number in range(1, batches + 1):
        steps = STEPS - int(rng.integers(0, 8))
        write(folder / f"batch{number}.csv", number, batch(rng, steps), rng)


if __name__ == "__main__":
    main(sys.argv[1])
