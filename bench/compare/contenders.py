# SPDX-License-Identifier: BSD-3-Clause
"""tokid and the methods beside it, with the candidates of their options: identification from training data alone.

A contender is a function of an Ensemble. It returns an `Identified`.
"""

import os
import subprocess
import tempfile
import time
import warnings
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

import methods
from judge import choose, cross_validated, fitted, folds, objective, removed
from predictors import Departures, StateSpace

OCTAVE = os.environ.get("TOKID_OCTAVE", "octave-cli")
YES_NO = [True, False]
LAGS = [2, 1, 3, 4, 6, 8, 12]
LONG = [*LAGS, 18, 24]  # of time-invariant models, which have more rows for them
RIDGE = [1e-3, 0.0, 1e-5, 1e-4, 1e-2, 1e-1]
STATES = [4, 1, 2, 3, 5, 6, 8, 10, 12]
BLOCK_ROWS = [5, 8, 11, 15]


@dataclass(frozen=True)
class Identified:
    """A predictor, the options that were chosen, and processor seconds."""

    predictor: object
    options: dict
    seconds: float  # of the choice of options and the final fit
    fit_seconds: float  # of the final fit alone
    versions: dict = field(default_factory=dict)


def with_choice(fit, candidates, data):
    """The options are chosen by cross-validation, and fit(u, y, ...) then has all experiments."""
    begin = time.process_time()
    options = choose(fit, {**candidates, "nominal": YES_NO}, data.u, data.y)
    middle = time.process_time()
    predictor = fitted(fit, data.u, data.y, options)
    end = time.process_time()
    return Identified(predictor, options, end - begin, end - middle)


@dataclass(frozen=True)
class Tokid:
    """A model of tokid as predictor."""

    model: object

    def predict(self, u, y, horizons):
        return [self.model.predict(u, y, horizon=horizon) for horizon in horizons]


def by_tokid(data, **stated):
    """tokid with the defaults of all options that are not stated."""
    import tokid

    warnings.simplefilter("ignore", tokid.TokidWarning)
    begin = time.process_time()
    model = tokid.identify(data.u, data.y, dt=data.dt, **stated)
    seconds = time.process_time() - begin
    options = {"states": int(model.states), "lags": int(np.max(model.lags))}
    return Identified(Tokid(model), options, seconds, seconds, {"tokid": tokid.__version__})


def by_system_id(data):
    import importlib.metadata

    def fit(u, y, **options):
        return methods.system_id(u, y, free_y=data.free_y[: len(u)], dt=data.dt, **options)

    found = with_choice(fit, {"lags": [2, 1, 3, 4, 6], "states": [4, 2, 3, 6, 8]}, data)
    return Identified(found.predictor, found.options, found.seconds, found.fit_seconds,
                      {"systemID-light": importlib.metadata.version("systemID-light")})


def n4sid_models(ensembles, fits):
    """Models of n4sid of Octave's control package (SLICOT), or None; their processor seconds; the versions.

    ensembles: pairs u, y. fits: number of an ensemble, states, block rows. One start of Octave makes all of them.
    """
    import scipy.io

    requests = {"ensembles": np.empty(len(ensembles), object), "fits": np.array(fits, float) + [1, 0, 0]}
    requests["ensembles"][:] = [{"u": u, "y": y} for u, y in ensembles]
    with tempfile.TemporaryDirectory() as folder:
        files = {"REQUESTS": f"{folder}/requests.mat", "ANSWERS": f"{folder}/answers.mat"}
        scipy.io.savemat(files["REQUESTS"], requests)
        script = Path(__file__).with_name("n4sid_grid.m")
        subprocess.run([OCTAVE, "--no-gui", "--no-init-file", "--no-history", script], env=os.environ | files,
                       stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True)
        answer = scipy.io.loadmat(files["ANSWERS"], simplify_cells=True)
    (r, m), models = (part.shape[2] for part in ensembles[0]), []
    for (_, n, _), found in zip(fits, answer["answers"]):
        shapes = {"A": (n, n), "B": (n, r), "C": (m, n), "D": (m, r), "K": (n, m)}
        matrices = [np.reshape(found[name], (1, *shape)) for name, shape in shapes.items() if name in found]
        complete = len(matrices) == len(shapes) and all(np.isfinite(part).all() for part in matrices)
        models.append(StateSpace(*matrices) if complete else None)
    return models, [found["seconds"] for found in answer["answers"]], answer["versions"]


def by_n4sid(data):
    """n4sid with the best options of a full grid."""
    count = len(data.u)
    parts = [*(training for training, _ in folds(count)), np.arange(count)]
    means = {(nominal, i): removed(data.u[part], data.y[part], nominal)
             for nominal in YES_NO for i, part in enumerate(parts)}
    ensembles = [(data.u[parts[i]] - u_mean, data.y[parts[i]] - y_mean) for (_, i), (u_mean, y_mean) in means.items()]
    sizes = [(states, rows) for states in sorted(STATES) for rows in BLOCK_ROWS if rows > states]
    fits = [(e, *size) for size in sizes for e in range(len(ensembles))]
    models, seconds, versions = n4sid_models(ensembles, fits)
    begin = time.process_time()
    places = {(*which, *size): fits.index((e, *size)) for e, which in enumerate(means) for size in sizes}

    def predictor(nominal, i, *size):
        model = models[places[nominal, i, *size]]
        return model and Departures(model, *means[nominal, i])

    scores = {(nominal, *size): objective(cross_validated(lambda i, _: predictor(nominal, i, *size), data.u, data.y))
              for nominal in YES_NO for size in sizes}
    nominal, *size = best = min(scores, key=scores.get)
    final = nominal, len(parts) - 1, *size
    return Identified(predictor(*final), dict(zip(("nominal", "states", "rows"), best)),
                      time.process_time() - begin + sum(seconds), seconds[places[final]], versions)


def of(fit, **candidates):
    return partial(with_choice, fit, candidates)


# Name in the tables -> contender.
CONTENDERS = {
    "tokid": by_tokid,
    "varying ARX": of(methods.varying_arx, lags=[2, 1, 3, 4, 6, 8], feedthrough=YES_NO),
    "varying ARX, pooled": of(methods.varying_arx, lags=LAGS, pool=[4, 0, 1, 2, 8, 16], ridge=RIDGE,
                              feedthrough=YES_NO),
    "RLS over the ensemble": of(methods.recursive_ensemble, lags=LAGS,
                                forgetting=[0.9, 0.3, 0.5, 0.7, 0.8, 0.95, 0.98, 1.0], feedthrough=YES_NO),
    "RLS in each run": of(methods.recursive_run, lags=LAGS, forgetting=[1.0, 0.998, 0.99, 0.97, 0.9],
                          prior=[30, 3, 300, 3000], feedthrough=YES_NO),
    "ARX": of(methods.invariant_arx, lags=LONG, ridge=[0.0, 1e-5, 1e-4, 1e-3, 1e-2], feedthrough=YES_NO),
    "n4sid": by_n4sid,
    "OKID/ERA": of(methods.okid_era, lags=LONG[::-1], states=STATES, joint=YES_NO),
    "DMD with control": of(methods.dmd_control, lags=LONG, rank=[4, 2, 6, 8, 12, 16, 20, 24, 30, 36, 48, 60]),
    "SystemID": by_system_id,
}

# Chosen after the errors on the fresh runs of the robot were known: no contender.
HINDSIGHT = {"tokid with 12 lags": partial(by_tokid, lags=12)}
