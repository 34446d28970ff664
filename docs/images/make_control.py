#!/usr/bin/env python3
"""Draws docs/images/control.svg with the Python package. Needs Matplotlib; no test runs it.

    make build
    PYTHONPATH=build/python build/venv/bin/python docs/images/make_control.py [OUT]

OUT is the picture (control.svg beside this script; .png works too).
"""
# SPDX-License-Identifier: BSD-3-Clause

import sys
import warnings
from pathlib import Path

import numpy as np
from make_result import CLOSED, INK, MUTED, OPEN, plain, plt, save, title

import tokid

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "bench" / "zoo"))
import conditions  # noqa: E402
import measures  # noqa: E402
import truth as truths  # noqa: E402

PLANTS = {"batch_reactor": 1, "battery": 0, "crane": 0}  # and the output that follows a reference


def without_inputs(system, experiments):
    """Outputs (N, T, m) of experiments with nominal inputs."""
    rng, outputs = np.random.default_rng(3), []
    x = np.zeros((experiments, system.states))
    for a, c, q, r in zip(system.A, system.C, system.Q, system.R):
        outputs.append(x @ c.T + rng.multivariate_normal(np.zeros(len(r)), r, experiments))
        x = x @ a.T + rng.multivariate_normal(np.zeros(len(q)), q, experiments)
    return np.stack(outputs, axis=1)


def closed_loop():
    """Time, and the first output of 20 experiments: with the nominal inputs alone, and with the LQG controller."""
    noise = {"process_noise": 0.05, "measurement_noise": 0.05}
    system = tokid.example_system("oscillator", steps=60, **noise)
    model = tokid.identify(tokid.example("oscillator", experiments=60, steps=60, **noise), states=4)
    loop = model.lqr(1.0, 0.1).simulate(system, experiments=20, seed=3)
    return np.arange(60) * system.dt, without_inputs(system, 20)[:, :, 0], loop.data.y[:, :, 0]


def errors(designed, truth, output):
    """RMS errors of the runs of a nonlinear plant, relative to the first."""
    change = 0.05 * truth.plant.u_std**-2
    found = measures.learning_errors(truth, output, lambda reference, u, y, weight: designed.learn(
        reference, u, y, error_weight=weight, input_change_weight=change).u)
    return found / found[0]


def learning():
    """Errors by the identified model and by the true linearisation, for each plant."""
    found = {}
    for plant, output in PLANTS.items():
        truth = truths.truth_of(plant, conditions.Condition(experiments=60))
        u, y, _ = truths.experiments(truth, 60, 7, nonlinear=True)
        model = tokid.identify(u.transpose(1, 0, 2), y.transpose(1, 0, 2), dt=truth.plant.dt)
        s = truth.system
        known = tokid.Model.from_matrices(s.A, s.B, s.C, s.D, dt=truth.plant.dt, Q=s.Q, R=s.R)
        found[plant] = errors(model, truth, output), errors(known, truth, output)
    return found


def main():
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "control.svg"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tokid.TokidWarning)
        time, idle, controlled = closed_loop()
        found = learning()
    plt.rcParams.update({"font.family": "DejaVu Sans", "mathtext.fontset": "dejavusans", "svg.hashsalt": "tokid"})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.3), facecolor="white")
    figure.subplots_adjust(left=0.06, right=0.97, top=0.83, bottom=0.15, wspace=0.2)
    left.plot(time, idle.T, color=OPEN, lw=0.6, alpha=0.7)
    left.plot(time, controlled.T, color=CLOSED, lw=0.6, alpha=0.7)
    left.annotate("nominal inputs alone", (0.03, 0.93), xycoords="axes fraction", color=OPEN, fontsize=9.5)
    left.annotate("with the controller", (0.03, 0.85), xycoords="axes fraction", color=CLOSED, fontsize=9.5)
    title(left, "Departures from the nominal trajectory", "first output of the oscillator, 20 experiments with noise")
    for (plant, (by_model, by_truth)), colour in zip(found.items(), (OPEN, CLOSED, INK)):
        right.semilogy(by_model, "-o", ms=3.5, color=colour, lw=1.3, label=plant.replace("_", " "))
        right.semilogy(by_truth, "--", color=colour, lw=1.0)
    right.legend(frameon=False, labelcolor=MUTED, fontsize=9)
    title(right, "Learning from run to run", "error of nonlinear plants, relative to run 0; dashed: true linearisation")
    left.set_xlabel("time [s]", fontsize=9, color=MUTED)
    right.set_xlabel("run", fontsize=9, color=MUTED)
    for axes in (left, right):
        plain(axes)
    save(figure, out)


if __name__ == "__main__":
    main()
