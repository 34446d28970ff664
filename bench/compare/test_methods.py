# SPDX-License-Identifier: BSD-3-Clause
"""The methods that tokid is compared with are right: without noise they predict exactly."""

import importlib.util
import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np  # noqa: E402 - after the number of threads is set
import pytest  # noqa: E402

import methods  # noqa: E402
from judge import END, HORIZONS, choose, cross_validated, errors, squares  # noqa: E402
from predictors import Arx, Departures, StateSpace  # noqa: E402

# Errors [%] of exact methods. Rounding of 1e-16 grows with the condition of the regressions, below 1e4 here, and with
# the responses over 20 steps, below 10.
EXACT = 1e-8
STEPS = 60


def system_of(rng, steps, states=3, inputs=2, outputs=2, feedthrough=True):
    """Matrices of each step, that turn slowly from one stable system into another; one step: time-invariant."""
    a = [rng.normal(size=(states, states)) for _ in range(2)]
    shapes = ((states, inputs), (outputs, states), (outputs, inputs))
    ends = [[0.9 * first / np.abs(np.linalg.eigvals(first)).max(), *(rng.normal(size=shape) for shape in shapes)]
            for first in a]
    share = np.linspace(0, 1, steps)[:, None, None] if steps > 1 else np.zeros((1, 1, 1))
    A, B, C, D = ((1 - share) * p + share * q for p, q in zip(*ends))
    return A, B, C, D * feedthrough


def simulated(system, u, x, noise=0.0, rng=None):
    """Outputs (N, T, m) for the inputs (N, T, r) from the states x (N, n)."""
    A, B, C, D = (np.broadcast_to(part, (u.shape[1], *part.shape[1:])) for part in system)
    y = np.empty((*u.shape[:2], C.shape[1]))
    for k in range(u.shape[1]):
        y[:, k] = x @ C[k].T + u[:, k] @ D[k].T
        x = x @ A[k].T + u[:, k] @ B[k].T
    return y + (noise * rng.normal(size=y.shape) if noise else 0.0)


def experiments(system, number, rng, noise=0.0):
    u = rng.normal(size=(number, STEPS, system[1].shape[2]))
    return u, simulated(system, u, np.zeros((number, system[0].shape[1])), noise, rng)


@pytest.fixture
def varying():
    rng = np.random.default_rng(1)
    system = system_of(rng, STEPS)
    return experiments(system, 30, rng), experiments(system, 5, rng), system


@pytest.fixture
def invariant():
    rng = np.random.default_rng(2)
    system = system_of(rng, 1, feedthrough=False)  # DMD with control has no feedthrough
    return experiments(system, 10, rng), experiments(system, 5, rng), system


def errors_of(predictor, data):
    u, y = data
    return errors(squares(predictor.predict(u, y, HORIZONS), y, np.zeros(y.shape[1:])))


# ---- predictions ----


def test_predictions_by_arx_coefficients():
    """Step by step, from each step from which a prediction looks ahead."""
    rng = np.random.default_rng(3)
    u, y = rng.normal(size=(4, STEPS, 2)), rng.normal(size=(4, STEPS, 3))
    model = Arx(rng.normal(size=(STEPS, 2, 3)), 0.2 * rng.normal(size=(STEPS, 6, 3)), rng.normal(size=(STEPS, 4, 3)))
    (found,) = model.predict(u, y, [5])
    for k in (5, 6, 17, STEPS - 1):
        known = y.copy()
        for step in range(k - 4, k + 1):
            past_y, past_u = (np.hstack([part[:, step - j] if step >= j else 0 * part[:, 0] for j in (1, 2)])
                              for part in (known, u))
            known[:, step] = u[:, step] @ model.direct[step] + past_y @ model.own[step] + past_u @ model.driven[step]
        assert np.allclose(found[:, k], known[:, k], rtol=1e-12, atol=1e-12)  # sums of 12 products of size one
    assert np.isnan(found[:, :5]).all()


def test_predictions_by_state_space_models():
    rng = np.random.default_rng(4)
    u, y, system = rng.normal(size=(4, STEPS, 2)), rng.normal(size=(4, STEPS, 2)), system_of(rng, STEPS)
    A, B, C, D = system
    K = 0.1 * rng.normal(size=(STEPS, 3, 2))
    (found,) = StateSpace(*system, K).predict(u, y, [5])
    x = np.zeros((4, 3))
    for k in range(STEPS - 5):
        x = x @ A[k].T + u[:, k] @ B[k].T + (y[:, k] - x @ C[k].T - u[:, k] @ D[k].T) @ K[k].T
        part = slice(k + 1, k + 6)
        ahead = simulated([matrix[part] for matrix in system], u[:, part], x)
        assert np.allclose(found[:, k + 5], ahead[:, -1], rtol=1e-12, atol=1e-12)


# ---- exact recovery ----


@pytest.mark.parametrize(("fit", "options"), [
    (methods.varying_arx, {}),
    (methods.recursive_ensemble, {"forgetting": 1e-16}),  # older steps, and the start, count less than rounding
])
def test_varying_methods_are_exact(varying, fit, options):
    training, fresh, _ = varying
    assert errors_of(fit(*training, lags=2, **options), fresh).max() < EXACT


INVARIANT = [
    (methods.varying_arx, {"lags": 2, "pool": 3}),
    (methods.invariant_arx, {"lags": 2}),
    (methods.recursive_run, {"lags": 2, "forgetting": 0.99, "prior": 10}),
    (methods.okid_era, {"lags": 2, "states": 4}),  # all states of the ARX model: those of the observer, too
    (methods.okid_era, {"lags": 2, "states": 3, "joint": False}),
    (methods.dmd_control, {"lags": 2, "rank": 8}),
]


@pytest.mark.parametrize(("fit", "options"), INVARIANT)
def test_invariant_methods_are_exact(invariant, fit, options):
    training, fresh, _ = invariant
    assert errors_of(fit(*training, **options), fresh).max() < EXACT


@pytest.mark.parametrize(("fit", "options"), [*INVARIANT, (methods.recursive_ensemble, {"lags": 2, "forgetting": 0.9})])
def test_units_do_not_matter(invariant, fit, options):
    (u, y), fresh, _ = invariant
    options = {**options, **({"ridge": 0.01} if fit in (methods.varying_arx, methods.invariant_arx) else {})}
    u_scale, y_scale = np.array([1e-3, 1e2]), np.array([1e4, 1e-2])
    (found,) = fit(u, y, **options).predict(*fresh, [5])
    (scaled,) = fit(u * u_scale, y * y_scale, **options).predict(fresh[0] * u_scale, fresh[1] * y_scale, [5])
    # Exact but for what each method does without noise: the coefficients are determined to rounding times 1e4.
    assert np.allclose(scaled / y_scale, found, rtol=0, atol=1e-9 * np.abs(fresh[1]).max(), equal_nan=True)


def test_a_penalty_shrinks_coefficients(invariant):
    (u, y), _, _ = invariant
    sizes = [np.abs(methods.invariant_arx(u, y, 2, ridge).own).sum() for ridge in (0.0, 1.0, 1e6)]
    assert sizes[0] > sizes[1] > sizes[2] and sizes[2] < 1e-4 * sizes[0]


def test_recursion_in_a_run_follows_a_change(invariant):
    """A run of another system: the coefficients of the training experiments are wrong, and the recursion learns."""
    training, _, _ = invariant
    rng = np.random.default_rng(5)
    other = experiments(system_of(rng, 1, feedthrough=False), 5, rng)
    fixed = errors_of(methods.invariant_arx(*training, lags=2), other)[0]
    adapted = errors_of(methods.recursive_run(*training, lags=2, forgetting=0.9, prior=3), other)[0]
    assert adapted < fixed / 10


def test_recursion_is_weighted_least_squares(invariant):
    """At the last step, the recursion has the solution of the regression whose rows are weighted by their age."""
    (u, y), _, _ = invariant
    y = y + np.random.default_rng(6).normal(size=y.shape)
    found = methods.recursive_ensemble(u, y, 2, 0.9)
    data = methods.Regression.of(u, y, 2, True)
    weights = np.sqrt(0.9 ** np.arange(STEPS - 1, -1, -1))[:, None, None]
    W, outputs = ((weights * part).reshape(-1, part.shape[2]) for part in (data.W, data.outputs))
    wanted = data.arx(np.linalg.lstsq(W, outputs, rcond=None)[0])
    # The start of the recursion has the weight 1e-6 * 0.9**60 against that of 10 experiments, and a condition of 10.
    assert np.allclose(found.own[-1], wanted.own, rtol=0, atol=1e-8)


@pytest.mark.skipif(importlib.util.find_spec("systemID_light") is None, reason="systemID-light is not installed")
def test_system_id_is_exact(varying):
    training, fresh, system = varying
    starts = np.random.default_rng(7).normal(size=(30, 3))
    free_y = simulated(system, np.zeros_like(training[0]), starts)
    model = methods.system_id(*training, lags=2, states=3, free_y=free_y)
    predicted = model.predict(*fresh, HORIZONS)
    assert not any(np.isnan(part[:, horizon : -END]).any() for part, horizon in zip(predicted, HORIZONS))
    # It inverts a matrix of all steps and pseudo-inverts with a cutoff of its own: a few digits less.
    assert errors_of(model, fresh).max() < 1e-5


# ---- scores and choices ----


def test_errors_are_relative_to_departures():
    """Predictions of half of the departures: 50 %. No predictions, the mean trajectory stands in: 100 %."""
    rng = np.random.default_rng(8)
    y, mean = rng.normal(size=(6, STEPS, 2)), rng.normal(size=(STEPS, 2))
    assert np.allclose(errors(squares([mean + 0.5 * (y - mean)] * 3, y, mean)), 50)
    assert np.allclose(errors(squares([np.full_like(y, np.nan)] * 3, y, mean)), 100)


def test_held_out_experiments_do_not_identify(invariant):
    (u, y), _, _ = invariant
    seen = []

    def fit(fold, training):
        seen.append(set(training))
        return Departures(Arx(np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), np.zeros((1, 2, 2))), 0.0, 0.0)

    cross_validated(fit, u, y)
    left_out = [set(range(len(u))) - part for part in seen]
    assert sorted(i for part in left_out for i in part) == list(range(len(u)))


def test_choice_of_options():
    """A mean trajectory and two lags. One lag is too few; of eight, the regressions have hardly any rows to spare."""
    rng = np.random.default_rng(9)
    u, y = experiments(system_of(rng, 1, states=2, inputs=1, outputs=1), 20, rng, noise=0.1)
    y = y + 5 * np.sin(np.arange(STEPS))[:, None]
    found = choose(methods.varying_arx, {"lags": [1, 2, 8], "nominal": [False, True], "feedthrough": [True]}, u, y)
    assert found == {"lags": 2, "nominal": True, "feedthrough": True}
