# SPDX-License-Identifier: BSD-3-Clause
"""Regressions of bench/compare as models of the study: what a simple method does on the same data.

Their options are chosen by cross-validation, as bench/compare chooses them, from fewer candidates.
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "compare"))

import methods  # noqa: E402 - after the path is set
from contenders import YES_NO, of  # noqa: E402
from judge import BEGIN as SETTLED  # noqa: E402

from measures import Predictor  # noqa: E402

RIDGE = [1e-4, 0.0, 1e-2]
RIVALS = {
    "ARX": of(methods.invariant_arx, lags=[2, 4, 8, 12, 24], ridge=RIDGE, feedthrough=YES_NO),
    "varying ARX, pooled": of(methods.varying_arx, lags=[2, 4, 8, 12], pool=[4, 0, 16], ridge=RIDGE),
    "RLS over the ensemble": of(methods.recursive_ensemble, lags=[2, 4, 8, 12], forgetting=[0.9, 0.5, 0.98]),
}


def of_arx(arx, steps):
    """An ARX model with the last outputs and inputs as states, newest first."""
    (own, m), (driven, _) = arx.own.shape[1:], arx.driven.shape[1:]
    r, n = arx.direct.shape[1], own + driven
    full = [np.broadcast_to(part.transpose(0, 2, 1), (steps, part.shape[2], part.shape[1]))
            for part in (arx.own, arx.driven, arx.direct)]
    C, D = np.concatenate(full[:2], axis=2), full[2]
    shift, enter, gain = np.zeros((n, n)), np.zeros((n, r)), np.zeros((n, m))
    shift[m:own, : own - m] = np.eye(own - m)
    shift[own + r :, own : n - r] = np.eye(driven - r)
    enter[own : own + r] = np.eye(r)
    gain[:m] = np.eye(m)
    return Predictor(shift + gain @ C, enter + gain @ D, C, D, np.broadcast_to(gain, (steps, n, m)), 0, np.zeros(n))


def rival(name, u, y):
    """The model of a rival from experiments u (N, T, r), y (N, T, m); its nominal inputs and outputs; its options."""
    found = RIVALS[name](SimpleNamespace(u=u, y=y))
    departures = found.predictor
    if departures is None:
        raise np.linalg.LinAlgError(f"{name}: no options are possible")
    return of_arx(departures.inner, u.shape[1]), (departures.u_mean, departures.y_mean), found.options
