# SPDX-License-Identifier: BSD-3-Clause
"""The data of the comparison: plants of bench/zoo with noise, made from seeds, and the runs of a robot."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Optional
from zlib import crc32

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "bench" / "zoo"), str(ROOT / "examples")]

import tool  # noqa: E402 - after the path is set
from conditions import Condition  # noqa: E402
from measures import of_truth  # noqa: E402
from truth import experiments, normal, simulate, truth_of  # noqa: E402

from predictors import Departures, StateSpace  # noqa: E402

PLANTS = ("launch_vehicle", "batch_reactor", "crane", "stiffness_jump", "invariant_structure")
FRESH = 100  # experiments that judge
ROBOT = "robot"
TRAINING_SHARE = 0.7  # of measured runs


@dataclass(frozen=True)
class Ensemble:
    """Training experiments u (N, T, r), y (N, T, m), fresh ones, and what else is known of a plant."""

    u: np.ndarray
    y: np.ndarray
    fresh_u: np.ndarray
    fresh_y: np.ndarray
    dt: float  # [s]
    free_y: Optional[np.ndarray] = None  # free responses, which SystemID alone needs: as many as experiments
    truth: Optional[Departures] = None  # the Kalman filter of the true plant


def of_plant(name, count, noise, seed):
    """Experiments of a plant on its nominal trajectory, with zero initial departures."""
    condition = Condition(experiments=count, noise=noise)
    truth = truth_of(name, condition)
    plant, system = truth.plant, truth.system
    nominal_u = plant.u
    nominal_y = np.array([plant.output(plant.x[k : k + 1], plant.u[k : k + 1], k)[0] for k in range(plant.steps)])
    first = crc32(f"compare/{name}/{condition.name}/{seed}".encode())

    def measured(number, of_seed):
        u, y, _ = experiments(truth, number, of_seed, nonlinear=True)
        return u.transpose(1, 0, 2) + nominal_u, y.transpose(1, 0, 2) + nominal_y

    rng = np.random.default_rng(first + 2)
    none = np.zeros((plant.steps, count, nominal_u.shape[1]))
    starts = rng.normal(size=(count, len(system.P0))) * plant.x_std
    _, free_y, _ = simulate(truth.step, truth.output, None, starts, none, normal(rng, system.Q, count),
                            normal(rng, system.R, count))
    best = of_truth(system)
    known = Departures(StateSpace(best.A, best.B, best.C, best.D, best.L), nominal_u, nominal_y)
    return Ensemble(*measured(count, first), *measured(FRESH, first + 1), plant.dt, free_y.transpose(1, 0, 2), known)


def parted(count, split):
    """The runs for training and the fresh ones, of measured runs in random order."""
    return np.split(np.random.default_rng(split).permutation(count), [int(TRAINING_SHARE * count)])


def robot_path():
    return tool.data_folder() / "pendubot" / "pendubot.npz"


def of_robot(split):
    """The runs and the splits of examples/pendubot.py: both torques, both positions."""
    with np.load(robot_path()) as file:
        u, y = file["u"], file["y"][:, :, :2]
    training, fresh = parted(len(y), split)
    return Ensemble(u[training], y[training], u[fresh], y[fresh], 0.02)
