# SPDX-License-Identifier: BSD-3-Clause
"""Values that mean nothing are refused, masked samples are missing, and objects are copied or refuse it."""

import copy
import inspect
import os
import pickle

import numpy as np
import pytest

import tokid

WRONG = {"text": "0.5x", "-1": -1, "0": 0, "nan": np.nan, "inf": np.inf, "None": None, "True": True, "1j": 1j,
         "masked": np.ma.masked}
# Which of them mean something, by the default of a parameter, and by name where defaults do not tell.
BY_DEFAULT = {"auto": set(), "False": {"True"}, "True": {"True"}, "None": {"None"}}
COUNT, FROM_ZERO = set(), {"0"}
MEANT = {
    "seed": FROM_ZERO, "threads": FROM_ZERO, "first_step": FROM_ZERO, "before": FROM_ZERO, "begin": {"0", "None"},
    "period": FROM_ZERO, "hold_out": FROM_ZERO, "smoothing": {"0", "inf"}, "process_noise": FROM_ZERO,
    "measurement_noise": FROM_ZERO, "free_responses": FROM_ZERO, "slow": FROM_ZERO, "whiteness_lags": FROM_ZERO,
    "feedthrough": {"None", "True"}, "refine": {"None", "True"}, "wait": {"0", "inf"}, "markov_error": FROM_ZERO,
    "excess": FROM_ZERO, "frequencies": {"0", "-1", "True"}, "u_min": {"None", "0", "-1", "True"},
    "u_max": {"None", "0", "-1", "True", "inf"}, "report": {"None", "text"}, "amplitude": {"True"},
    "output_weight": {"None", "0", "True"}, "input_weight": {"True"}, "input_rate_weight": {"None", "0", "True"},
    "terminal_weight": {"None", "0", "True"}, "error_weight": {"None", "0", "True"},
    "input_change_weight": {"None", "0", "True"}, "inputs": {"None"}, "outputs": {"None"}, "missing": {"None"},
    "held": {"None"}, "dt": {"None"}, "plan inputs": COUNT, "plan steps": COUNT, "plan states": COUNT, "plan outputs": COUNT,
    "Ensemble u": {"None"}, "modes u": {"None"}, "y": {"None"}, "input_names": {"None", "text"},
    "input_units": {"None", "text"}, "path": {"text"}, "learn y": COUNT, "predict initial_estimate": {"True"},
    "Ensemble input_names": {"None"}, "Ensemble input_units": {"None"}, "identify input_names": {"None"},
    "identify input_units": {"None"}, "load path": COUNT, "save path": COUNT,
}
# None leaves the choice to tokid.
for _name in ("states", "lags", "method", "smoothing", "jumps", "delays", "weighting", "initial_state", "nominal", "rows", "cols"):
    MEANT[f"identify {_name}"] = {"None"} | MEANT.get(_name, set())
MEANT["plan initial_state"] = {"None"}
MEANT["cross_validate seed"] = MEANT["modes seed"] = {"0", "None"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    data = tokid.example("oscillator", experiments=12, steps=12)
    model = tokid.identify(data, states=4, lags=2, initial_state="zero", keep_state=True)
    return data, model, model.lqr(1.0, 1.0)


def calls(data, model, controller):
    few = {"states": 2, "lags": 1, "refine": False, "smoothing": 1.0}
    yield tokid.identify, [data], few
    yield tokid.Ensemble, [data.u, data.y], {}
    yield tokid.Ensemble.load, ["data.h5"], {}
    yield tokid.cross_validate, [data], {**few, "folds": 2}
    yield tokid.plan, [], {"states": 2, "inputs": 1, "outputs": 1, "steps": 10}
    yield tokid.example, ["oscillator"], {"experiments": 2, "steps": 8}
    yield tokid.example_system, ["oscillator"], {"steps": 8}
    for method in (model.simulate, model.predict, model.validate, model.innovations):
        yield method, [data], {}
    yield model.lqr, [1.0, 1.0], {}
    yield controller.simulate, [], {}
    yield model.observer, [], {}
    yield model.modes, [], {}
    yield model.lifted_map, [], {}
    yield model.save, ["saved.npz"], {}
    yield model.frequency_response, [[1.0], 5], {}
    yield model.learn, [data.y[0], data.u[0], data.y[0]], {"input_weight": 1.0}
    yield tokid.FileLock, ["state.h5"], {}


@pytest.mark.filterwarnings("ignore")
def test_values_mean_something_or_are_refused(made, tmp_path, monkeypatch):
    """New parameters are found by themselves. The default tells what they may be, or the table above."""
    monkeypatch.chdir(tmp_path)
    made[0].save("data.h5")
    tried, accepted = 0, []
    for call, arguments, keywords in calls(*made):
        for i, parameter in enumerate(inspect.signature(call).parameters.values()):
            if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                continue
            name = parameter.name
            by_default = BY_DEFAULT.get(str(parameter.default), set())
            meant = MEANT.get(f"{call.__name__} {name}", MEANT.get(name, by_default))
            before = set(os.listdir())
            for word, value in WRONG.items():
                given, named = list(arguments), dict(keywords)
                if i < len(given):
                    given[i] = value
                else:
                    named[name] = value
                tried += 1
                if word in meant:
                    continue
                try:
                    call(*given, **named)
                except (ValueError, TypeError, OSError):
                    continue
                accepted.append(f"{call.__qualname__}: {name}={value!r}")
            assert set(os.listdir()) == before
    assert accepted == [] and tried > 1000


@pytest.mark.parametrize("value", ["0.5", True, 1j, -1, 0, np.nan, np.inf, np.ma.masked, [1.0]])
def test_a_sample_time_is_a_positive_number(made, value):
    data, model, _ = made
    for make in (lambda: tokid.Ensemble(data.u, data.y, dt=value), lambda: tokid.Ensemble.empty(1, 2, 1, 1, dt=value),
                 lambda: tokid.Ensemble(list(data.u), list(data.y), dt=value), lambda: tokid.identify(data.u, data.y, dt=value),
                 lambda: tokid.Model.from_matrices(model.A, model.B, model.C, dt=value)):
        with pytest.raises(ValueError, match="dt"):
            make()
    assert tokid.Ensemble(data.u, data.y, dt=np.array(0.5)).dt == 0.5  # as NumPy's files hold it


def test_masked_samples_are_missing(made):
    data, model, _ = made

    def state_after(u, y):
        observer = model.observer(samples_missing=True)
        observer.step(data.u[0, 0], data.y[0, 0])
        observer.step(u, y)
        return observer.state

    u, y, mask = data.u[0, 1], data.y[0, 1], [True, False]
    masked = np.ma.masked_array([999.0, y[1]], mask=mask)
    expected = state_after(u, [np.nan, y[1]])
    for given in (masked, [np.ma.masked, y[1]]):
        np.testing.assert_array_equal(state_after(u, given), expected)
    assert np.abs(expected - state_after(u, [999.0, y[1]])).max() > 1
    many = [np.ma.masked_array(data.y[0], mask=True), data.y[1]]
    found = tokid.Ensemble(data.u[:2], many).y
    assert np.isnan(found[0]).all() and (found[1] == data.y[1]).all()
    with pytest.raises(ValueError, match="weight"):
        model.lqr([np.ma.masked, 1.0], 1.0)
    with pytest.raises(ValueError, match="u_min: NaN"):
        made[2].simulate(u_min=np.ma.masked_array([1.0, 1.0], mask=mask))


def test_complex_numbers_are_refused(made):
    data, model, controller = made
    u, y = data.u + 1j, np.ma.masked_array(data.y + 1j, mask=False)
    observer, lifted = model.observer(), model.lifted_map()
    for call in (lambda: tokid.Ensemble(u, data.y), lambda: tokid.Ensemble(data.u, y), lambda: tokid.Ensemble(list(u), list(data.y)),
                 lambda: model.simulate(u), lambda: model.predict(data.u, y), lambda: model.simulate(data.u, x0=[1j] * 4),
                 lambda: observer.step(u[0, 0], data.y[0, 0]), lambda: observer.step(data.u[0, 0], y[0, 0]),
                 lambda: observer.predict(u[0]), lambda: lifted.matvec(u[0].ravel()), lambda: lifted.rmatvec(y[0].ravel()),
                 lambda: model.learn(y[0], data.u[0], data.y[0], input_weight=1.0), lambda: controller.input(0, [1j] * 4),
                 lambda: controller.simulate(x0=[1j] * 4), lambda: model.lqr(1j, 1.0), lambda: model.frequency_response([1j], 5),
                 lambda: tokid.Model.from_matrices([np.eye(2) * 1j], [np.ones((2, 1))], [np.ones((1, 2))])):
        with pytest.raises(ValueError, match="complex128 found"):
            call()
    assert observer.k == 0


def shown(value):
    return value if isinstance(value, (list, tuple)) else [value]


def test_arrays_are_read_only_or_writing_has_an_effect(made):
    data, model, controller = made
    observer = model.observer()
    observer.step(data.u[0, 0], data.y[0, 0])
    seen = 0
    for held in (data, model, controller, observer, model.state, model.lifted_map(), model.identification, model.at(2),
                 model.modes(), model.validate(data), model.learn(data.y[0], data.u[0], data.y[0], input_weight=1.0),
                 controller.simulate(), tokid.plan(states=2, inputs=1, outputs=1, steps=10)):
        for name in (name for name in dir(type(held)) if not name.startswith("_")):
            value = getattr(held, name)
            arrays = [array for array in shown(value) if isinstance(array, np.ndarray) and array.size]
            if not arrays:
                continue
            seen += 1
            again = [array for array in shown(getattr(held, name)) if isinstance(array, np.ndarray) and array.size]
            for array, other in zip(arrays, again):
                assert not array.flags.writeable or np.shares_memory(array, other), f"{type(held).__name__}.{name}"
            assert not isinstance(value, list) or getattr(held, name) is value, f"{type(held).__name__}.{name}"
    assert seen > 20
    with pytest.raises(TypeError):
        controller.K[0] = np.zeros((2, 4))


in_each_way = pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda held: pickle.loads(pickle.dumps(held))], ids=["copy", "deepcopy", "pickle"])


@in_each_way
def test_public_objects_are_copied_or_refuse_it(made, tmp_path, copied):
    data, model, controller = made
    rates = model.lqr(1.0, 1.0, input_rate_weight=0.1, y_reference=np.ones((model.steps, 2)))
    objects = [data, model, controller, rates, model.state, model.lifted_map(), model.A, model.at(2), model.identification,
               model.modes(), model.validate(data), controller.simulate(), controller.expected_cost(model),
               model.observer().step(data.u[0, 0], data.y[0, 0]), tokid.plan(states=2, inputs=1, outputs=1, steps=10),
               model.learn(data.y[0], data.u[0], data.y[0], input_weight=1.0)]
    kinds = set()
    for held in objects:
        other = copied(held)
        kinds.add(type(held).__name__)
        assert type(other) is type(held) and repr(other) == repr(held)
    assert kinds > {"Ensemble", "Model", "Controller", "LiftedMap", "UpdateState", "LearnedRun"}
    for held in (controller, rates):
        other = copied(held)
        for name in ("K", "L", "feedforward", "u_nominal", "y_nominal", "cost_to_go"):
            assert len(getattr(other, name)) == len(getattr(held, name))
            for one, beside in zip(getattr(other, name), getattr(held, name)):  # states may differ in number
                np.testing.assert_array_equal(one, beside)
        seed = {"experiments": 3, "seed": 4}
        np.testing.assert_array_equal(other.simulate(**seed).data.u, held.simulate(**seed).data.u)
    lifted = model.lifted_map(begin=2)
    np.testing.assert_array_equal(copied(lifted).dense(), lifted.dense())
    with tokid.FileLock(tmp_path / "state.h5") as lock, pytest.raises(TypeError, match="can't be copied or pickled"):
        copied(lock)


@in_each_way
@pytest.mark.parametrize("options", [{}, {"initial_state": "unknown"}, {"samples_missing": True}])
def test_copies_of_observers_go_on_alike(made, copied, options):
    data, model, _ = made
    observer = model.observer(**options)
    for k in range(model.steps):
        other = copied(observer)
        assert repr(other) == repr(observer)
        one, beside = (each.step(data.u[0, k], data.y[0, k]) for each in (observer, other))
        np.testing.assert_array_equal(one.prediction, beside.prediction)
        np.testing.assert_array_equal(other.state, observer.state)
        observer = other
