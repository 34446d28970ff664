# SPDX-License-Identifier: BSD-3-Clause
"""How good a model is, beside the exact Kalman filter of the truth.

A model is a `Predictor` in the units of the plant, and so is the truth. Everything is independent of the coordinates of
the states. 1 is the best that a model can do where a measure is a ratio, 0 where it is an error.
"""

from dataclasses import dataclass
from typing import Optional

import numpy as np
from scipy.linalg import block_diag

from truth import experiments, kalman, lqr, normal, simulate

HORIZON = 20  # steps ahead, and longest pulse response
FRESH = 200  # experiments
USELESS = 1e3  # times the best control cost: the loop counts as unstable


@dataclass(frozen=True)
class Predictor:
    """An observer x[k+1] = A x + B u + L (y - C x - D u) for the steps k = begin ... begin+S-1.

    Without x0, the first state is estimated from the samples of the first `window` steps by least squares of the
    innovations, and there is no prediction before.
    """

    A: np.ndarray  # (S, n, n)
    B: np.ndarray  # (S, n, r)
    C: np.ndarray  # (S, m, n)
    D: np.ndarray  # (S, m, r)
    L: np.ndarray  # (S, n, m)
    begin: int = 0
    x0: Optional[np.ndarray] = None  # (n)
    window: int = 0
    S: Optional[np.ndarray] = None  # covariances of the innovations (S, m, m), weights of the window

    @property
    def end(self):
        return self.begin + len(self.A)

    @property
    def first(self):
        """First step with a prediction."""
        return self.begin if self.x0 is not None else self.begin + self.window


def of_truth(system):
    """The exact Kalman filter."""
    gains, _, covariances = kalman(system)
    return Predictor(system.A, system.B, system.C, system.D, gains, 0, np.zeros(len(system.P0)), 0, covariances)


def read_model(path, u_scale, y_scale):
    """A model of tokid (.npz), from the units of the data to those of the plant, and its nominal inputs and outputs."""
    file = np.load(path)
    a, b, c, d, g = (file[name] for name in "ABCDG")
    begin, n = int(file["k_begin"]), a.shape[2]
    dims = file["state_dim"]
    x0 = None
    if begin == 0 and str(file["initial_state"]) == "zero":
        x0 = np.zeros(n)
    elif "x0_mean" in file and file["x0_mean"].size == dims[0]:
        x0 = np.pad(file["x0_mean"].ravel(), (0, n - dims[0]))
    window = int(file["lags"].max()) if "lags" in file else -(-n // c.shape[1])
    s = file["innovation_cov"] / np.outer(y_scale, y_scale) if "innovation_cov" in file else None
    nominal = [file[name] / scale if name in file else 0.0
               for name, scale in (("u_nominal", u_scale), ("y_nominal", y_scale))]
    return Predictor(a, b * u_scale, c / y_scale[:, None], d * u_scale / y_scale[:, None], -g * y_scale, begin, x0,
                     window, s), nominal


def write_truth(path, truth, u_scale, y_scale):
    """The truth as a model of tokid (.npz), from the units of the plant to those of the data. States of size one."""
    system, (gains, corrections, s) = truth.system, kalman(truth.system)
    size = np.sqrt((experiments(truth, FRESH, 1)[2] ** 2).mean((0, 1)))
    inner, outer, across = size / size[:, None], np.outer(y_scale, y_scale), np.outer(size, size)
    steps, n = len(system.A), len(size)
    np.savez(path, A=system.A * inner, B=system.B / u_scale / size[:, None], C=system.C * y_scale[:, None] * size,
             D=system.D * y_scale[:, None] / u_scale, G=-gains / y_scale / size[:, None], Q=system.Q / across,
             R=system.R * outer, K=corrections / y_scale / size[:, None], innovation_cov=s * outer,
             x0_mean=np.zeros(n), x0_cov=system.P0 / across, state_dim=np.full(steps + 1, n), k_begin=0,
             dt=truth.plant.dt, frame="raw", method="known", initial_state="unknown" if system.P0.any() else "zero")


def correct(p, s, x, u, y):
    """Innovation of step begin + s, and the next state."""
    e = y - x @ p.C[s].T - u @ p.D[s].T
    return e, x @ p.A[s].T + u @ p.B[s].T + e @ p.L[s].T


def first_state(p, u, y):
    """States (N, n) at the first step of the model, from the samples of its window."""
    steps, n = min(p.window, len(p.A)), p.A.shape[2]
    x, effect, rows, targets = np.zeros((y.shape[1], n)), np.eye(n), [], []
    weight = np.eye(y.shape[2]) if p.S is None else np.linalg.inv(np.linalg.cholesky(p.S[:steps].sum(0)))
    for s in range(steps):
        e, x = correct(p, s, x, u[p.begin + s], y[p.begin + s])
        rows.append(weight @ p.C[s] @ effect)
        targets.append(e @ weight.T)
        effect = (p.A[s] - p.L[s] @ p.C[s]) @ effect
    return np.linalg.lstsq(np.vstack(rows), np.hstack(targets).T, rcond=None)[0].T


def filtered(p, u, y):
    """Innovations (T, N, m) and predicted states (T+1, N, n); NaN where there are none."""
    steps, n = len(y), p.A.shape[2]
    innovations, states = np.full(y.shape, np.nan), np.full((steps + 1, y.shape[1], n), np.nan)
    x = np.tile(p.x0, (y.shape[1], 1)) if p.x0 is not None else first_state(p, u, y)
    for k in range(p.begin, min(p.end, steps)):
        e, following = correct(p, k - p.begin, x, u[k], y[k])
        if k >= p.first:
            innovations[k], states[k], states[k + 1] = e, x, following
        x = following
    return innovations, states


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def ratio(of_model, of_best):
    """A quotient of root mean squares; infinite where the model's is not finite, None where nothing is compared."""
    if of_best.size == 0:
        return None
    quotient = rms(of_model) / rms(of_best)
    return quotient if np.isfinite(quotient) else np.inf


def one_step(model, best, s, steps):
    """Ratio of innovations (T, N, m) over some steps, in units of the exact standard deviations. s: (T, m, m)."""
    size = np.sqrt(np.diagonal(s, axis1=1, axis2=2))[steps, None]
    return ratio(model[steps] / size, best[steps] / size)


def ahead(p, branches, x, u, noise=None):
    """Outputs (K, N, m) HORIZON steps after the branches (K), from states (K, N, n) of the step after each branch."""
    for i in range(1, HORIZON):
        s = branches + i - p.begin
        x = x @ p.A[s].transpose(0, 2, 1) + u[i - 1] @ p.B[s].transpose(0, 2, 1)
        x = x if noise is None else x + noise[i - 1]
    s = branches + HORIZON - p.begin
    return x @ p.C[s].transpose(0, 2, 1) + u[-1] @ p.D[s].transpose(0, 2, 1)


def many_steps(models, truth, branches, states, rng):
    """Errors (K, N, m) HORIZON steps ahead, where the experiments go on without feedback from each branch on.

    models: (predictor, nominal inputs, nominal outputs, states of the step after each branch). states: true ones.
    """
    system, count = truth.system, states.shape[1]
    after = branches + np.arange(1, HORIZON + 1)[:, None]
    u = rng.normal(size=(*after.shape, count, len(truth.plant.u_std))) * truth.plant.u_std
    w = normal(rng, system.Q[after[:-1]], count)
    y = ahead(of_truth(system), branches, states, u, w) + normal(rng, system.R[after[-1]], count)
    return [y - y0[after[-1], None] - ahead(p, branches, x, u - u0[after][:, :, None]) for p, u0, y0, x in models]


def pulse_responses(p, begin, end):
    """C[j+i] A[j+i-1] ... A[j+1] B[j] for i = 1 ... HORIZON, of all steps j and j+i in begin ... end-1."""
    a, b, c = (part[begin - p.begin : end - p.begin] for part in (p.A, p.B, p.C))
    found, state = [], b
    for i in range(1, min(HORIZON, len(a) - 1) + 1):
        state = state[:-1] if i == 1 else a[i - 1 : -1] @ state[:-1]
        found.append(c[i:] @ state)
    return found


def pulse_error(model, truth, begin, end):
    """Relative Frobenius error of the pulse responses, in units of the excitation and of the outputs."""
    weight = truth.plant.u_std / truth.y_rms[:, None]
    pairs = zip(pulse_responses(model, begin, end), pulse_responses(of_truth(truth.system), begin, end))
    found, right = (np.concatenate([(weight * h).ravel() for h in part]) for part in zip(*pairs))
    error = np.linalg.norm(found - right) / np.linalg.norm(right)
    return error if np.isfinite(error) else np.inf


def control_cost(p, truth, begin, end):
    """Exact expected cost, on the linear truth, of the LQG controller designed on a model for the steps begin to end-1.

    u = -K x_hat, with x_hat predicted from outputs up to the step before. Before, there is no input, or the feedback of
    the experiments if the plant is unstable. Second moments of (x, x of that feedback, x_hat) are propagated.
    """
    system, before = truth.system, truth.law if truth.plant.closed else None
    wy, wu = truth.y_scale**-2, truth.plant.u_std**-2
    gains = lqr([part[begin - p.begin : end - p.begin] for part in (p.A, p.B, p.C, p.D)], wy, wu)
    n, other = len(system.P0), before.K.shape[2] if before else 0
    size, first = n + other + p.A.shape[2], np.zeros(p.A.shape[2]) if p.x0 is None else p.x0
    moments, cost = block_diag(system.P0, np.zeros((other, other)), np.outer(first, first)), 0.0
    for k in range(end):
        observers = [(slice(n, n + other), before.system, before.L, k)] if before else []
        observers += [(slice(n + other, size), p, p.L, k - p.begin)] if k >= p.begin else []
        u = np.zeros((len(wu), size))
        if k >= begin:
            u[:, n + other :] = -gains[k - begin]
        elif before:
            u[:, n : n + other] = -before.K[k]
        y, move, noise = system.D[k] @ u, np.zeros((size, size)), np.zeros((size, len(wy)))
        y[:, :n] += system.C[k]
        move[:n] = system.B[k] @ u
        move[:n, :n] += system.A[k]
        for rows, m, gain, s in observers:
            move[rows] = (m.B[s] - gain[s] @ m.D[s]) @ u + gain[s] @ y
            move[rows, rows] += m.A[s] - gain[s] @ m.C[s]
            noise[rows] = gain[s]
        if k >= begin:
            cost += wy @ np.diag(y @ moments @ y.T) + wu @ np.diag(u @ moments @ u.T)
        moments = move @ moments @ move.T + noise @ system.R[k] @ noise.T
        moments[:n, :n] += system.Q[k]
    return cost


def control_ratio(model, truth, begin, end):
    """Cost of control by the model over that by the truth; infinite if the model makes the loop useless."""
    quotient = control_cost(model, truth, begin, end) / control_cost(of_truth(truth.system), truth, begin, end)
    return quotient if quotient < USELESS else np.inf


@np.errstate(all="ignore")
def predictions(model, truth, seed, nominal=(0.0, 0.0), settled=0):
    """Errors of predictions on fresh experiments from the step `settled` on.

    nominal: inputs (T, r) and outputs (T, m) that the model was freed of.
    """
    best, steps = of_truth(truth.system), len(truth.system.A)
    u0, y0 = (np.zeros(part.shape[::2]) + value for part, value in zip((best.B, best.C[:, None, :, 0]), nominal))
    u, y, x = experiments(truth, FRESH, seed)
    exact, exact_states = filtered(best, u, y)
    errors, states = filtered(model, u - u0[:, None], y - y0[:, None])
    begin, end, jump = max(settled, model.first), min(model.end, steps), truth.plant.jump
    branches = np.arange(begin, end - HORIZON, 5)
    far, far_exact = many_steps([(model, u0, y0, states[branches + 1]),
                                 (best, 0 * u0, 0 * y0, exact_states[branches + 1])],
                                truth, branches, x[branches + 1], np.random.default_rng(seed + 1))
    size = np.sqrt((far_exact**2).mean(1, keepdims=True))

    def near(first):
        return one_step(errors, exact, best.S, np.arange(max(begin, first), min(end, first + 10)))

    return {"begin": begin, "end": end, "one_step": one_step(errors, exact, best.S, np.arange(begin, end)),
            "one_step_start": near(0), "one_step_jump": None if jump is None else near(jump),
            "ahead": ratio(far / size, far_exact / size)}


@np.errstate(all="ignore")
def evaluate(model, truth, seed, nominal=(0.0, 0.0), settled=0):
    """All measures of a model on fresh experiments."""
    found, begin = predictions(model, truth, seed, nominal, settled), model.first
    return {**found, "pulse": pulse_error(model, truth, begin, found["end"]),
            "control": control_ratio(model, truth, begin, found["end"])}


def learning_errors(truth, output, learn, runs=6, seed=11):
    """RMS errors of one output in the runs of the nonlinear plant, which learns to follow a rise and a fall of 5 RMS.

    `learn(reference, inputs, measured, weight)` gives the inputs (T, r) of the next run from those of the last one and
    its measured outputs (T, m); `reference` is NaN for the other outputs, and `weight` (m) has their units. Each run has
    noise of its own. What counts is the output without noise.
    """
    system = truth.system
    steps, n, r, m = len(system.A), system.A.shape[1], system.B.shape[2], system.C.shape[1]
    rise = np.clip((np.linspace(0, 1, steps) - 0.1) / 0.8, 0, 1)
    reference, weight = np.full((steps, m), np.nan), np.zeros(m)
    reference[:, output] = 5 * truth.y_scale[output] * np.sin(np.pi * rise) ** 2
    weight[output] = truth.y_scale[output] ** -2
    rng, inputs, found = np.random.default_rng(seed), np.zeros((steps, r)), []
    for _ in range(runs):
        w, v = normal(rng, system.Q, 1), normal(rng, system.R, 1)
        exact, measured = (
            simulate(truth.step, truth.output, None, np.zeros((1, n)), inputs[:, None], size * w, size * v)[1][:, 0]
            for size in (0, 1)
        )
        found.append(np.sqrt(np.nanmean((reference - exact) ** 2)))
        inputs = learn(reference, inputs, measured, weight)
    return np.array(found)
