# SPDX-License-Identifier: BSD-3-Clause
"""Plants with noise and feedback, their experiments, and models of them with exact Kalman filters, in NumPy alone.

x[k+1] = A x[k] + B u[k] + w[k], y[k] = C x[k] + D u[k] + v[k]
"""

import dataclasses

import numpy as np


@dataclasses.dataclass
class Plant:
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    start: float = 0.0  # standard deviation of the initial states
    drive: float = 1.0  # of the inputs, beside what feedback adds
    feedback: np.ndarray = None  # u = drive - feedback x

    def steps(self):
        return len(self.A)


def discrete(a, b, dt):
    """Zero-order hold, by the Taylor series."""
    n = len(a)
    m = np.zeros((n + b.shape[1],) * 2)
    m[:n] = np.hstack([a, b]) * dt
    term = total = np.eye(len(m))
    for i in range(1, 25):
        term = term @ m / i
        total = total + term
    return total[:n, :n], total[:n, n:]


def regulator(A, B, state, effort):
    """Gains of the linear quadratic regulator over the steps."""
    S, gains = state, []
    for a, b in zip(A[::-1], B[::-1]):
        gain = np.linalg.solve(effort + b.T @ S @ b, b.T @ S @ a)
        S = state + a.T @ S @ (a - b @ gain)
        gains.append(gain)
    return np.array(gains[::-1])


def sampled(matrices, C, dt, steps, state, **more):
    A, B = map(np.array, zip(*(discrete(*matrices(k * dt), dt) for k in range(steps))))
    C = np.array(C, float)
    gains = regulator(A, B, np.diag(state), np.eye(B.shape[2]))
    return Plant(A, B, np.repeat(C[None], steps, 0), np.zeros((steps, len(C), B.shape[2])), feedback=gains, **more)


def quadrotor(steps=120):
    """A planar quadrotor along a fast trajectory that a controller tracks: position, attitude and their rates."""
    def matrices(t):
        tilt, thrust = 0.9 * np.sin(1.6 * t), 9.81 * (1 + 0.5 * np.cos(1.1 * t))
        a, b = np.zeros((6, 6)), np.zeros((6, 2))
        a[:3, 3:] = np.eye(3)
        a[3, 2], a[4, 2] = -thrust * np.cos(tilt), -thrust * np.sin(tilt)
        a[3, 3] = a[4, 4] = -0.15
        b[3], b[4], b[5] = -np.sin(tilt), np.cos(tilt), (25, -25)
        return a, b
    C = np.zeros((4, 6))
    C[[0, 1, 2, 3], [0, 1, 2, 5]] = 1
    return sampled(matrices, C, 0.05, steps, (4, 4, 1, 1, 1, 0.1), start=0.1, drive=0.4)


def pendulum(steps=100):
    """An inverted pendulum on a cart, of a length that varies, stabilised."""
    def matrices(t):
        length = 1 + 0.3 * np.sin(2 * t)
        a = np.array([[0, 1, 0, 0], [9.81 / length, -0.1, 0, 0], [0, 0, 0, 1], [-1, 0, 0, -0.2]])
        return a, np.array([[0], [-1 / length], [0], [1]])
    return sampled(matrices, [[1, 0, 0, 0], [0, 0, 1, 0]], 0.04, steps, (10, 1, 1, 1), start=0.05, drive=2.0)


def rocket(steps=120):
    """The unstable pitch of a rocket whose aerodynamics and thrust change, stabilised: angle, rate, drift."""
    def matrices(t):
        moment = 2 + 1.5 * np.sin(0.7 * t)
        a = np.array([[0, 1, 0], [moment, -0.1, 0.02 * moment], [-8 - t, 0, -0.1]])
        return a, np.array([[0], [3 + 0.3 * t], [2]])
    return sampled(matrices, [[1, 0, 0], [0, 1, 0]], 0.05, steps, (30, 3, 0.01), start=0.05, drive=0.3)


def oscillator(steps=100):
    """The paper's system (77), (78)."""
    A = []
    for k in range(steps):
        t, a = 0.05 * k, np.zeros((4, 4))
        a[:2, 2:] = np.eye(2)
        a[2:, :2] = [[-4 - 3 * np.sin(10 * t), 1], [1, -7 - 3 * np.cos(10 * t)]]
        A.append(discrete(a, np.zeros((4, 1)), 0.05)[0])
    B, C = np.array([[1.0, 0], [1, -1], [0, 1], [-1, 0]]), np.array([[1, 0, 1, 0.2], [1, -1, 0, -0.5]])
    return Plant(np.array(A), *(np.repeat(x[None], steps, 0) for x in (B, C, 0.1 * np.eye(2))))


def stable(steps=80):
    """Nothing special: four stable states, two inputs, two outputs."""
    rng = np.random.default_rng(5)
    a = rng.standard_normal((4, 4))
    a *= 0.9 / max(abs(np.linalg.eigvals(a)))
    turn, b, c, d = (rng.standard_normal(s) for s in ((4, 4), (4, 2), (2, 4), (2, 2)))
    k = np.arange(steps)[:, None, None]
    return Plant(a * (1 - 0.1 * np.sin(0.1 * k) ** 2) + 0.05 * turn * np.sin(0.15 * k), b * (1 + 0.5 * np.cos(0.1 * k)),
                 np.repeat(c[None], steps, 0), 0.3 * np.repeat(d[None], steps, 0))


def drift(steps=100):
    """Stable, but disturbances move it as much as the inputs."""
    k = np.arange(steps)[:, None, None]
    return Plant(np.array([[0.97, 0.2], [-0.05, 0.95]]) + 0 * k, np.array([[0.3], [1.0]]) * (1 + 0.3 * np.sin(0.1 * k)),
                 np.array([[1.0, 0]]) + 0 * k, np.zeros((1, 1)) + 0 * k)


def valve(steps=60, at=30):
    """A mass on a spring; at one step the spring, the damper and the drive become others."""
    before, after = (discrete(np.array([[0, 1], [-spring, -damper]]), np.array([[0], [drive]]), 0.1)
                     for spring, damper, drive in ((9.0, 0.3, 1.0), (36.0, 1.2, 2.5)))
    A, B = (np.array([(before if k < at else after)[i] for k in range(steps)]) for i in (0, 1))
    return Plant(A, B, np.repeat([[[1.0, 0]]], steps, 0), np.zeros((steps, 1, 1)))


def experiments(plant, count, seed, Q=None, R=None, same=False):
    """Inputs, outputs and states; `same`: the inputs of all experiments are the same, and there is no feedback."""
    rng = np.random.default_rng(seed)
    steps, n, r, m = plant.steps(), plant.A.shape[1], plant.B.shape[2], plant.C.shape[1]
    none = np.zeros((n, n)), np.zeros((m, m))
    root_Q, root_R = (np.linalg.cholesky(q + 1e-300 * np.eye(len(q))) if q is not None else z for q, z in zip((Q, R), none))
    x = plant.start * rng.standard_normal((count, n))
    u, y, states = np.empty((count, steps, r)), np.empty((count, steps, m)), np.empty((count, steps, n))
    for k in range(steps):
        own = rng.standard_normal((1 if same else count, r)) * plant.drive
        u[:, k] = own if same or plant.feedback is None else own - x @ plant.feedback[k].T
        states[:, k] = x
        y[:, k] = x @ plant.C[k].T + u[:, k] @ plant.D[k].T + rng.standard_normal((count, m)) @ root_R.T
        x = x @ plant.A[k].T + u[:, k] @ plant.B[k].T + rng.standard_normal((count, n)) @ root_Q.T
    return u, y, states


def noise(plant, measurement, process):
    """Covariances of noise of these shares of the states and outputs of experiments without noise."""
    _, y, x = experiments(plant, 50, 99)
    return np.diag((process * x.std((0, 1))) ** 2 + 1e-18), np.diag((measurement * y.std((0, 1))) ** 2 + 1e-16)


def model(plant, Q, R):
    """The arrays of a model file, with the exact Kalman filter."""
    steps, n = plant.steps(), plant.A.shape[1]
    P = plant.start**2 * np.eye(n)
    found = {"A": plant.A, "B": plant.B, "C": plant.C, "D": plant.D, "state_dim": np.full(steps + 1, n), "k_begin": 0,
             "dt": 0.05, "method": "known", "initial_state": "unknown" if plant.start else "zero",
             "Q": np.repeat(Q[None], steps, 0), "R": np.repeat(R[None], steps, 0), "x0_mean": np.zeros(n), "x0_cov": P}
    G, S = [], []
    for a, c in zip(plant.A, plant.C):
        S.append(c @ P @ c.T + R)
        gain = a @ P @ c.T @ np.linalg.inv(S[-1])
        G.append(-gain)
        P = a @ P @ a.T + Q - gain @ S[-1] @ gain.T
        P = (P + P.T) / 2
    return {**found, "G": np.array(G), "innovation_cov": np.array(S)}


def shifted(plant, steps):
    """The plant so many steps later, its last steps again at the end."""
    late = np.minimum(np.arange(plant.steps()) + steps, plant.steps() - 1)
    return dataclasses.replace(plant, A=plant.A[late], B=plant.B[late], C=plant.C[late], D=plant.D[late])


def scaled(plant, factor):
    return dataclasses.replace(plant, B=factor * plant.B, D=factor * plant.D)
