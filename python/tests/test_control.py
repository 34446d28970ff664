# SPDX-License-Identifier: BSD-3-Clause
"""The use of models: observers step by step, LQR and LQG, iterative learning."""

import warnings

import numpy as np
import pytest

import tokid


@pytest.fixture(scope="module")
def system():
    return tokid.example_system("oscillator", steps=30, process_noise=0.1, measurement_noise=0.2)


def test_observer_has_the_bits_of_predict(noisy, model):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tokid.TokidWarning)  # few experiments
        models = [model, tokid.identify(noisy, states=4, lags=4, smoothing=1.0)]
    for filtered in models:
        observer = filtered.observer()
        predicted = filtered.predict(noisy)
        ahead = filtered.predict(noisy, horizon=4)
        for n in range(3):
            observer.reset()
            for k in range(noisy.steps):
                if k + 4 <= noisy.steps and k >= filtered.k_begin:
                    assert np.array_equal(observer.predict(noisy.u[n, k : k + 4])[3], ahead[n, k + 3], equal_nan=True)
                seen = observer.step(noisy.u[n, k], noisy.y[n, k])
                assert np.array_equal(seen.prediction, predicted[n, k], equal_nan=True)
                assert np.array_equal(seen.innovation, noisy.y[n, k] - predicted[n, k], equal_nan=True)
                assert observer.k == k + 1 and seen.outputs == 2
        assert observer.knows_state and observer.state.shape == (filtered.state_dim[-1],)


def test_observer_with_missing_samples(system):
    data = tokid.example("oscillator", experiments=1, steps=30, process_noise=0.1, measurement_noise=0.2)
    u, y = np.array(data.u), np.array(data.y)
    y[0, ::4, 1] = u[0, 11, 0] = np.nan
    square = np.nanmean(u[0] ** 2, axis=0)
    observer = system.observer(samples_missing=True, input_square=square)
    predicted = system.predict(u, y)
    for k in range(30):
        seen = observer.step(u[0, k], y[0, k])
        # The mean of squares is summed in another order here.
        assert seen.prediction == pytest.approx(predicted[0, k], rel=1e-12, nan_ok=True)
        assert seen.outputs == (1 if k % 4 == 0 else 2) and np.isnan(seen.innovation[1]) == (k % 4 == 0 or k == 11)
    assert "step 30, state known" in repr(observer)


def test_observer_refuses(system):
    observer = system.observer()
    with pytest.raises(ValueError, match=r"u: shape \(3,\) found, \(2,\) needed"):
        observer.step([1, 2, 3], [1, 2])
    with pytest.raises(ValueError, match="y: an infinite sample found"):
        observer.step([1, 2], [1, np.inf])
    with pytest.raises(ValueError, match="steps 0 to 30 found"):
        observer.predict(np.zeros((31, 2)))
    with pytest.raises(TypeError, match=r"tokid\.Model\.observer"):
        tokid.Observer()


def riccati(model, q, r):
    """Gains by the recursion of textbooks."""
    p, gains = np.zeros((model.states, model.states)), []
    for k in reversed(range(model.k_begin, model.k_end)):
        s = model.at(k)
        weight = r + s.D.T @ q @ s.D + s.B.T @ p @ s.B
        gain = np.linalg.solve(weight, s.D.T @ q @ s.C + s.B.T @ p @ s.A)
        closed, seen = s.A - s.B @ gain, s.C - s.D @ gain
        p = closed.T @ p @ closed + seen.T @ q @ seen + gain.T @ r @ gain
        gains.append(gain)
    return gains[::-1], p


def test_lqr_and_its_weights(system):
    exact, cost = riccati(system, np.diag([1.0, 2.0]), 0.5 * np.eye(2))
    for output in ([1, 2], np.diag([1.0, 2.0]), np.tile(np.diag([1.0, 2.0]), (30, 1, 1))):
        controller = system.lqr(output, 0.5)
        for found, gain in zip(controller.K, exact):
            assert found == pytest.approx(gain, rel=1e-9, abs=1e-9)
        assert controller.cost_to_go[0] == pytest.approx(cost, rel=1e-9)
    assert (controller.begin, controller.end, len(controller.L)) == (0, 30, 0)
    assert not controller.feedforward.any() and "steps 0 to 29" in repr(controller)
    with_rates = system.lqr(1.0, 0.5, input_rate_weight=2.0, y_reference=np.ones((20, 2)), end=20)
    assert with_rates.L[3].shape == (2, 2) and with_rates.feedforward.shape == (20, 2) and with_rates.feedforward.any()
    with pytest.raises(ValueError, match="output_weight: shape"):
        system.lqr([1, 2, 3], 1.0)
    with pytest.raises(ValueError, match="input: no weight on inputs found"):
        system.lqr(1.0)
    with pytest.raises(ValueError, match="y_reference: 3 x 2 found"):
        system.lqr(1.0, 1.0, y_reference=np.ones((3, 2)))


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_files_of_controllers(system, extension, tmp_path):
    file = tmp_path / f"controller{extension}"
    for controller in (system.lqr(1.0, 0.1), system.lqr([1, 2], 0.1, input_rate_weight=0.2, terminal_weight=3.0, end=20,
                                                        y_reference=np.ones((20, 2)))):  # fmt: skip
        controller.save(file)
        loaded = tokid.Controller.load(file, system)
        for name in ("begin", "end", "u_nominal", "y_nominal", "feedforward"):
            assert np.array_equal(getattr(loaded, name), getattr(controller, name)), name
        for name in "KL":
            pairs = list(zip(getattr(loaded, name), getattr(controller, name)))
            assert all(np.array_equal(a, b) for a, b in pairs) and len(pairs) == len(getattr(controller, name))
        cost = controller.expected_cost()
        assert loaded.expected_cost() == cost
        if extension == ".npz":
            stored = np.load(file)["expected_cost"]
            assert np.array_equal(stored, [cost.outputs, cost.inputs, cost.input_rates, cost.measurement_noise])
        assert len(loaded.cost_to_go) == 0
    system.save(file)
    with pytest.raises(tokid.IoError, match="a model found, a controller of tokid lqr"):
        tokid.Controller.load(file, system)


def test_files_have_the_cost_of_the_present_model(system, tmp_path):
    file = tmp_path / "controller.npz"
    controller = system.lqr(1.0, 0.1)
    controller.save(file)
    first = np.load(file)["expected_cost"]
    matrices = [list(getattr(system, name)) for name in "ABCDG"]
    noise = {name: [4 * covariance for covariance in getattr(system, name)] for name in "QR"}
    noisier = tokid.Model.from_matrices(*matrices, dt=system.dt, **noise)
    tokid.Controller.load(file, noisier).save(file)
    # The same loop with covariances four times as large. Powers of two change no digit, but roots of covariances may.
    assert np.load(file)["expected_cost"] == pytest.approx(4 * first, rel=1e-12)
    quiet = tokid.Model.from_matrices(*matrices, dt=system.dt)
    for model in (quiet, system.frame("smooth")):  # without noise, in other coordinates
        tokid.Controller.load(file, model).save(tmp_path / "without.npz")
        assert "expected_cost" not in np.load(tmp_path / "without.npz")


def test_expected_cost_and_simulation(system):
    controller = system.lqr(1.0, 0.1, input_rate_weight=0.1)
    cost = controller.expected_cost()
    loop = controller.simulate(experiments=2000, seed=5)
    assert loop.data.u.shape == (2000, 30, 2) and loop.cost.shape == (2000,)
    assert loop.cost.mean() == pytest.approx(cost.total, abs=4 * loop.cost.std() / np.sqrt(2000))
    assert cost.total == cost.outputs + cost.inputs + cost.input_rates and cost.measurement_noise == pytest.approx(
        30 * 2 * 0.2**2
    )
    # Without control, or with the observer of another model, it costs more.
    assert cost.total < system.lqr(1.0, 1e6).expected_cost().total
    slow = tokid.Model.from_matrices(*(list(getattr(system, name)) for name in "ABCD"), dt=system.dt)
    assert controller.expected_cost(model=slow).total > 1.01 * cost.total
    limited = controller.simulate(experiments=3, u_min=-0.1, u_max=[0.1, 0.2], x0=[1, 0, 0, 0], noise=False)
    assert limited.data.u.min() == -0.1 and np.array_equal(limited.cost, limited.cost[:1].repeat(3))
    with pytest.raises(ValueError, match="truth: int found"):
        controller.expected_cost(3)
    with pytest.raises(ValueError, match="u_max: NaN found"):
        controller.simulate(u_max=[1, np.nan])
    with pytest.raises(ValueError, match=r"u_min: shape \(3,\) found"):
        controller.simulate(u_min=[1, 2, 3])


def test_law(system):
    controller = system.lqr(1.0, 0.1, input_rate_weight=0.1, begin=3, y_reference=np.ones((27, 2)))
    state, last = np.arange(4.0), np.array([0.5, -1.0])
    law = controller.feedforward[2] - controller.K[2] @ state - controller.L[2] @ last
    assert controller.input(5, state, last) == pytest.approx(law)
    first = controller.feedforward[0] - controller.K[0] @ state
    assert controller.input(3, state) == pytest.approx(first)
    with pytest.raises(ValueError, match="last_input: nothing found"):
        controller.input(5, state)
    with pytest.raises(ValueError, match="k: 2 found, steps 3 to 29 needed"):
        controller.input(2, state, last)


def test_controllers_belong_to_their_model(system, tmp_path):
    controller = system.lqr(1.0, 0.1)
    controller.save(tmp_path / "controller.npz")
    other = system.frame("smooth")
    for found in (controller, tokid.Controller.load(tmp_path / "controller.npz", other)):
        with pytest.raises(ValueError, match="model: other matrices or coordinates found"):
            found.expected_cost(system, model=other)


def test_lifted_map(system):
    lifted = system.lifted_map(2, 20)
    matrix = lifted.dense()
    assert matrix.shape == lifted.shape == (36, 36) and lifted.begin == 2
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=(18, 2)), rng.normal(size=(18, 2))
    assert lifted.product(u).ravel() == pytest.approx(matrix @ u.ravel())
    assert lifted.transposed_product(y).ravel() == pytest.approx(matrix.T @ y.ravel())
    linalg = pytest.importorskip("scipy.sparse.linalg")
    operator = linalg.aslinearoperator(lifted)
    assert operator @ u.ravel() == pytest.approx(matrix @ u.ravel()) and operator.shape == (36, 36)
    assert operator.H @ y.ravel() == pytest.approx(matrix.T @ y.ravel())


def test_learning(system):
    rng = np.random.default_rng(2)
    reference = np.cumsum(rng.normal(size=(30, 2)), axis=0) * 0.1
    reference[:3] = np.nan  # no input reaches these outputs in time
    u, errors = np.zeros((30, 2)), []
    for _ in range(5):
        y = system.simulate(u) + 0.3
        run = system.learn(reference, u, y, input_change_weight=1e-6)
        errors.append(np.sqrt(np.nanmean((reference - y) ** 2)))
        assert run.error == pytest.approx(np.sqrt(np.nanmean((reference - y) ** 2, axis=0)))
        assert run.predicted == pytest.approx(system.simulate(run.u) + 0.3, abs=1e-9)
        u = run.u
    assert errors[-1] < errors[0] / 10 and run.u.shape == (30, 2)
    lifted, error = system.lifted_map().dense(), np.nan_to_num(reference - y).ravel()
    last = system.learn(reference, u, y, error_weight=[1, 2], input_weight=0.1, input_change_weight=0.3)
    q = np.diag(np.tile([1.0, 2.0], 30) * ~np.isnan(reference).ravel())
    exact = np.linalg.solve(lifted.T @ q @ lifted + 0.4 * np.eye(60), lifted.T @ q @ error - 0.1 * u.ravel())
    assert (last.u - u).ravel() == pytest.approx(exact, rel=1e-7, abs=1e-9)
    with pytest.raises(ValueError, match=r"y: shape \(29, 2\) found, \(30, 2\) needed"):
        system.learn(reference, u, y[1:])


@pytest.mark.parametrize("period", [0, 30])
@pytest.mark.parametrize("missing", [False, True])
def test_learning_with_limits_of_the_inputs(system, missing, period):
    pytest.importorskip("piqp")
    optimize = pytest.importorskip("scipy.optimize")
    rng = np.random.default_rng(3)
    steps = 40 if period else 30
    model = tokid.Model.from_matrices(*(list(getattr(system, name)) for name in "ABCD"), period=period,
                                      u_nominal=rng.normal(size=(30, 2)), y_nominal=np.zeros((30, 2)))
    reference, u, y = (0.1 * rng.normal(size=(steps, 2)) for _ in range(3))
    if missing:
        reference[5, 0] = y[9, 1] = np.nan
    weights = {"error_weight": [1, 2], "input_weight": 1e-4, "input_change_weight": 2e-4, "input_rate_weight": 1e-3}
    free = model.learn(reference, u, y, **weights)
    assert np.array_equal(model.learn(reference, u, y, **weights, u_min=-99.0).u, free.u)
    low, high = -0.2, np.array([0.3, 0.1])
    found = model.learn(reference, u, y, **weights, u_min=low, u_max=high)
    assert free.u.min() < low <= found.u.min() < low + 1e-8  # an interior-point method
    assert np.all(found.u <= high) and np.all(found.u.max(axis=0) > high - 1e-8)

    # The dense problem as least squares with bounds.
    counted = ~np.isnan(reference - y).ravel()
    nominal = model.u_nominal[np.arange(steps) % 30]
    root = np.sqrt(np.tile([1.0, 2.0], steps)) * counted
    difference = np.eye(2 * steps) - np.eye(2 * steps, k=-2)
    rows = np.vstack([root[:, None] * model.lifted_map(0, steps).dense(), 1e-2 * np.eye(2 * steps),
                      np.sqrt(2e-4) * np.eye(2 * steps), np.sqrt(1e-3) * difference])
    departures = (u - nominal).ravel()
    sides = np.concatenate([root * np.nan_to_num(reference - y).ravel(), -1e-2 * departures, np.zeros(2 * steps),
                            -np.sqrt(1e-3) * difference @ departures])
    bounds = (low - u).ravel(), (high - u).ravel()
    exact = optimize.lsq_linear(rows, sides, bounds, method="bvls", tol=1e-14).x
    # Both solvers stop when the gradient is about 1e-10; the Hessian has eigenvalues down to 3e-4.
    assert (found.u - u).ravel() == pytest.approx(exact, abs=1e-5)
    change = model.lifted_map(0, steps).product(found.u - u)
    assert found.predicted == pytest.approx(y + change, nan_ok=True)
    assert found.predicted_error == pytest.approx(np.sqrt(np.nanmean((reference - y - change) ** 2, axis=0)))
    with pytest.raises(ValueError, match="u_min: a limit above u_max found"):
        model.learn(reference, u, y, **weights, u_min=1.0, u_max=0.0)
    with pytest.raises(ValueError, match="u_min: NaN found"):
        model.learn(reference, u, y, **weights, u_min=np.nan)
    with pytest.raises(ValueError, match=r"u_max: shape \(3,\) found"):
        model.learn(reference, u, y, **weights, u_max=[1, 2, 3])
