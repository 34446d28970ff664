# SPDX-License-Identifier: BSD-3-Clause
"""Modes, frozen models, frequency responses and bounds of functions beside NumPy."""

import functools

import numpy as np
import pytest
from scipy.linalg import expm

import tokid

DT, STEPS = 0.05, 60


def frequency(k):
    return 4 + 0.2 * k * DT


@functools.cache
def oscillator(constant=False, steps=STEPS):
    def matrix(k):
        w = 4.0 if constant else frequency(k + 0.5)
        return expm(DT * np.array([[0, 1], [-w * w, -0.1 * w]]))

    a = [matrix(k) for k in range(steps)]
    return tokid.Model.from_matrices(a, [np.array([[0], [DT]])] * steps, [np.array([[1.0, 0]])] * steps, dt=DT)


def experiments(model, count=30, noise=5e-4):
    rng = np.random.default_rng(3)
    u = rng.normal(size=(count, STEPS, 1))
    y = model.simulate(u)
    return tokid.Ensemble(u, y + noise * rng.normal(size=y.shape), dt=DT)


@pytest.fixture(scope="module")
def identified():
    data = experiments(oscillator())
    # Without EM, a replicate of the bootstrap takes a tenth of the time; test_intervals_of_exponents has one with EM.
    return tokid.identify(data, states=2, lags=12, smoothing=100.0, refine=False), data


def test_modes_of_a_known_model():
    found = oscillator().modes()
    assert found.steps[0] == found.begin == 2 and found.window == 4
    np.testing.assert_allclose(found.time, found.steps * DT)
    # Damping ratios err in first order of the variation 0.2/4², frequencies by that times the damping ratio.
    np.testing.assert_allclose(found.frequency, np.repeat(frequency(found.steps)[:, None], 2, 1), rtol=0.05 * 0.0125)
    np.testing.assert_allclose(found.damping, 0.05, atol=0.0125)
    np.testing.assert_allclose(np.abs(found.poles), found.frequency)
    np.testing.assert_array_equal(found.poles[:, 1], found.poles[:, 0].conj())
    assert found.shapes.shape == (len(found.steps), 1, 2) and found.valid.all() and found.valid.dtype == bool
    assert found.multipliers is None and found.exponents is None and found.frequency_bounds is None and found.findings == []
    assert not oscillator().modes(slow=1e-4).valid.any()
    assert oscillator().modes(window=6).begin == 3


def test_a_constant_model_is_its_frozen_model():
    model = oscillator(constant=True)
    frozen, w = model.frozen(20), np.array([0.1, 1, 4, 10])
    for gap in range(4):  # C Aᵍ B
        own, right = (m.C[0] @ np.linalg.matrix_power(m.A[0], gap) @ m.B[0] for m in (frozen, model))
        np.testing.assert_allclose(own, right, rtol=1e-9, atol=1e-12)
    a, b, c = model.A[0], model.B[0], model.C[0]
    expected = [c @ np.linalg.solve(np.exp(1j * x * DT) * np.eye(2) - a, b) for x in w]
    np.testing.assert_allclose(model.frequency_response(w, 20), expected, rtol=1e-8)
    np.testing.assert_allclose(model.frequency_response(4.0, 20)[0], expected[2], rtol=1e-8)


def test_multipliers_of_a_periodic_model():
    model = oscillator(steps=10)
    periodic = tokid.Model.from_matrices(list(model.A), list(model.B), list(model.C), dt=DT, period=10)
    product = np.linalg.multi_dot(list(model.A)[::-1])
    np.testing.assert_allclose(np.sort_complex(periodic.modes().multipliers),
                               np.sort_complex(np.linalg.eigvals(product)))
    np.testing.assert_allclose(np.exp(periodic.modes().exponents * 10 * DT), periodic.modes().multipliers)
    assert periodic.modes().multipliers_error.shape == (2,) and np.all(periodic.modes().multipliers_error < 1e-10)
    assert periodic.modes().exponents_real_bounds is None


def test_intervals_of_exponents():
    a = [expm(DT * np.array([[0, 1], [-w * w, -0.1 * w]])) for w in 4 + np.sin(2 * np.pi * np.arange(10) / 10)]
    truth = np.sort_complex(np.log(np.linalg.eigvals(np.linalg.multi_dot(a[::-1]))) / (10 * DT))[::-1]
    system = tokid.Model.from_matrices([a[k % 10] for k in range(STEPS)], [np.array([[0], [DT]])] * STEPS,
                                       [np.array([[1.0, 0]])] * STEPS, dt=DT)
    data = experiments(system)
    model = tokid.identify(data, states=2, period=10, lags=4, smoothing=0.0)
    assert model.method == "em"
    found = model.modes(data, replicates=20)
    for bounds, own, wanted in ((found.exponents_real_bounds, found.exponents.real, truth.real),
                                (found.exponents_imag_bounds, found.exponents.imag, truth.imag)):
        np.testing.assert_array_equal(bounds.estimate, own)
        assert bounds.lower.shape == (2,) and np.all((bounds.lower <= wanted) & (wanted <= bounds.upper))
        assert np.all(bounds.upper - bounds.lower < 0.05 * abs(truth[0]))


def test_frozen_models_are_those_of_each_step():
    model = oscillator()
    for step, frozen in zip((20, 2, 40), model.frozen_models([20, 2, 40])):
        single = model.frozen(step)
        for name in "ABCD":
            np.testing.assert_array_equal(getattr(frozen, name), getattr(single, name))
    with pytest.raises(ValueError, match="step: 1 found, 2 to 57 needed"):
        model.frozen_models(np.array([20, 1]))


def test_intervals(identified):
    model, data = identified
    found = model.modes(data, replicates=20)
    bounds = found.frequency_bounds
    truth = frequency(found.steps)[:, None]
    assert found.level == 0.95 and bounds.lower.shape == found.frequency.shape
    np.testing.assert_array_equal(bounds.estimate, found.frequency)
    # The errors of neighbouring steps are correlated: 95 % coverage needs many ensembles. Such noise leaves a width of 5 %.
    assert np.mean((bounds.lower <= truth) & (truth <= bounds.upper)) > 0.9
    assert np.median(bounds.upper - bounds.lower) < 0.05 * frequency(0)
    # The same function in Python has the same bootstrap; its intervals have no error of freezing and no averaged bias.
    own = model.confidence(data, function=lambda m: m.modes(window=found.window).frequency[20], replicates=20)
    assert own.interval.lower.shape == (2,) and own.replicates == 20
    np.testing.assert_allclose(own.interval.estimate, found.frequency[20])
    assert np.all(own.interval.lower < own.interval.estimate)
    several = model.confidence(data, function=lambda m: m.modes(window=found.window).frequency[20], replicates=20,
                               threads=2)
    np.testing.assert_array_equal(several.interval.upper, own.interval.upper)


def test_functions_of_any_shape_and_their_errors(identified):
    model, data = identified
    found = model.confidence(data, function=lambda m: m.frozen(30).A[0] * 0 + abs(m.frequency_response(4.0, 30)[0, 0, 0]),
                             replicates=5)
    assert found.interval.estimate.shape == (2, 2) and np.isfinite(found.interval.upper).all()
    np.testing.assert_array_equal(found.interval.estimate, abs(model.frequency_response(4.0, 30)[0, 0, 0]))

    def fails(m):
        raise KeyError("my own")

    with pytest.raises(KeyError, match="my own"):
        model.confidence(data, function=fails, replicates=5)
    calls = []

    def changes(m):
        calls.append(1)
        return np.zeros(min(len(calls), 2))

    with pytest.raises(ValueError, match=r"function: values of shape \(2,\) found, \(1,\) needed"):
        model.confidence(data, function=changes, replicates=5)


@pytest.mark.parametrize("value, said", [
    (None, "objects such as None found, real numbers needed"), ([], "no values found, at least one needed"),
    (np.zeros((0, 2)), "no values found"), (1j, "complex numbers found, real numbers needed"),
    ([1.0, None], "objects such as None found"), ("4", "real numbers needed")])
def test_functions_without_real_numbers(identified, value, said):
    model, data = identified
    with pytest.raises(ValueError, match=f"function: .*{said}"):
        model.confidence(data, function=lambda m: value, replicates=5)


@pytest.mark.parametrize("options, said", [
    ({"window": 3}, "window: 3 found, an even number"), ({"window": 0}, "window: 0 found"),
    ({"slow": -1}, "slow: -1 found"), ({"level": 0.9}, "level: 0.9 found without data"),
    ({"replicates": 30}, "replicates: 30 found without data"), ({"seed": 2}, "seed: 2 found without data"),
])
def test_wrong_options(options, said):
    with pytest.raises(ValueError, match=said):
        oscillator().modes(**options)


@pytest.mark.parametrize("options, said", [
    ({"level": 2.0}, "level: 2.0 found, a number"), ({"replicates": 1}, "replicates: 1 found, a whole number")])
def test_wrong_options_of_intervals(options, said):
    with pytest.raises(ValueError, match=said):
        oscillator().modes(experiments(oscillator()), **options)


def test_wrong_steps():
    with pytest.raises(ValueError, match="step: 1 found, 2 to 57 needed"):
        oscillator().frozen(1)
    with pytest.raises(ValueError, match="finite numbers needed"):
        oscillator().frequency_response([np.nan], 20)
