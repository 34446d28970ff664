# SPDX-License-Identifier: BSD-3-Clause
"""EM of one linear Gaussian model in NumPy, for many experiments at once: EM of tokid is measured against this.

    x_t = F x_{t-1} + B v_t + w_t,   y_t = H x_t + D v_t + e_t,   x_0 ~ N(mean, cov)

These are the parameters of dynamax; mean and cov are known. Data are complete, so that all experiments have the same
covariances, which are computed once. The means of all experiments are the rows of one matrix. What needs no recursion
is one call for all steps.
"""

from typing import NamedTuple

import numpy as np


class Parameters(NamedTuple):
    mean: np.ndarray  # (n)
    cov: np.ndarray  # (n, n)
    F: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    D: np.ndarray
    R: np.ndarray


def symmetric(P):
    return 0.5 * (P + P.swapaxes(-1, -2))


def covariances(p, steps):
    """Filter gains K, smoother gains J, covariances of innovations, and smoothed covariances, all (T, ...)."""
    n, m = p.H.shape[1], len(p.H)
    K, J, S = np.empty((steps, n, m)), np.zeros((steps, n, n)), np.empty((steps, m, m))
    predicted, filtered = np.empty((2, steps, n, n))
    P = p.cov
    for t in range(steps):
        predicted[t] = P
        HP = p.H @ P
        S[t] = HP @ p.H.T + p.R
        K[t] = np.linalg.solve(S[t], HP).T
        filtered[t] = P - K[t] @ HP
        FP = p.F @ filtered[t]
        P = symmetric(FP @ p.F.T + p.Q)
    J[:-1] = np.linalg.solve(predicted[1:], p.F @ filtered[:-1]).transpose(0, 2, 1)
    smoothed = filtered  # from the last step backwards
    for t in range(steps - 2, -1, -1):
        smoothed[t] += J[t] @ (smoothed[t + 1] - predicted[t + 1]) @ J[t].T
    return K, J, S, smoothed


def iterate(p, v, y):
    """The parameters after one iteration, and the log-likelihood before it, from v (T, N, r) and y (T, N, m)."""
    steps, experiments, outputs = y.shape
    K, J, S, V = covariances(p, steps)
    transposed = K.transpose(0, 2, 1)
    # Filter: x_{t+1} = F (I - K H) x_t + F K (y_t - D v_t) + B v_{t+1}, states predicted from the outputs before t
    free, driven = y - v @ p.D.T, v @ p.B.T
    x = np.empty((steps, experiments, len(p.F)))
    x[0] = p.mean
    x[1:] = driven[1:] + free[:-1] @ (transposed[:-1] @ p.F.T)
    closed = (p.F - p.F @ K @ p.H).transpose(0, 2, 1)
    for before, now, a in zip(x, x[1:], closed):
        now += before @ a
    innovations = free - x @ p.H.T
    scaled = np.linalg.solve(S, innovations.transpose(0, 2, 1)).transpose(0, 2, 1)
    likelihood = -0.5 * (np.vdot(innovations, scaled)
                         + experiments * (np.linalg.slogdet(S)[1].sum() + steps * outputs * np.log(2 * np.pi)))
    # Smoother: x_t = filtered x_t + J_t (smoothed x_{t+1} - predicted x_{t+1})
    back = J.transpose(0, 2, 1)
    states = x + innovations @ transposed
    states[:-1] -= x[1:] @ back[:-1]
    for t in range(steps - 2, -1, -1):
        states[t] += states[t + 1] @ back[t]

    n = len(p.F)

    def regression(z, target, added, crossed, square, count):
        zz, zt, tt = z.T @ z, z.T @ target, target.T @ target + square
        zz[:n, :n] += added
        zt[:n] += crossed
        W = np.linalg.solve(zz, zt).T
        return W[:, :n], W[:, n:], symmetric(tt - W @ zt - zt.T @ W.T + W @ zz @ W.T) / count

    # Sums over steps and experiments, with the covariances of the states, then two regressions
    both = np.concatenate([states, v], axis=2)
    pairs = np.concatenate([states[:-1], v[1:]], axis=2).reshape(-1, both.shape[2])
    F, B, Q = regression(pairs, states[1:].reshape(-1, n), experiments * V[:-1].sum(axis=0),
                         experiments * (J[:-1] @ V[1:]).sum(axis=0), experiments * V[1:].sum(axis=0), len(pairs))
    H, D, R = regression(both.reshape(-1, both.shape[2]), y.reshape(-1, outputs), experiments * V.sum(axis=0), 0.0, 0.0,
                         steps * experiments)
    return Parameters(p.mean, p.cov, F, B, Q, H, D, R), likelihood
