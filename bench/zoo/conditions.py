# SPDX-License-Identifier: BSD-3-Clause
"""The conditions under which the plants are measured, and the cells of the study."""

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from draws import condition_drawn, drawn
from plants import PLANTS


@dataclass(frozen=True)
class Condition:
    """How the data of a plant are made."""

    experiments: int = 40  # N
    noise: str | float = "low"  # low: about 2 % of the outputs; high: about 15 %; or the share that measurement has
    coloured: bool = False  # measurement noise: white, or first-order autoregressive with pole 0.8
    loop: str = "natural"  # natural (delayed where the plant is unstable, else open), delayed, same-step
    initial: str = "zero"  # zero or unknown
    units: str = "natural"  # natural or scaled: by powers of ten from 1e-4 to 1e4

    @property
    def name(self):
        noise = self.noise if isinstance(self.noise, str) else f"{self.noise:.0e}"
        words = [f"N{self.experiments}", noise, "coloured" if self.coloured else "white"]
        words += [value for value in (self.loop, self.units) if value != "natural"]
        return "-".join(words + (["unknown"] if self.initial == "unknown" else []))

    def loop_of(self, plant):
        """open, delayed or same-step."""
        return self.loop if self.loop != "natural" else "delayed" if plant.closed else "open"


BASE = Condition()
VARIANTS = [
    Condition(experiments=15),
    Condition(experiments=100, noise="high"),
    Condition(loop="delayed", noise="high"),
    Condition(coloured=True, initial="unknown"),
    Condition(experiments=100, units="scaled"),
    Condition(noise="high", initial="unknown"),
    Condition(loop="same-step"),
    Condition(experiments=15, noise="high", units="scaled"),
    Condition(experiments=100, coloured=True, noise="high"),
    Condition(experiments=15, loop="delayed", initial="unknown"),
    Condition(experiments=100, initial="unknown"),
    Condition(coloured=True, loop="delayed", units="scaled"),
]
WITH_FEEDTHROUGH = {"oscillator", "battery", "suspension"}  # the output needs the input of the same step
SHORT = ["oscillator/N40-low-white", "stiffness_jump/N40-low-white", "stage_separation/N40-low-white",
         "invariant_delay/N40-low-white", "rotor/N40-low-white", "gear_shift/N40-low-white"]


def cells():
    """Name -> (plant, condition). Every plant has the base and five of the variants, others for its neighbours."""
    chosen = {}
    for i, plant in enumerate(PLANTS):
        for condition in [BASE, *(VARIANTS[(5 * i + j) % len(VARIANTS)] for j in range(5))]:
            if condition.loop == "same-step" and plant in WITH_FEEDTHROUGH:
                condition = replace(condition, loop="delayed")
            chosen[f"{plant}/{condition.name}"] = plant, condition
    return chosen


def drawn_cells(begin, end):
    """Those of the seeds begin ... end-1 of draws.py."""
    found = {}
    for seed in range(begin, end):
        condition = Condition(**condition_drawn(seed, drawn(seed).closed))
        found[f"draw-{seed}/{condition.name}"] = f"draw-{seed}", condition
    return found


def short_cells():
    """A few quick cells."""
    everything = cells()
    return {name: everything[name] for name in SHORT}


def scales(cell, condition, inputs, outputs):
    """Factors of the inputs (r) and of the outputs (m) from the units of the plant to those of the data."""
    if condition.units == "natural":
        return np.ones(inputs), np.ones(outputs)
    powers = 10.0 ** np.random.default_rng(crc32(cell.encode())).integers(-4, 5, inputs + outputs)
    return powers[:inputs], powers[inputs:]
