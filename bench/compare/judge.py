# SPDX-License-Identifier: BSD-3-Clause
"""How well predictors do on experiments that they have not seen, and the choice of options by cross-validation."""

import itertools

import numpy as np

from predictors import Departures

HORIZONS = (1, 5, 20)  # steps ahead
FOLDS = 5
BEGIN = 12  # the largest lag order of a candidate: the steps before are not judged
END = 10  # last steps, where SystemID has no model: not judged


def squares(predictions, y, mean):
    """Sums of squares (horizons, 2, m) of the errors, and of the departures from the mean trajectory (T, m).

    The mean trajectory stands in where there is no prediction.
    """
    found = []
    for horizon, predicted in zip(HORIZONS, predictions):
        judged = np.s_[:, BEGIN + horizon : y.shape[1] - END]
        error = y - np.where(np.isnan(predicted), mean, predicted)
        found.append([np.sum(part[judged] ** 2, axis=(0, 1)) for part in (error, y - mean)])
    return np.array(found)


def errors(sums):
    """[%] RMS error over RMS departure for each horizon, averaged over the outputs, from the sums of `squares`."""
    found = 100 * np.sqrt(sums[:, 0] / sums[:, 1]).mean(axis=1)
    return np.where(np.isfinite(found), found, np.inf)


def folds(count):
    """Pairs of training and held-out experiments."""
    order = np.random.default_rng(0).permutation(count)
    return [(np.setdiff1d(order, part), np.sort(part)) for part in np.array_split(order, min(FOLDS, count))]


def removed(u, y, nominal):
    """The mean trajectories of inputs and outputs that a method is freed of: zeros unless `nominal`."""
    return [part.mean(axis=0) if nominal else np.zeros(part.shape[1:]) for part in (u, y)]


def fitted(fit, u, y, options):
    """A predictor of the samples by fit(u, y, ...), after removal of mean trajectories if options say so; or None."""
    means = removed(u, y, options["nominal"])
    inner = fit(u - means[0], y - means[1], **{name: value for name, value in options.items() if name != "nominal"})
    return inner and Departures(inner, *means)


@np.errstate(all="ignore")
def cross_validated(fit_fold, u, y):
    """Errors [%] for each horizon, pooled over the folds. fit_fold(fold, training) gives a predictor or None."""
    sums = 0.0
    for fold, (training, held_out) in enumerate(folds(len(u))):
        predictor = fit_fold(fold, training)
        if predictor is None:
            return np.full(len(HORIZONS), np.inf)
        predictions = predictor.predict(u[held_out], y[held_out], HORIZONS)
        sums = sums + squares(predictions, y[held_out], y[training].mean(axis=0))
    return errors(sums)


def objective(found):
    """What the choice of options minimises: the mean logarithm of the errors over the horizons."""
    return np.log(found).mean()


def choose(fit, candidates, u, y):
    """The options with the least cross-validation errors: {name: value}.

    The first two options interact most and take their best pair of values while the others stay. Then each other option
    takes its best value in turn. This repeats until nothing improves, at most three times. The search begins with the
    first candidates.
    """
    known = {}

    def score(options):
        key = tuple(options.items())
        if key not in known:
            try:
                known[key] = objective(cross_validated(lambda _, part: fitted(fit, u[part], y[part], options), u, y))
            except np.linalg.LinAlgError:
                known[key] = np.inf
        return known[key]

    names = list(candidates)
    groups = [names[:2], *([name] for name in names[2:])]
    best = {name: values[0] for name, values in candidates.items()}
    for _ in range(3):
        before = best
        for group in groups:
            values = itertools.product(*(candidates[name] for name in group))
            best = min(({**best, **dict(zip(group, chosen))} for chosen in values), key=score)
        if best == before:
            break
    return best
