# SPDX-License-Identifier: BSD-3-Clause
"""Predictions of outputs some steps ahead, by ARX coefficients and by state-space models with an observer.

The prediction of step k, h steps ahead, uses the outputs up to step k - h and the inputs up to step k. Samples are
u (N, T, r) and y (N, T, m). A function `predict(u, y, horizons)` returns an array (N, T, m) for each horizon. It is NaN
where there is no prediction.
"""

from dataclasses import dataclass

import numpy as np


def lagged(samples, lags):
    """Samples (T, N, c) of the last steps, newest first: (T, N, lags * c). Zeros stand before step 0."""
    steps, count, channels = samples.shape
    padded = np.concatenate([np.zeros((lags, count, channels)), samples])
    return np.concatenate([padded[lags - j : lags - j + steps] for j in range(1, lags + 1)], axis=2)


def delayed(values):
    """The values of the step before; zeros at step 0."""
    return np.concatenate([np.zeros_like(values[:1]), values[:-1]])


def collected(predict_next, horizons):
    """Predictions (N, T, m) from those of one, two ... steps ahead (T, N, m), which predict_next() returns in turn."""
    found = {}
    for ahead in range(1, max(horizons) + 1):
        predicted = predict_next()
        if ahead in horizons:
            found[ahead] = predicted.transpose(1, 0, 2).copy()
            found[ahead][:, :ahead] = np.nan
    return [found[horizon] for horizon in horizons]


@dataclass(frozen=True)
class Arx:
    """y[k] = D u[k] + sum over j of M_j y[k-j] + L_j u[k-j], with the coefficients of each step or of all steps.

    Rows are those of `lagged`: own (T or 1, p m, m) belongs to the outputs, driven (T or 1, p r, m) to the inputs.
    """

    direct: np.ndarray  # (T or 1, r, m)
    own: np.ndarray
    driven: np.ndarray

    @property
    def lags(self):
        return self.own.shape[1] // self.own.shape[2]

    def predict(self, u, y, horizons):
        u, y = u.transpose(1, 0, 2), y.transpose(1, 0, 2)
        drive = u @ self.direct + lagged(u, self.lags) @ self.driven
        past, m = lagged(y, self.lags), y.shape[2]

        def following():
            nonlocal past
            predicted = drive + past @ self.own
            # One step later these predictions are the newest outputs that are known, and all others are a lag older.
            past = delayed(np.concatenate([predicted, past[:, :, :-m]], axis=2))
            return predicted

        return collected(following, horizons)


@dataclass(frozen=True)
class StateSpace:
    """x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k], from x[0] = 0; of each step or of all steps."""

    A: np.ndarray  # (T or 1, n, n)
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    K: np.ndarray

    def predict(self, u, y, horizons):
        u, y = u.transpose(1, 0, 2), y.transpose(1, 0, 2)
        steps = len(u)
        a, b, c, d, k = (np.broadcast_to(part, (steps, *part.shape[1:])).transpose(0, 2, 1)
                         for part in (self.A, self.B, self.C, self.D, self.K))
        driven, direct = u @ b, u @ d
        x = np.zeros((steps, u.shape[1], a.shape[1]))
        for step in range(steps - 1):
            innovation = y[step] - x[step] @ c[step] - direct[step]
            x[step + 1] = x[step] @ a[step] + driven[step] + innovation @ k[step]

        def following():
            nonlocal x
            predicted = x @ c + direct
            x = delayed(x @ a + driven)
            return predicted

        return collected(following, horizons)


@dataclass(frozen=True)
class Departures:
    """A predictor of the departures from mean trajectories, as predictor of the samples."""

    inner: object
    u_mean: np.ndarray  # (T, r)
    y_mean: np.ndarray  # (T, m)

    def predict(self, u, y, horizons):
        return [self.y_mean + found for found in self.inner.predict(u - self.u_mean, y - self.y_mean, horizons)]
