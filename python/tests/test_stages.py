# SPDX-License-Identifier: BSD-3-Clause
"""The stages of the method: the chain is that of identify, and each stage can be replaced."""

import copy
import inspect
import pickle
import threading
import time
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest

import tokid
from tokid import stages

EPS = np.finfo(float).eps
MATRICES = ("A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K")
OTHERS = ("condition", "rank", "lags", "x0_mean", "x0_cov", "u_nominal", "y_nominal")
WORDS = ("k_begin", "dt", "period", "frame_name", "method", "initial_state", "input_names", "output_units")


def assert_same_bits(chain, model):
    for name in MATRICES:
        assert np.array_equal(getattr(chain, name).stack(), getattr(model, name).stack()), name
    assert np.array_equal(chain.state_dim, model.state_dim)
    for name in OTHERS:
        found, wanted = getattr(chain, name), getattr(model, name)
        assert (found is None) == (wanted is None) and (found is None or np.array_equal(found, wanted)), name
    for name in WORDS:
        assert getattr(chain, name) == getattr(model, name), name
    assert len(chain.singular_values) == len(model.singular_values)
    assert all(np.array_equal(a, b) for a, b in zip(chain.singular_values, model.singular_values))


def difference(a, b, band=8):
    """Largest difference of the pulse responses of two models, relative to the largest response."""
    begin = max(a.k_begin, b.k_begin)
    first, second = a.markov(band)[begin - a.k_begin :], b.markov(band)[begin - b.k_begin :]
    assert (np.isnan(first) | np.isnan(second)).mean() < 0.5
    return np.nanmax(np.abs(first - second)) / np.nanmax(np.abs(second))


def relative(found, wanted):
    """Largest difference of two arrays, relative to the largest entry."""
    assert found.shape == wanted.shape
    return np.abs(found - wanted).max() / np.abs(wanted).max()


def in_order(data):
    """The data in the order in which identify takes the experiments."""
    return data.subset(stages.content_order(data))


def identified(data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tokid.TokidWarning)  # such as of few experiments
        return tokid.identify(data, **options)


def tvera(data, arx, p, n, noisy=False, threads=1, free_y=None):
    """The chain for data without noise, with the options of tokid.identify."""
    r, m = arx.inputs, arx.outputs
    rows, cols = max(p, -(-n // m)) + 1, max(p, 48 if noisy else n)
    sizes = stages.channel_sizes(data)
    h = stages.markov(arx, rows + cols - 1, threads=threads)
    factors = stages.hankel_factors(
        h, rows, cols, free_y=free_y, output_size=sizes[r:], input_size=sizes[:r], threads=threads
    )
    return stages.completed(stages.realise(h, factors, states=n, threads=threads), data, arx)


@pytest.fixture
def ensemble():
    """ensemble(…) makes data of a random system with r inputs, m outputs and n states that vary over time."""

    def make(n=3, r=2, m=1, steps=25, experiments=40, seed=1, noise=0.0, initial_state="zero", missing=False):
        rng = np.random.default_rng(seed)
        base, turn = rng.normal(size=(2, n, n))
        base *= 0.8 / np.abs(np.linalg.eigvals(base)).max()
        A = [base + 0.1 * np.sin(0.3 * k) * turn for k in range(steps)]
        B, C, D = rng.normal(size=(n, r)), rng.normal(size=(m, n)), rng.normal(size=(m, r))
        system = tokid.Model.from_matrices(A, [B] * steps, [C] * steps, [D] * steps, dt=0.1)
        u = rng.normal(size=(experiments, steps, r))
        x0 = rng.normal(size=(experiments, n)) if initial_state == "unknown" else np.zeros((experiments, n))
        y = system.simulate(u, x0=x0)
        y = y + noise * rng.normal(size=y.shape)
        if missing:
            y[3, 7, 0] = y[5, 9:12, 0] = np.nan
        return system, in_order(tokid.Ensemble(u, y, dt=0.1, initial_state=initial_state, output_units=["m"] * m))

    return make


# ---- The bits of identify ----


@pytest.mark.parametrize("kind", ["plain", "no feedthrough", "unknown", "missing", "noisy", "free responses", "threads"])
def test_chain_of_tvera_has_the_bits_of_identify(ensemble, kind):
    p, n, feedthrough, threads = 4, 3, kind != "no feedthrough", 2 if kind == "threads" else 1
    if kind == "free responses":
        data, n = in_order(tokid.example("oscillator", experiments=30, steps=25, free_responses=8)), 4
    else:
        state = "unknown" if kind == "unknown" else "zero"
        noise = 0.01 if kind in ("noisy", "no feedthrough") else 0.0
        _, data = ensemble(noise=noise, initial_state=state, missing=kind == "missing")
    model = identified(data, method="tvera", lags=p, states=n, feedthrough=feedthrough, nominal="none")
    arx = stages.gtv_arx(data, p, feedthrough=feedthrough, threads=threads)
    noisy = model.identification.noisy
    assert noisy == (kind in ("noisy", "no feedthrough"))
    assert_same_bits(tvera(data, arx, p, n, noisy, threads, data.free_y), model)


def test_chain_of_departures(ensemble):
    _, data = ensemble()
    moving = in_order(tokid.Ensemble(data.u + np.linspace(0, 3, 25)[:, None], data.y + 5, dt=0.1, initial_state="zero",
                                     output_units=["m"]))  # fmt: skip
    model = identified(moving, method="tvera", lags=4, states=3, nominal="mean", feedthrough=True)
    apart = moving.departures()
    arx = stages.gtv_arx(apart, 4, spent=1)
    chain = tvera(apart, arx, 4, 3)
    assert_same_bits(stages.with_nominal(chain, *moving.nominal()), model)
    assert chain.u_nominal is None


def of_unit_size(samples):
    return samples * 2.0 ** -(1 + np.floor(np.log2(np.sqrt(np.nanmean(samples**2, axis=(0, 1))))))


@pytest.mark.parametrize("period", [0, 1, 5])
@pytest.mark.parametrize("initial_state", ["zero", "unknown"])
def test_chain_of_subspace_and_em_has_the_bits_of_identify(noisy, period, initial_state):
    # identify() computes in units near the size of each channel. Samples of this size have these units already.
    data = in_order(
        tokid.Ensemble(of_unit_size(noisy.u), of_unit_size(noisy.y), dt=noisy.dt, initial_state=initial_state)
    )
    options = {"lags": 4, "states": 4, "method": "subspace", "period": period, "feedthrough": True, "nominal": "none"}
    if period == 0:
        options["smoothing"] = 1.0
    model = identified(data, refine=False, **options)
    found = model.identification
    assert found.together and found.noisy
    arx = stages.smooth_arx(data, found.lags, found.variation.smoothing, period=found.variation.period, threads=2)
    start = stages.subspace(
        data, arx, states=4, weighting=found.choices.weighting, smoothing=found.variation.smoothing,
        period=found.variation.period, state_smoothing=found.state_smoothing, threads=2)  # fmt: skip
    assert_same_bits(start, model)

    # The first stage of EM
    iterations, smoothing = 3, 0.0 if period == 1 else 3.0
    choices = replace(found.choices, refinement_smoothing=smoothing, refinement_iterations=iterations)
    model = identified(data, choices=choices, **options)
    assert model.identification.refinement.iterations == iterations
    with pytest.warns(tokid.TokidWarning, match="EM has not converged"):
        result = stages.refine(start, data, smoothing=smoothing, period=found.variation.period, iterations=iterations)
    assert_same_bits(result.model, model)
    assert result.iterations <= iterations and len(result.penalised) == result.iterations + 1
    # EM has not converged: each iteration raises the penalised likelihood by percents, far more than rounding errors.
    assert np.all(np.diff(result.penalised) > 0)


# ---- Exactness ----


@pytest.mark.parametrize("n, r, m, p", [(1, 1, 1, 1), (2, 1, 2, 1), (3, 2, 1, 3), (4, 2, 2, 2), (5, 3, 2, 3)])
@pytest.mark.parametrize("initial_state", ["zero", "unknown"])
def test_exact_recovery(ensemble, n, r, m, p, initial_state):
    system, data = ensemble(n, r, m, experiments=60, seed=n, initial_state=initial_state)
    model = tvera(data, stages.gtv_arx(data, p), p, n)
    # Rounding errors of the regressions grow with their condition number, and may add up over the steps.
    tolerance = EPS * max(stages.gtv_arx(data, p).condition) * data.steps
    assert difference(model, system) < tolerance
    assert model.states == n and (model.k_begin > 0) == (initial_state == "unknown")
    smooth = stages.subspace(data, stages.gtv_arx(data, p), states=n, noisy=False)
    assert difference(smooth, system) < tolerance and smooth.states == n


def test_markov_parameters_are_those_of_the_system(ensemble):
    system, data = ensemble(n=4, r=2, m=2)
    arx = stages.gtv_arx(data, 3)
    h = stages.markov(arx, band=6)
    truth = system.markov(6)
    known = ~np.isnan(truth)
    assert h.system.shape == truth.shape == h.system_noise.shape and h.gain.shape == (25, 6, 2, 2)
    tolerance = EPS * max(arx.condition) * data.steps  # as in test_exact_recovery
    assert relative(h.system[known], truth[known]) < tolerance
    assert relative(h.D, system.D.stack()) < tolerance and not h.system[~known].any()


# ---- Stages of one's own ----


def test_values_can_be_made_of_their_arrays(noisy):
    arx = stages.gtv_arx(noisy, 4)
    h = stages.markov(arx, 9)
    factors = stages.hankel_factors(h, 5, 5, output_size=[1, 2], input_size=[3, 1])
    model = stages.realise(h, factors, states=4)
    for value in (arx, h, factors):
        given = {f.name: getattr(value, f.name) for f in fields(value)}
        for same in (type(value)(**given), replace(value), pickle.loads(pickle.dumps(value))):
            for name, found in given.items():
                again = getattr(same, name)
                pairs = zip(found, again) if isinstance(found, list) else [(found, again)]
                assert all(np.array_equal(a, b) for a, b in pairs), name
        assert repr(value).startswith(type(value).__name__ + "(") and len(repr(value)) < 400
    assert_same_bits(stages.realise(stages.Markov(**vars(h)), stages.HankelFactors(**vars(factors)), states=4), model)
    again = stages.markov(stages.GtvArx(**vars(arx)), 9)
    assert all(np.array_equal(getattr(again, f.name), getattr(h, f.name)) for f in fields(h))
    # Three inputs would fit the 18 columns and three lags, too: the number of inputs is kept, not guessed.
    with pytest.raises(ValueError, match=r"coefficients: shape \(30, 2, 18\) found, \(30, 2, 14\) needed"):
        replace(arx, lags=3)
    assert np.array_equal(arx.D, arx.coefficients[:, :, 16:]) and (arx.steps, arx.inputs, arx.outputs) == (30, 2, 2)


def own_regression(data, p, ridge=0.0, noise_shape=True):
    """Every step by the normal equations, with a penalty on the squares of the coefficients."""
    m, d = data.outputs, data.inputs + data.outputs
    width = p * d + data.inputs
    first = 0 if data.initial_state == "zero" else p
    M, S, rms = np.zeros((data.steps, m, width)), np.zeros((data.steps, m, m)), np.zeros((data.steps, m))
    X = np.zeros((data.steps, width, len(data)))
    for k in range(first, data.steps):
        V = stages.windows(data, k, p)
        W, Y = V[:, :-m], V[:, -m:]
        X[k] = np.linalg.pinv(W.T @ W + ridge * np.eye(width)) @ W.T
        M[k] = (X[k] @ Y).T
        E = Y - W @ M[k].T
        S[k] = E.T @ E / max(1, len(Y) - np.linalg.matrix_rank(W))
        rms[k] = np.sqrt((Y**2).mean(axis=0))
    return stages.GtvArx(M, data.inputs, p, S, rms, X if noise_shape else None, k_begin=first)


@pytest.mark.parametrize("initial_state", ["zero", "unknown"])
def test_own_regression_has_the_results_of_gtv_arx(ensemble, initial_state):
    p = 3
    _, data = ensemble(n=3, m=2, noise=0.1, experiments=60, initial_state=initial_state)
    arx, own = stages.gtv_arx(data, p), own_regression(data, p)
    # The normal equations of L regressors lose the square of the condition number of W[k], among its nonzero values.
    sizes = [np.linalg.svd(stages.windows(data, k, p)[:, :-2], compute_uv=False) for k in range(arx.k_begin, data.steps)]
    condition = max(s[0] / s[s > 1e-10 * s[0]][-1] for s in sizes)
    tolerance = EPS * condition**2 * arx.coefficients.shape[2]
    assert tolerance < 1e-9  # else the comparison says little
    assert own.k_begin == arx.k_begin and np.array_equal(own.lags, arx.lags)
    for name in ("coefficients", "residual_cov", "output_rms"):
        assert relative(getattr(own, name), getattr(arx, name)) < tolerance, name
    found, wanted = stages.markov(own, 7), stages.markov(arx, 7)
    for name in ("system", "gain", "system_noise", "D"):
        assert relative(getattr(found, name), getattr(wanted, name)) < tolerance, name
    assert found.system_noise[10:].min() > 0
    for a, b in ((tvera(data, own, p, 3, True), tvera(data, arx, p, 3, True)),
                 (stages.subspace(data, own, states=3), stages.subspace(data, arx, states=3))):  # fmt: skip
        assert difference(a, b) < tolerance
        assert relative(a.innovation_cov.stack(), b.innovation_cov.stack()) < tolerance


def test_markov_parameters_of_ones_own(ensemble):
    """The pulse responses of a known system make its model again."""
    system, data = ensemble(n=3, r=2, m=2)
    band = 6
    h = stages.Markov(system.markov(band), np.zeros((25, band, 2, 2)), system.D.stack())
    factors = stages.hankel_factors(h, 3, 3)
    model = stages.realise(h, factors)
    # Rounding errors of H[k] grow with the condition number of its part of rank n, and may add up over the steps.
    tolerance = EPS * max(s[0] / s[2] for s in factors.singular_values if len(s) > 2) * data.steps
    assert model.states == 3 and difference(model, system) < tolerance and not model.G.stack().any()
    assert relative(model.simulate(data.u), data.y) < tolerance


def test_hankel_factors_of_ones_own(noisy):
    """numpy.linalg.svd in place of the factorisation: the signs of singular vectors are arbitrary, outputs are not."""
    h = stages.markov(stages.gtv_arx(noisy, 4), 9)
    factors = stages.hankel_factors(h, 5, 5)
    u, s = [], []
    for k in range(noisy.steps):
        rows, cols = min(5, noisy.steps - k), min(5, k)
        H = np.zeros((rows, 2, cols, 2))
        for a in range(rows):
            for b in range(cols):
                H[a, :, b] = h.system[k + a, a + b]
        U, S, _ = np.linalg.svd(H.reshape(2 * rows, 2 * cols), full_matrices=False)
        u.append(U)
        s.append(S)
        # Both are the exact values of a matrix that differs from H[k] by about its size times ε in norm.
        assert np.all(np.abs(S - factors.singular_values[k]) <= EPS * (2 * rows + 2 * cols) * S.max(initial=0))
    own = stages.HankelFactors(u, s, factors.scale, factors.error, 5, 5)
    # Such a difference turns the space of the four vectors that are kept by its ratio to the gap behind them.
    tolerance = EPS * 20 * max(S[0] / (S[3] - S[4]) for S in s if len(S) > 4) * noisy.steps
    assert difference(stages.realise(h, own, states=4), stages.realise(h, factors, states=4)) < tolerance


def test_values_are_read_only_copies(noisy):
    given = {name: np.array(value) for name, value in arrays(rank=np.zeros(6, int)).items() if np.ndim(value) > 0}
    arx = stages.GtvArx(**{**arrays(), **given})
    before = {name: getattr(arx, name).copy() for name in given}
    for value in given.values():
        value += 1
    assert all(np.array_equal(getattr(arx, name), before[name]) for name in given)
    h = stages.markov(stages.gtv_arx(noisy, 4), 9)
    for value in (arx, h, stages.hankel_factors(h, 5, 5), stages.gtv_arx(noisy, 4)):
        for same in (value, replace(value), copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
            for field in fields(same):
                found = getattr(same, field.name)
                for array in found if isinstance(found, list) else [found]:
                    if isinstance(array, np.ndarray):
                        with pytest.raises(ValueError, match="read-only"):
                            array[...] = 0


def test_markov_parameters_without_variances(noisy):
    """Regressions without noise shapes change only the expected errors of the Hankel matrices."""
    arx = stages.gtv_arx(noisy, 4)
    bare = stages.gtv_arx(noisy, 4, noise_shape=False)
    assert bare.noise_shape is None and bare.rank is not None
    h, wanted = stages.markov(bare, 9), stages.markov(arx, 9)
    assert h.system_noise is None and wanted.system_noise.max() > 0
    for name in ("system", "gain", "D"):
        assert np.array_equal(getattr(h, name), getattr(wanted, name)), name
    factors, others = stages.hankel_factors(h, 5, 5), stages.hankel_factors(wanted, 5, 5)
    assert np.all(factors.error[1:] < others.error[1:]) and np.array_equal(factors.scale, others.scale)
    assert_same_bits(stages.realise(h, factors, states=4, noise_factor=0),
                     stages.realise(wanted, others, states=4, noise_factor=0))  # fmt: skip
    model = tvera(noisy, own_regression(noisy, 4, noise_shape=False), 4, 4)
    assert model.states == 4 and np.all(model.validate(noisy).one_step.fit > 70)


def test_checks_of_values_release_the_gil():
    """Noise shapes with many columns are compressed, which takes nearly all of the time of this call."""
    steps, r, columns = 6, 60, 6000
    width = 2 * (r + 1) + r
    shapes = np.random.default_rng(1).normal(size=(steps, width, columns))
    arx = stages.GtvArx(np.zeros((steps, 1, width)), r, 2, np.ones((steps, 1, 1)), np.ones((steps, 1)), shapes)
    worker = threading.Thread(target=stages.markov, args=(arx, 1))
    begin = last = time.perf_counter()
    gap = 0.0
    worker.start()
    while worker.is_alive():
        time.sleep(0.001)
        now = time.perf_counter()
        gap, last = max(gap, now - last), now
    assert gap < 0.5 * (last - begin)  # this thread ran beside it


def test_windows(ensemble):
    _, data = ensemble(n=2, r=2, m=1, missing=True)
    v = np.concatenate([data.u, data.y], axis=2)
    for k in (0, 2, 7, 8, 24):
        padded = np.concatenate([np.zeros((40, 3, 3)), v], axis=1)[:, k : k + 4].reshape(40, 12)
        V = stages.windows(data, k, 3)
        assert np.array_equal(V, padded[~np.isnan(padded).any(axis=1)])
        assert stages.gtv_arx(data, 3).rows[k] == len(V)
    sizes = stages.channel_sizes(data)
    assert sizes == pytest.approx(np.sqrt(np.nanmean(v**2, axis=(0, 1))))


def test_models_work_with_everything_else(noisy, tmp_path):
    p = 4
    arx = own_regression(noisy, p, ridge=0.1)
    smooth = stages.smooth_arx(noisy, p, 1.0)
    start = stages.subspace(noisy, smooth, states=4, smoothing=1.0)
    models = [tvera(noisy, arx, p, 4, True), start, stages.refine(start, noisy, smoothing=3.0, iterations=5).model]
    fresh = tokid.example("oscillator", experiments=10, steps=30, process_noise=0.02, measurement_noise=0.05, seed=8)
    for model in models:
        for extension in ("npz", "h5", "mat"):
            model.save(tmp_path / f"model.{extension}")
            assert_same_bits(tokid.load(tmp_path / f"model.{extension}"), model)
        assert_same_bits(pickle.loads(pickle.dumps(model)), model)
        assert model.simulate(fresh).shape == fresh.y.shape
        assert np.all(model.validate(fresh).one_step.fit > 70)
        assert model.lqr(1.0, 0.1).expected_cost().total > 0
        assert model.export_c(tmp_path / "observer.c").stored_steps > 0
        assert model.observer().step(fresh.u[0, 0], fresh.y[0, 0]).outputs == 2
        refined = model.refine(noisy, smoothing=1.0, iterations=2)
        assert refined.refinement.iterations <= 2


# ---- Wrong calls ----


def arrays(**changes):
    """A GTV-ARX model of 6 steps, p = 2, r = 1 and m = 1, as arrays."""
    good = {"coefficients": np.zeros((6, 1, 5)), "inputs": 1, "lags": 2, "residual_cov": np.ones((6, 1, 1)),
            "output_rms": np.ones((6, 1)), "noise_shape": np.zeros((6, 5, 0))}  # fmt: skip
    return {**good, **changes}


def at(array, place, value):
    array = np.array(array, dtype=float)
    array[place] = value
    return array


@pytest.mark.parametrize("changes, message", [
    ({"coefficients": np.zeros((6, 5))}, r"coefficients: shape \(6, 5\) found, \(T, m, L\) needed"),
    ({"coefficients": np.zeros((6, 1, 6))}, r"coefficients: shape \(6, 1, 6\) found, \(6, 1, 5\) needed: L = r \+ p \(r"),
    ({"inputs": 2}, r"coefficients: shape \(6, 1, 5\) found, \(6, 1, 8\) needed: .* r = 2 inputs, p = 2 lags and m = 1"),
    ({"lags": 1}, r"coefficients: shape \(6, 1, 5\) found, \(6, 1, 3\) needed"),
    ({"inputs": 0}, "inputs: 0 found, a whole number from 1 to 5 needed"),
    ({"coefficients": np.zeros((6, 0, 5))}, "without a zero needed"),
    ({"coefficients": [[["a"]]]}, "coefficients: an array of <U1 found, real numbers needed"),
    ({"lags": 6}, "lags: 6 found, a whole number from 1 to 5 needed"),
    ({"lags": [2, 2]}, r"lags: shape \(2,\) found, \(6,\) needed"),
    ({"lags": [0, 1, 2, 2, 2, 1.5]}, "lags: another value found, whole numbers from 0 on needed"),
    ({"residual_cov": np.ones((6, 2, 2))}, r"residual_cov: shape \(6, 2, 2\) found, \(6, 1, 1\) needed"),
    ({"output_rms": np.ones(6)}, r"output_rms: shape \(6,\) found, \(6, 1\) needed"),
    ({"noise_shape": np.ones((6, 4, 2))}, r"noise_shape: shape \(6, 4, 2\) found, \(6, 5, q\) needed"),
    ({"k_begin": 7}, "k_begin: 7 found, a whole number from 0 to 6 needed"),
    ({"condition": [1]}, r"condition: shape \(1,\) found, \(6,\) needed"),
])  # fmt: skip
def test_arx_of_wrong_shape(changes, message):
    with pytest.raises(ValueError, match=message):
        stages.GtvArx(**arrays(**changes))


@pytest.mark.parametrize("changes, message", [
    ({"coefficients": at(np.zeros((6, 1, 5)), (3, 0, 1), np.nan)}, "coefficients: .* not finite found at step 3"),
    ({"coefficients": np.ones((6, 1, 5)), "lags": [0, 1, 2, 2, 1, 2]}, "coefficients: .* older .* step 4, 1 lags needed"),
    ({"coefficients": np.ones((6, 1, 5)), "feedthrough": False}, "coefficients: nonzero .* inputs of step 0"),
    ({"residual_cov": at(np.ones((6, 1, 1)), 2, -1)}, "residual_cov: another matrix found at step 2, a covariance needed"),
    ({"output_rms": at(np.ones((6, 1)), 5, -1)}, "output_rms: another value found at step 5"),
    ({"noise_shape": at(np.ones((6, 5, 2)), (4, 2, 1), np.inf)}, "noise_shape: .* not finite found at step 4"),
    ({"noise_shape": np.ones((6, 5, 2)), "rank": [3] * 6}, "rank: 3 found at step 0, 0 to 1 needed"),
])  # fmt: skip
def test_arx_of_wrong_numbers(changes, message):
    assert stages.markov(stages.GtvArx(**arrays()), 3).system.shape == (6, 3, 1, 1)
    with pytest.raises(ValueError, match=message):
        stages.markov(stages.GtvArx(**arrays(**changes)), 3)


def test_other_wrong_values(noisy):
    arx = stages.gtv_arx(noisy, 2)
    h = stages.markov(arx, 5)
    factors = stages.hankel_factors(h, 3, 3)
    model = stages.realise(h, factors, states=4)
    unstated = tokid.Ensemble(noisy.u, noisy.y, dt=0.05)
    other = tokid.example("oscillator", experiments=40, steps=20)

    def wrong(message, call, *arguments, **options):
        with pytest.raises(ValueError, match=message):
            call(*arguments, **options)

    wrong("data: ndarray found, Ensemble needed; tokid.Ensemble", stages.gtv_arx, noisy.u, 2)
    wrong("data: no initial states stated, 'zero' or 'unknown' needed", stages.smooth_arx, unstated, 2, 1.0)
    wrong("lags: 30 found, a whole number from 1 to 29 needed", stages.gtv_arx, noisy, 30)
    wrong("lags: 3 lag orders found, one or 30", stages.gtv_arx, noisy, [1, 2, 3])
    wrong("lags: 0 found", stages.smooth_arx, noisy, 0, 1.0)
    wrong("smoothing: -1 found, a number from 0 on needed", stages.smooth_arx, noisy, 2, -1)
    wrong("k: 30 found, a whole number from 0 to 29 needed", stages.windows, noisy, 30, 2)
    wrong("arx: Markov found, GtvArx needed", stages.markov, h, 5)
    wrong("band: 0 found, a whole number from 1 to", stages.markov, arx, 0)
    wrong("tvera: 4 x 3 blocks need Markov parameters up to 6 steps apart, but the band is 5", stages.hankel_factors, h, 4, 3)
    wrong(r"output_size: shape \(3,\) found, \(2,\) needed", stages.hankel_factors, h, 3, 3, output_size=[1, 1, 1])
    wrong("input_size: 2 values found, 2 positive values needed", stages.hankel_factors, h, 3, 3, input_size=[1, 0])
    wrong(r"free_y: shape \(1, 2, 3\) found, \(Nf, Tf, 2\) needed", stages.hankel_factors, h, 3, 3, free_y=np.ones((1, 2, 3)))
    wrong("free_y: an infinite sample found", stages.hankel_factors, h, 3, 3, free_y=np.full((1, 2, 2), np.inf))
    wrong(r"gain: shape \(30, 5, 2, 1\) found, \(30, 5, 2, 2\) needed", replace, h, gain=np.zeros((30, 5, 2, 1)))
    wrong("system: .* not finite found at step 7", stages.hankel_factors, replace(h, system=at(h.system, (7, 2, 0, 1), np.nan)), 3, 3)
    wrong("system_noise: another value found at step 9", stages.hankel_factors, replace(h, system_noise=at(h.system_noise, (9, 0, 0, 0), -1)), 3, 3)
    wrong("u: 29 matrices found, 30 needed", replace, factors, u=factors.u[1:])
    wrong("error: another value found, numbers from 0 on needed", replace, factors, error=-factors.error)
    wrong("scale: another value found", replace, factors, scale=np.nan * factors.scale)
    wrong("singular_values: others found in entry 5, decreasing", replace, factors,
          singular_values=[s[::-1] if k == 5 else s for k, s in enumerate(factors.singular_values)])  # fmt: skip
    wrong("factors: 30 from step 1 on found, 29 needed", stages.realise, h, replace(factors, k_begin=1))
    wrong("factors: u of 6 x 0 found at step 0, 4 x 0 needed", stages.realise, h, replace(factors, rows=2))
    wrong("factors: 6 block rows found, at most 5 needed", stages.realise, h, replace(factors, rows=6))
    wrong("output_size: 3 values found, 2 positive", stages.realise, h, replace(factors, output_size=np.ones(3)))
    wrong("states: 1.5 found", stages.realise, h, factors, states=1.5)
    wrong("arx: 20 steps, 2 inputs, 2 outputs found, 30, 2, 2 needed", stages.completed, model, other, stages.gtv_arx(other, 2))
    unknown = tokid.Ensemble(noisy.u, noisy.y, dt=0.05, initial_state="unknown")
    wrong("k_begin: 0 found, the lag order needed", stages.subspace, unknown, arx, states=4)
    wrong("k_begin: 0 found", stages.completed, model, unknown, arx)
    wrong("ARX model: 20 steps", stages.subspace, noisy, stages.gtv_arx(other, 2), states=4)
    wrong("weighting: 'best' found, one of 'one-step'", stages.subspace, noisy, arx, weighting="best")
    wrong("output_weights: others found", stages.subspace, noisy, arx, output_weights=[0, 0])
    wrong("model: Ensemble found, Model needed", stages.refine, noisy, noisy)
    wrong(r"y: shape \(30, 1\) found, \(30, 2\) needed", stages.with_nominal, model, np.zeros((30, 2)), np.zeros((30, 1)))
    wrong("jumps: -1 found", stages.refine, model, noisy, jumps=[-1])


def test_everything_is_documented():
    for name in stages.__all__:
        thing = getattr(stages, name)
        assert inspect.getdoc(thing), name
        if inspect.isfunction(thing):
            for parameter in inspect.signature(thing).parameters:
                assert parameter in thing.__doc__, f"{name}: {parameter}"
