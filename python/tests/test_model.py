# SPDX-License-Identifier: BSD-3-Clause
"""Models: matrices as views, outputs, coordinates, copies."""

import copy
import gc
import json
import pickle
import re
import time
import warnings

import numpy as np
import pytest

import tokid


def by_hand(model, u, x0=None):
    """The equations of the model, written down."""
    y = np.full((len(u), model.outputs), np.nan)
    x = np.zeros(model.state_dim[0]) if x0 is None else x0
    for s, k in enumerate(range(model.k_begin, min(model.k_end, len(u)))):
        y[k] = model.C[s] @ x + model.D[s] @ u[k]
        x = model.A[s] @ x + model.B[s] @ u[k]
    return y


def random_model(S=12, n=3, r=2, m=2, seed=5, **others):
    rng = np.random.default_rng(seed)
    return tokid.Model.from_matrices(0.5 * rng.normal(size=(S, n, n)), rng.normal(size=(S, n, r)),
                                     rng.normal(size=(S, m, n)), rng.normal(size=(S, m, r)), **others)


def test_matrices_are_views(model):
    a = model.A[20]
    assert a.flags.f_contiguous and not a.flags.owndata and not a.flags.writeable
    assert np.shares_memory(a, model.A[20])
    with pytest.raises(ValueError):
        a[0, 0] = 1.0
    assert model.A[-1].shape == (model.state_dim[-1], model.state_dim[-2])
    stack = model.A.stack()
    assert stack.shape == (30, 4, 4) and np.array_equal(stack, np.asarray(model.A))
    for s, matrix in enumerate(model.A):
        assert np.array_equal(stack[s, : matrix.shape[0], : matrix.shape[1]], matrix)
        assert stack[s].sum() == pytest.approx(matrix.sum())
    part = model.A[5:20:3]
    assert len(part) == 5 and np.array_equal(part[1], model.A[8]) and np.array_equal(part.stack(), stack[5:20:3])
    assert np.array_equal(model.A[::-1].stack(), stack[::-1])
    with pytest.raises(IndexError, match="A: entry 30 found, one of 30 needed"):
        model.A[30]
    with pytest.raises(ValueError, match="copy"):
        np.asarray(model.A, copy=False) if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else model.A.__array__(
            copy=False)
    assert np.asarray(model.A, dtype=np.float32).dtype == np.float32
    assert "30 matrices" in repr(model.A) and len(model.Q) == 0


def test_matrices_as_one_array(model):
    A, stack = model.A, model.A.stack()
    assert (A.shape, A.ndim, A.dtype) == (stack.shape, 3, np.float64) and A[3:9].shape == (6, 4, 4)
    assert A[20, 0, 1] == stack[20, 0, 1] and np.array_equal(A[:, 0, 0], stack[:, 0, 0])
    for index in ([1, 2], np.array([5, 20]), np.arange(30) > 12, (..., 0), (slice(2, 9), 1), None):
        assert np.array_equal(A[index], stack[index])
    assert np.array_equal(A[np.int64(20)], A[20]) and np.shares_memory(A[np.int64(20)], A[20])
    assert np.array_equal(A[10:][[0, 3]], stack[[10, 13]])
    assert (A == model.A).all() and not (A[20] == 2 * A)[20].any() and not (A != A).any()
    assert np.array_equal(2 * A - stack, stack) and np.array_equal(stack @ A, stack @ stack)
    assert np.array_equal(np.abs(A), np.abs(stack))
    with pytest.raises(ValueError, match="A: the matrices of a model can't be changed"):
        A += 1.0
    assert A[20] in A and np.eye(7) not in A and "matrix" not in A
    assert A.index(A[20]) == 20 and A.count(A[20]) == 1 and A.index(A[20].tolist(), 3) == 20
    with pytest.raises(ValueError, match="A: the matrix found is none of the entries"):
        A.index(A[20], 21)
    with pytest.raises(IndexError):
        A[3.5]


def test_views_keep_the_model(data):
    model = tokid.identify(data)
    kept, before = model.C[10], model.C[10].copy()
    del model
    gc.collect()
    tokid.identify(data)  # uses the memory that is free
    assert np.array_equal(kept, before)


def test_steps(model):
    step = model.at(20)
    assert np.array_equal(step.A, model.A[20 - model.k_begin]) and step.k == 20
    assert np.allclose(step.closed_loop, step.A + step.G @ step.C) and step.Q is None
    with pytest.raises(ValueError, match="k: 30 found, a whole number from 0 to 29 needed"):
        model.at(30)
    periodic = random_model(7, period=3, k_begin=2)
    for k in range(2, 30):
        expected = k - 2 if k < 9 else 4 + (k - 9) % 3
        assert np.array_equal(periodic.at(k).A, periodic.A[expected])
    u = np.random.default_rng(0).normal(size=(20, 2))
    y, x = periodic.simulate(u, np.zeros(3)), np.zeros(3)
    for k in range(2, 20):
        step = periodic.at(k)
        assert np.allclose(y[k], step.C @ x + step.D @ u[k])
        x = step.A @ x + step.B @ u[k]


def test_simulate():
    model = random_model(k_begin=3)
    rng = np.random.default_rng(1)
    u, x0 = rng.normal(size=(4, 20, 2)), rng.normal(size=(4, 3))
    y = model.simulate(u, x0)
    assert y.shape == (4, 20, 2) and y.flags.c_contiguous
    for n in range(4):
        assert np.allclose(y[n], by_hand(model, u[n], x0[n]), equal_nan=True, rtol=1e-12)
        assert np.array_equal(model.simulate(u[n], x0[n]), y[n], equal_nan=True)
    one = model.simulate(u, x0[0])
    assert np.allclose(one[2], by_hand(model, u[2], x0[0]), equal_nan=True)
    assert np.array_equal(model.simulate(tokid.Ensemble(u), x0), y, equal_nan=True)
    with pytest.raises(ValueError, match=r"x0: shape \(3, 3\) found, \(4, 3\) needed"):
        model.simulate(u, x0[:3])
    with pytest.raises(ValueError, match="inputs: 1 found, the model has 2"):
        model.simulate(u[..., :1])
    with pytest.raises(ValueError, match="estimate_state"):
        model.simulate(u, y=y)


def test_predict_and_innovations(noisy):
    model = tokid.identify(noisy, refine=False)
    u, y = np.array(noisy.u), np.array(noisy.y)
    predicted = model.predict(u, y)
    assert np.array_equal(predicted, model.predict(noisy), equal_nan=True)
    assert np.array_equal(model.predict(u[3], y[3]), predicted[3], equal_nan=True)
    assert np.allclose((y - predicted)[:, 10:], model.innovations(u, y)[:, 10:])
    assert model.innovations(u[3], y[3]).shape == (30, 2)
    assert np.nanstd(y - model.predict(u, y, horizon=5)) > np.nanstd(y - predicted)
    # A later output says nothing of an earlier prediction.
    later = y.copy()
    later[:, 20:] += 1
    assert np.array_equal(model.predict(u, later)[:, :21], predicted[:, :21], equal_nan=True)
    with pytest.raises(ValueError, match=r"y: none found, outputs \(N, T, 2\) needed"):
        model.predict(u)
    with pytest.raises(ValueError, match="horizon: 0 found"):
        model.predict(u, y, horizon=0)
    with pytest.raises(ValueError, match="horizon: 30 found, at most 29 needed"):
        model.predict(u, y, horizon=30)


def test_channels_are_taken_by_name(noisy):
    names = {"input_names": ["torque", "force"], "output_names": ["angle", "rate"]}
    u, y = np.array(noisy.u), np.array(noisy.y)
    model = tokid.identify(tokid.Ensemble(u, y, dt=noisy.dt, **names), refine=False)
    swapped = tokid.Ensemble(u[:, :, ::-1], y[:, :, ::-1], dt=noisy.dt, input_names=["force", "torque"],
                             output_names=["rate", "angle"])
    with pytest.warns(tokid.TokidWarning, match="taken by name. Results have the order of the model: angle, rate"):
        assert np.array_equal(model.predict(swapped), model.predict(u, y), equal_nan=True)
    with pytest.warns(tokid.TokidWarning, match="by name"):
        assert np.array_equal(model.validate(swapped).simulation.fit, model.validate(u, y).simulation.fit)
    # Without names the order stands.
    assert not np.array_equal(model.predict(u[:, :, ::-1], y[:, :, ::-1]), model.predict(u, y), equal_nan=True)


def test_estimate_state(model, data):
    x = model.estimate_state(data, k=12)
    assert x.shape == (40, 4)
    y = model.from_step(12).simulate(data.u, x)
    assert np.allclose(y[:, 12:], data.y[:, 12:], atol=1e-8) and np.isnan(y[:, :12]).all()
    assert np.allclose(model.estimate_state(data.u[3], data.y[3], k=12), x[3])


def test_one_state_for_all_experiments(model, data):
    late = model.from_step(12)
    x = np.arange(4.0)
    y = late.simulate(data.u, x)
    assert np.array_equal(late.simulate(data.u, x[np.newaxis]), y, equal_nan=True)
    with pytest.raises(ValueError, match=r"x0: shape \(2, 4\) found, \(40, 4\) needed"):
        late.simulate(data.u, np.ones((2, 4)))


def test_report_beside_an_ensemble(model, data, tmp_path):
    verdict = model.report(data, tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 10000
    model.report(data, str(tmp_path / "other.html"))
    assert (tmp_path / "other.html").exists() and repr(verdict) == repr(model.report(data))


def test_report_at_chosen_steps(model, data, tmp_path):
    page = tmp_path / "page.html"
    model.report(data, page, at=[20, 7, 20])
    text = page.read_text(encoding="utf-8")
    shown = json.loads(re.search(r'id="report-data">(.*?)</script>', text, re.DOTALL).group(1))
    assert shown["responses"]["starts"] == [7, 20]
    for at, message in (([30], "at: step 30 found, "), ([-1], "at"), ([1.5], "at"), (list(range(2, 29)), "at: 27 steps found")):
        with pytest.raises((ValueError, TypeError), match=message):
            model.report(data, page, at=at)
    with pytest.raises(ValueError, match="experiments: 3 found, the model was identified from 40"):
        model.report(data, bands=tokid.example("oscillator", experiments=3, steps=30, seed=9))


def test_report_has_the_checks_of_its_verdict(model, data):
    verdict = model.report(data)
    order = ["good", "look closer", "don't trust"]
    assert verdict.trust == max((check.result for check in verdict.checks if check.result), key=order.index)
    reasons = sorted(
        (reason for check in verdict.checks for reason in check.reasons), key=lambda r: -order.index(r.trust)
    )
    assert verdict.reasons == [reason.text for reason in reasons]
    rules = {"at least": np.greater_equal, "at most": np.less_equal, "below": np.less}
    for check in verdict.checks:
        assert (check.result is None) == (check.untested is not None)
        if check.result is not None:
            kept = []
            for figure in check.figures:
                known = figure.values[~np.isnan(figure.values)]
                kept.append(known.size > 0 and rules[figure.rule](known, figure.bound).all())
            assert (any if check.one_suffices else all)(kept) == (check.result == "good")
        assert check.result is None or not check.reasons or check.result == max(
            (reason.trust for reason in check.reasons), key=order.index
        )
    assert {"one_step_fit", "simulation_fit", "outliers", "coverage", "whiteness"} <= {c.name for c in verdict.checks}


def test_report_with_bands_and_other_models(tmp_path):
    noisy = {"steps": 24, "measurement_noise": 0.1}
    training, fresh = (tokid.example("oscillator", experiments=30, seed=seed, **noisy) for seed in (1, 2))
    model, other = (tokid.identify(training, states=states, lags=2, smoothing=1.0, refine=False) for states in (4, 2))
    for bands in (training, (training.u, training.y)):
        model.report(fresh, tmp_path / "page.html", compare={"smaller <b>": other}, bands=bands)
        page = (tmp_path / "page.html").read_text()
        assert "smaller &lt;b&gt;" in page and "Each value lies in its band with 95&nbsp;% probability (pointwise)." in page
    model.report(fresh, tmp_path / "page.html")
    assert "no confidence bands" in (tmp_path / "page.html").read_text()
    with pytest.raises(ValueError, match="experiments: 3 found, the model was identified from 30: bounds need"):
        model.report(fresh, bands=fresh[:3])
    with pytest.raises(ValueError, match="compare: 1 inputs and 1 outputs found in tube, the model has 2 and 2"):
        model.report(fresh, compare={"tube": tokid.example_system("rotating-tube", steps=24)})


def test_markov_parameters(model, data):
    h = model.markov(4)
    assert h.shape == (30, 4, 2, 2)
    assert np.isnan(h[0]).all() and np.isnan(h[2, 2:]).all() and np.isfinite(h[2, :2]).all()
    assert np.allclose(h[20, 3], model.pulse_response(20, 16), rtol=1e-12)
    assert np.allclose(h[20, 1], model.C[20] @ model.A[19] @ model.B[18])
    system = tokid.example_system("oscillator", steps=30)
    assert np.allclose(h[6:], system.markov(4)[6:], atol=1e-9)
    assert model.difference(system, band=6).largest < 1e-8
    other = tokid.example_system(steps=30, dt=0.06)
    found = model.difference(other, band=4)
    assert found.largest > 0.01
    own, theirs = model.markov(4), other.markov(4)
    begin = model.k_begin
    for k in range(model.k_begin, 30):  # responses to pulses before the first step of either model are not compared
        for lag in range(1, 5):
            if k - lag < begin:
                own[k, lag - 1] = theirs[k, lag - 1] = np.nan
    own, theirs = own[begin:], theirs[begin:]
    squares = np.nansum((own - theirs) ** 2, axis=(0, 1)) + sum(
        (model.D[k] - other.D[k]) ** 2 for k in range(begin, 30)
    )
    size = np.nansum(theirs**2, axis=(0, 1)) + sum(other.D[k] ** 2 for k in range(begin, 30))
    assert np.allclose(found.relative_error, np.sqrt(squares / size), rtol=1e-10)
    assert (found.begin, found.end, found.band) == (begin, 30, 4)


def test_fits_of_experiments_and_steps(model, data):
    fits = model.experiment_fits(data, first_step=5)
    predicted, simulated = model.predict(data.u, data.y), model.simulate(data.u)
    error = np.sqrt(np.mean((data.y - predicted)[:, 5:] ** 2, axis=1))
    assert np.allclose(fits.one_step_rmse, error, rtol=1e-12, atol=1e-13)
    assert fits.simulation_rmse.shape == fits.over_median.shape == data.y[:, 0].shape
    spread = np.sqrt(np.mean((data.y - data.y.mean(axis=(0, 1))) ** 2, axis=(0, 1)))
    for computed, errors, limit in (
        (predicted, fits.one_step_error, fits.one_step_limit),
        (simulated, fits.simulation_error, fits.simulation_limit),
    ):
        pooled = np.sqrt(np.mean(((data.y - computed) / spread)[:, 5:] ** 2, axis=(1, 2)))
        assert np.allclose(errors, pooled, rtol=1e-12, atol=1e-13)
        assert limit == pytest.approx(max(0.05, 10 * np.sort(errors)[len(errors) // 2]), rel=1e-12)
    excess = np.maximum(fits.one_step_error / fits.one_step_limit, fits.simulation_error / fits.simulation_limit)
    assert np.array_equal(fits.excess, excess) and np.array_equal(fits.outlying, excess > 1)
    assert fits.outlying.dtype == bool and fits.one_step_samples.dtype == np.int64
    assert (fits.one_step_samples == data.y.shape[1] - 5).all()
    assert np.array_equal(fits.worst_first, np.argsort(-excess, kind="stable"))
    assert sorted(fits.worst_first) == list(range(len(data.y)))
    assert len(fits.worst_output) == len(data.y) and set(fits.worst_output) <= set(range(data.y.shape[2]))
    late = model.validate(data, first_step=5)
    assert late.first_predicted == late.first_simulated == 5
    assert late.one_step.samples == len(data.y) * (data.y.shape[1] - 5)
    cross = model.cross_validate(data, folds=2, first_step=5)
    assert cross.one_step.samples == late.one_step.samples
    checks = {check.name: check for check in model.report(data, first_step=5).checks}
    (fits_of_report,) = [figure for figure in checks["simulation_fit"].figures if figure.name == "fit"]
    assert fits_of_report.values.tolist() == late.simulation.fit.tolist()
    for call in (model.validate, model.experiment_fits, model.cross_validate, model.report):
        with pytest.raises(ValueError, match="first_step: 30 found, 0 to 29 needed"):
            call(data, first_step=30)


def test_parts_of_a_model():
    system = tokid.example_system("oscillator", steps=30)
    part = system.cut(5, 20)
    assert (part.k_begin, part.k_end) == (5, 20) and np.array_equal(part.A[2], system.A[7])
    assert system.cut().k_end == 30 and system.cut(end=3).k_end == 3
    joined, misfit = system.cut(end=20).frame("smooth").join(system.cut(12))
    assert misfit < 1e-12 and joined.difference(system).largest < 1e-10
    assert (joined.k_begin, joined.k_end) == (0, 30)
    with pytest.raises(ValueError, match="cut: steps 5 to 39 found, steps within 0 to 29 needed"):
        system.cut(5, 40)
    with pytest.raises(ValueError, match="join: step 8 with 2 block rows found"):
        system.cut(end=10).join(system.cut(12))
    with pytest.raises(ValueError, match="later: str found, a tokid.Model needed"):
        system.join("model.npz")


def test_coordinates(model, data):
    y = model.simulate(data.u)
    S = np.random.default_rng(2).normal(size=(31, 4, 4)) + 3 * np.eye(4)
    S = [s[:n, :n] for s, n in zip(S, model.state_dim)]
    for other in (model.frame("smooth"), model.frame("reference", reference_step=4), model.transform(S)):
        assert np.allclose(other.simulate(data.u), y, atol=1e-8)
        assert other.identification is model.identification
    assert model.frame("smooth").frame_name == "smooth" and model.frame_name == "raw"
    system = tokid.example_system("oscillator", steps=30)
    aligned = model.align(system)
    assert np.allclose(aligned.A[15], system.A[15], atol=1e-8)
    with pytest.raises(ValueError, match="name: 'round' found, one of 'smooth', 'reference' needed"):
        model.frame("round")
    with pytest.raises(ValueError, match="reference_step: needs name 'reference'"):
        model.frame("smooth", reference_step=2)


def test_observers():
    system = tokid.example_system("oscillator", steps=40)
    deadbeat, steps = system.deadbeat_observer()
    assert steps == 2 and np.max(deadbeat.deadbeat_products(2)) < 1e-10
    known = tokid.example_system("oscillator", steps=40, process_noise=0.1, measurement_noise=0.2)
    assert np.allclose(known.R[5], 0.04 * np.eye(2)) and len(known.K) == 40
    assert np.allclose(known.kalman_observer().K.stack(), known.K.stack())
    assert known.observability(3, 4).shape == (8, 4) and known.observability(39, 4).shape == (2, 4)
    late = known.from_step(5)
    for of, k, rows, words in [
        (known, 40, 1, "k: 40 found, a whole number from 0 to 39 needed"),
        (known, 10**6, 1, "k: 1000000 found"),
        (known, -1, 1, "k: -1 found"),
        (late, 4, 1, "k: 4 found, a whole number from 5 to 39 needed"),
        (known, 3, 0, "rows: 0 found, a whole number from 1"),
        (known, 3.0, 1, "k: 3.0 found"),
    ]:
        with pytest.raises(ValueError, match=words):
            of.observability(k, rows)
    with pytest.raises(ValueError, match="observability: step 4 found, 5 to 40 needed"):
        late._core.observability(4, 1)
    for call, words in [
        (lambda: known.pulse_response(3.0, 1), "k: 3.0 found, a whole number from 0 to 39 needed"),
        (lambda: known.pulse_response(3, 3), "i: 3 found, a whole number from 0 to 2 needed"),
        (lambda: known.align(None), "reference: NoneType found, a tokid.Model needed"),
        (lambda: known.difference(3), "other: int found, a tokid.Model needed"),
        (lambda: known.from_step(2.5), "k: 2.5 found, a whole number from 0 to 40 needed"),
    ]:
        with pytest.raises(ValueError, match=words):
            call()


def test_from_matrices(tmp_path):
    rng = np.random.default_rng(3)
    dims = [2, 3, 3, 1]
    A = [rng.normal(size=(dims[s + 1], dims[s])) for s in range(3)]
    B = [rng.normal(size=(dims[s + 1], 1)) for s in range(3)]
    C = [rng.normal(size=(2, dims[s])) for s in range(3)]
    model = tokid.Model.from_matrices(A, B, C, dt=0.25, k_begin=4, output_names=["a", "b"], input_units=["N"],
                                      x0_mean=[1, 2], x0_cov=np.eye(2))
    assert model.state_dim.tolist() == dims and (model.states, model.k_end, model.method) == (3, 7, "known")
    assert model.time.tolist() == [1.0, 1.25, 1.5] and model.x0_mean.tolist() == [1, 2]
    assert model.output_names == ["a", "b"] and model.input_units == ["N"] and (model.D[1] == 0).all()
    assert repr(model) == "<tokid.Model: n = 3 states, r = 1 input, m = 2 outputs, steps 4 to 6, dt = 0.25 s>"
    model.save(tmp_path / "model.h5")
    again = tokid.Model.load(tmp_path / "model.h5")
    assert all(np.array_equal(a, b) for a, b in zip(again.A, A)) and again.x0_cov.tolist() == np.eye(2).tolist()
    for wrong, words in [
        (lambda: tokid.Model.from_matrices(A, B[:2], C), "B"),
        (lambda: tokid.Model.from_matrices(A, B, [C[0], C[0], C[0]]), r"C\[1\] is 2 x 2, 2 x 3 needed"),
        (lambda: tokid.Model.from_matrices(A[0], B, C), r"A: shape \(3, 2\) found, a matrix for each step"),
        (lambda: tokid.Model.from_matrices([], B, C), "A: no matrices found"),
        (lambda: tokid.Model.from_matrices(None, B, C), "A: no matrices found"),
        (lambda: tokid.Model.from_matrices(3, B, C), "A: 3 found, a matrix for each step"),
        (lambda: tokid.Model.from_matrices(A, B, C, output_names="ab"), "output_names: 'ab' found, a list of 2 texts"),
        (lambda: tokid.Model.from_matrices(A, B, C, input_names=["a", "b"]), "input_names: 2 texts found, a list of 1"),
        (lambda: tokid.Model.from_matrices(A, B, C, output_units=["m"]), "output_units: 1 text found, a list of 2"),
        (lambda: tokid.Model.from_matrices([a * np.nan for a in A], B, C), "finite"),
        (lambda: tokid.Model.from_matrices(A, B, C, period=2), "model: 1 states found after step 2, 3 needed"),
        (lambda: tokid.Model.from_matrices(A, B, C, x0_mean=[1, 2, 3, 4]), "x0_mean has 4 entries"),
        (lambda: tokid.Model.from_matrices(A, B, C, x0_cov=[1, 2]), r"x0_cov: shape \(2,\) found, \(n, n\) needed"),
    ]:
        with pytest.raises(ValueError, match=words):
            wrong()
    assert tokid.Model.from_matrices(A, B, C, output_names=[1, 2]).output_names == ["1", "2"]
    lists = {name: getattr(again, name) for name in ("innovation_cov", "Q", "R", "K")}  # none of them is known
    assert not any(len(matrices) for matrices in lists.values())
    assert tokid.Model.from_matrices(again.A, again.B, again.C, again.D, again.G, **lists).state_dim.tolist() == dims
    model._core.output_names = ["a"]
    with pytest.raises(ValueError, match="model: 1 entries of output_names found, 2 needed"):
        model._core.check()
    with pytest.raises(TypeError, match="models come from"):
        tokid.Model()


def test_evidence():
    noisy = tokid.example("oscillator", experiments=20, steps=15, process_noise=0.02, measurement_noise=0.05, seed=3)
    model = tokid.identify(noisy, hold_out=0.25)
    found = model.identification
    assert (found.experiments, found.steps, found.noisy, found.held_out) == (15, 15, True, True)
    assert found.order_scores.best in found.order_scores.states and len(found.smoothing_choice.trials) > 3
    assert found.validation.one_step.fit.shape == (2,) and "one step" in repr(found.validation)
    assert model.options["hold_out"] == 0.25 and len(model.lags) == model.steps == len(model.singular_values)
    followed = tokid.identify(noisy, hold_out=0.25, choices=found.choices, lags=found.lags, states=model.states)
    assert np.array_equal(followed.A.stack(), model.A.stack())
    page = model._repr_html_()
    assert page.startswith("<table>") and "held out" in page


def test_copies(model, data, same_model):
    copied = pickle.loads(pickle.dumps(model))
    same_model(model, copied)
    assert np.array_equal(copied.simulate(data.u), model.simulate(data.u))
    assert copied.identification.lags == model.identification.lags
    assert all(np.array_equal(a, b) for a, b in zip(copied.singular_values, model.singular_values))
    for name in ("A", "C"):
        sequence = pickle.loads(pickle.dumps(getattr(model, name)))
        expected = getattr(model, name)
        assert len(sequence) == model.steps and all(np.array_equal(a, b) for a, b in zip(sequence, expected))
    part = pickle.loads(pickle.dumps(model.A[4:20:3]))
    assert np.array_equal(part, model.A[4:20:3].stack()) and part[0].shape == model.A[4].shape


def test_copies_with_a_state(data, same_model):
    kept = tokid.identify(data, keep_state=True, refine=False)
    later = tokid.example("oscillator", experiments=10, steps=30, seed=8)
    updated = tokid.update(kept.state, later)
    for made in (pickle.loads(pickle.dumps(updated)), copy.copy(updated), copy.deepcopy(updated)):
        same_model(updated, made)
        assert made._core is not updated._core and made.updated.experiments == 50
        same_model(made.state.identify(), updated.state.identify())
        assert made.state.experiments == 50
        assert made.singular_values and made.state_dim.tolist() == updated.state_dim.tolist()
    state = pickle.loads(pickle.dumps(kept.state))
    same_model(tokid.update(state, later), updated)
    assert copy.deepcopy(state).experiments == state.experiments == 40
    for other in (updated.frame("smooth"), updated.align(kept)):
        assert other.updated is updated.updated and other.state is updated.state
    other = updated.from_step(12)
    assert other.updated is updated.updated and other.state is None


def test_many_steps_are_copied_at_once(same_model):
    system = tokid.example_system("oscillator", steps=50000, process_noise=0.1, measurement_noise=0.2)
    for copied in (lambda: pickle.loads(pickle.dumps(system)), lambda: copy.deepcopy(system)):
        begin = time.process_time()
        made = copied()
        assert time.process_time() - begin < 3  # with an array for each matrix, 10
        same_model(made, system)


def test_warnings_name_the_line_of_the_user(data):
    other = tokid.Ensemble(data.u, data.y, dt=0.5)
    model = tokid.identify(data)
    with pytest.warns(tokid.TokidWarning, match="0.5") as issued:
        model.predict(other)
    assert issued[0].filename == __file__


def test_figures_of_regressions_that_were_given_up(noisy):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        given_up = tokid.identify(noisy, refine=False).identification
        kept = tokid.identify(noisy, method="tvera").identification
    assert given_up.together and not kept.together
    assert (given_up.condition_max, given_up.rank_deficient_steps) == (0, 0) and kept.condition_max > 1
    assert given_up.lag_order_errors.mean.size == 0 and kept.lag_order_errors.mean.size > 0


def test_examples_take_the_inputs_of_a_plan():
    plan = tokid.plan(states=4, inputs=2, outputs=2, steps=20)
    data = tokid.example("oscillator", inputs=plan.inputs, measurement_noise=0.1)
    np.testing.assert_array_equal(data.u, plan.inputs.u)
    with pytest.raises(ValueError, match="20 steps found"):
        tokid.example("rotating-tube", inputs=plan.inputs)
    with pytest.raises(TypeError, match=r"inputs: ndarray found, a tokid\.Ensemble needed"):
        tokid.example("oscillator", inputs=data.u)
