# SPDX-License-Identifier: BSD-3-Clause
"""The truth of a plant under a condition: its linearisation, noise, feedback and exact Kalman filter, and experiments.

Arrays over time have the step first. Experiments are (T, N, channels); files have (N, T, channels).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Callable, Optional

import numpy as np
from scipy.linalg import block_diag

from draws import drawn
from plants import PLANTS

POLE = 0.8  # of coloured measurement noise
SHARES = {"low": (0.010, 0.015), "high": (0.08, 0.12)}  # of the outputs' rms: by process and by measurement noise


@dataclass(frozen=True)
class System:
    """x[k+1] = A x + B u + w, y = C x + D u + v with the covariances Q, R of w, v and P0 of x[0]."""

    A: np.ndarray  # (T, n, n)
    B: np.ndarray  # (T, n, r)
    C: np.ndarray  # (T, m, n)
    D: np.ndarray  # (T, m, r)
    Q: np.ndarray  # (T, n, n)
    R: np.ndarray  # (T, m, m)
    P0: np.ndarray  # (n, n)

    def step(self, x, u, k):
        return x @ self.A[k].T + u @ self.B[k].T

    def output(self, x, u, k):
        return x @ self.C[k].T + u @ self.D[k].T


@dataclass(frozen=True)
class Law:
    """Output feedback u = e - K x_hat. x_hat knows outputs up to k-1; with `same_step`, up to k."""

    system: System
    K: np.ndarray  # (T, r, n)
    L: np.ndarray  # (T, n, m), of the predicted state
    filtered: np.ndarray  # (T, n, m), of the correction by the output of the same step
    same_step: bool = False


@dataclass(frozen=True)
class Truth:
    """What is known of a cell. The system has the states of coloured noise behind those of the plant."""

    plant: object
    system: System
    law: Optional[Law]  # None: open loop
    step: Callable  # nonlinear deviations, with the states of coloured noise
    output: Callable
    y_rms: np.ndarray  # of the outputs without noise (m)
    y_scale: np.ndarray  # expected deviation of the outputs (m), for weights


def jacobian(function, x, u, k):
    """Derivatives of function(x, u, k) by x and by u, by a complex step."""
    n, z = x.size, np.concatenate([x, u])
    moved = z + 1e-30j * np.eye(z.size)
    derivative = function(moved[:, :n], moved[:, n:], k).imag.T / 1e-30
    return derivative[:, :n], derivative[:, n:]


def linearise(plant):
    """A, B, C, D (T, ...) along the nominal trajectory."""
    steps = [jacobian(plant.step, plant.x[k], plant.u[k], k) for k in range(plant.steps)]
    outputs = [jacobian(plant.output, plant.x[k], plant.u[k], k) for k in range(plant.steps)]
    return tuple(np.array(part) for pairs in (steps, outputs) for part in zip(*pairs))


def kalman(system):
    """Gains L of the predicted state (T, n, m), gains of the filtered state (T, n, m), innovation covariances."""
    p, gains, corrections, covariances = system.P0, [], [], []
    for a, c, q, r in zip(system.A, system.C, system.Q, system.R):
        s = c @ p @ c.T + r
        scale = 1 / np.sqrt(np.diag(s))
        correction = np.linalg.solve(s * np.outer(scale, scale), scale[:, None] * (c @ p)).T * scale
        rest = np.eye(len(p)) - correction @ c
        p = rest @ p @ rest.T + correction @ r @ correction.T  # Joseph
        p = a @ p @ a.T + q
        gains.append(a @ correction)
        corrections.append(correction)
        covariances.append(s)
    return np.array(gains), np.array(corrections), np.array(covariances)


def lqr(matrices, wy, wu, extend=0):
    """Gains K (T, r, n) that minimise the sum of y' Wy y + u' Wu u. The last step counts `extend` more times."""
    order = [*range(len(matrices[0])), *[-1] * extend]
    s, gains = np.zeros(matrices[0].shape[1:]), []
    for k in reversed(order):
        a, b, c, d = (part[k] for part in matrices)
        weight = d.T @ (wy[:, None] * d) + np.diag(wu) + b.T @ s @ b
        cross = d.T @ (wy[:, None] * c) + b.T @ s @ a
        gain = np.linalg.solve(weight, cross)
        s = c.T @ (wy[:, None] * c) + a.T @ s @ a - cross.T @ gain
        s = (s + s.T) / 2
        gains.append(gain)
    return np.array(gains[::-1][: len(matrices[0])])


def feedback(plant, matrices, same_step):
    """An LQG law designed on the linearisation, from the usual sizes of the deviations.

    Its gains are low, so that the record still shows the motion that the plant has without feedback.
    """
    a, b, c, d = matrices
    p0, y_scale = np.diag(plant.x_std**2), output_scale(plant, matrices)
    q = 0.01 * (p0 + (b * plant.u_std**2) @ b.transpose(0, 2, 1))
    r = np.broadcast_to(np.diag(0.01 * y_scale**2), (len(a), len(y_scale), len(y_scale)))
    design = System(a, b, c, d, q, r, p0)
    gains, corrections, _ = kalman(design)
    return Law(design, lqr(matrices, y_scale**-2, 10 * plant.u_std**-2, 200), gains, corrections, same_step)


def output_scale(plant, matrices):
    """Outputs (m) that the usual sizes of states and inputs make, root mean square over the steps."""
    squares = (matrices[2] * plant.x_std) ** 2
    return np.sqrt((squares.sum(2) + ((matrices[3] * plant.u_std) ** 2).sum(2)).mean(0))


def simulate(step, output, law, x, excitation, w, v):
    """Inputs, outputs and states of experiments.

    excitation (T, N, r), process noise w (T, N, n), measurement noise v (T, N, m), first states x (N, n).
    Returns u (T, N, r), y (T, N, m), x (T+1, N, n).
    """
    inputs, outputs, states = [], [], [x]
    guess = np.zeros((len(x), law.K.shape[2])) if law else None
    for k, u in enumerate(excitation):
        if law:
            known = guess
            if law.same_step:
                known = guess + (output(x, u, k) + v[k] - guess @ law.system.C[k].T) @ law.filtered[k].T
            u = u - known @ law.K[k].T
        y = output(x, u, k) + v[k]
        if law:
            guess = law.system.step(guess, u, k) + (y - law.system.output(guess, u, k)) @ law.L[k].T
        x = step(x, u, k) + w[k]
        inputs.append(u)
        outputs.append(y)
        states.append(x)
    return np.array(inputs), np.array(outputs), np.array(states)


def normal(rng, covariances, count):
    """Samples (..., count, n) of covariances (..., n, n), which may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    roots = vectors * np.sqrt(np.maximum(values, 0))[..., None, :]
    return rng.normal(size=(*covariances.shape[:-2], count, covariances.shape[-1])) @ np.swapaxes(roots, -1, -2)


def experiments(truth, count, seed, nonlinear=False):
    """Simulate `count` experiments. Returns u, y, x as `simulate`, of the linear truth or of the plant."""
    rng = np.random.default_rng(seed)
    system, model = truth.system, truth if nonlinear else truth.system
    excitation = rng.normal(size=(len(system.A), count, len(truth.plant.u_std))) * truth.plant.u_std
    x0 = normal(rng, system.P0, count)
    w, v = normal(rng, system.Q, count), normal(rng, system.R, count)
    return simulate(model.step, model.output, truth.law, x0, excitation, w, v)


def deviations(plant, coloured):
    """step and output of deviations from the nominal trajectory; behind the states stand those of coloured noise."""
    n = plant.x.shape[1]
    nominal = [plant.output(plant.x[k : k + 1], plant.u[k : k + 1], k) for k in range(plant.steps)]

    def step(z, u, k):
        x = plant.step(plant.x[k] + z[:, :n], plant.u[k] + u, k) - plant.x[k + 1]
        return np.hstack([x, POLE * z[:, n:]])

    def output(z, u, k):
        y = plant.output(plant.x[k] + z[:, :n], plant.u[k] + u, k) - nominal[k]
        return y + z[:, n:] if coloured else y

    return step, output


@lru_cache(maxsize=None)
def plant_of(name):
    return PLANTS[name]() if name in PLANTS else drawn(int(name.removeprefix("draw-")))


@lru_cache(maxsize=None)
def calibrated(name, loop):
    """The plant, its linearisation and its law; rms of outputs without noise, and sizes that process noise has there.

    The process noise is white in every state, in proportion to its rms under excitation.
    """
    plant = plant_of(name)
    matrices = linearise(plant)
    law = None if loop == "open" else feedback(plant, matrices, loop == "same-step")
    rng, (a, b, c, d), count = np.random.default_rng(1), matrices, 200
    (steps, n, r), m = b.shape, c.shape[1]
    still = System(a, b, c, d, np.zeros((steps, n, n)), np.zeros((steps, m, m)), np.zeros((n, n)))
    none, quiet = np.zeros((steps, count, n)), np.zeros((steps, count, m))
    excitation = rng.normal(size=(steps, count, r)) * plant.u_std
    _, y, x = simulate(still.step, still.output, law, none[0], excitation, none, quiet)
    y_rms, x_rms = np.sqrt((y**2).mean((0, 1))), np.sqrt((x**2).mean((0, 1)))
    w = rng.normal(size=none.shape) * x_rms
    _, stirred, _ = simulate(still.step, still.output, law, none[0], 0 * excitation, w, quiet)
    response = np.sqrt(((stirred / y_rms) ** 2).mean())
    return plant, matrices, law, y_rms, x_rms / response


def truth_of(name, condition):
    """The truth of a plant under a condition, in the units of the plant."""
    loop = condition.loop_of(plant_of(name))
    plant, matrices, law, y_rms, w_std = calibrated(name, loop)
    (a, b, c, d), y_scale = matrices, output_scale(plant, matrices)
    process, measurement = SHARES.get(condition.noise) or (2 / 3 * condition.noise, condition.noise)
    steps, n, m = len(a), a.shape[1], len(y_rms)
    q, r = np.diag((process * w_std) ** 2), np.diag((measurement * y_rms) ** 2)
    p0 = np.diag(plant.x_std**2) if condition.initial == "unknown" else np.zeros((n, n))
    if condition.coloured:  # nine tenths of the variance
        a = np.array([block_diag(each, POLE * np.eye(m)) for each in a])
        b = np.concatenate([b, np.zeros((steps, m, b.shape[2]))], 1)
        c = np.concatenate([c, np.tile(np.eye(m), (steps, 1, 1))], 2)
        q, p0 = block_diag(q, 0.9 * (1 - POLE**2) * r), block_diag(p0, 0.9 * r)
        r = 0.1 * r
    system = System(a, b, c, d, np.tile(q, (steps, 1, 1)), np.tile(r, (steps, 1, 1)), p0)
    return Truth(plant, system, law, *deviations(plant, condition.coloured), y_rms, y_scale)
