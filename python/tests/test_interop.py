# SPDX-License-Identifier: BSD-3-Clause
"""Models and ensembles in the forms of python-control, SciPy, xarray and pandas."""

import doctest
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import control
import matplotlib

matplotlib.use("Agg")

import numpy as np
import pandas as pd
import pytest
import scipy.signal
import tokid
import xarray as xr
from matplotlib import pyplot
from tokid.interop import dataframe_of, simulate_ltv

TOKID = os.environ.get("TOKID", str(Path(__file__).resolve().parents[2] / "build" / "bin" / "tokid"))
STEPS = 40


def random_system(states=3, inputs=2, outputs=2, seed=0):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(states, states))
    a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
    return a, rng.normal(size=(states, inputs)), rng.normal(size=(outputs, states)), rng.normal(size=(outputs, inputs))


def constant_model(steps=STEPS, period="invariant", **options):
    a, b, c, d = random_system()
    return tokid.Model.from_matrices([a] * steps, [b] * steps, [c] * steps, [d] * steps, period=period, **options)


def growing_model():
    """No state at first, then one, then two, and one at the end."""
    rng = np.random.default_rng(4)
    dims = [0, 1, 2, 2, 2, 1]
    pairs = list(zip(dims[:-1], dims[1:]))
    return tokid.Model.from_matrices(
        [rng.normal(size=(after, before)) for before, after in pairs],
        [rng.normal(size=(after, 1)) for _, after in pairs],
        [rng.normal(size=(1, before)) for before, _ in pairs],
        [rng.normal(size=(1, 1)) for _ in pairs],
        k_begin=2,
    )


@pytest.fixture(scope="module")
def varying():
    return tokid.example_system("oscillator", steps=STEPS)


@pytest.fixture(scope="module")
def inputs():
    return np.random.default_rng(1).normal(size=(3, STEPS, 2))


@pytest.fixture(scope="module")
def data():
    return tokid.example("oscillator", experiments=5, steps=12, measurement_noise=0.1, initial_state="unknown")


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.nanmax(np.abs(wanted)))


# ---- objects of one step ----


def test_control_object_of_a_step(varying):
    step = varying.to_control(7)
    assert isinstance(step, control.StateSpace)
    assert step.dt == varying.dt == 0.05
    assert step.input_labels == ["u1", "u2"] and step.output_labels == ["y1", "y2"]
    for letter in "ABCD":
        np.testing.assert_array_equal(getattr(step, letter), getattr(varying, letter)[7])
    step.A[0, 0] = 17.0  # no view of the model
    assert varying.A[7][0, 0] != 17.0


def test_names_reach_control():
    model = constant_model(dt=0.1, input_names=["torque", "load"], output_names=["angle", "rate"])
    assert model.to_control().input_labels == ["torque", "load"]
    assert model.to_control().output_labels == ["angle", "rate"]


def test_scipy_object_of_a_step(varying):
    step = varying.to_scipy(7)
    assert isinstance(step, scipy.signal.dlti) and isinstance(step, scipy.signal.StateSpace)
    assert step.dt == 0.05
    for letter in "ABCD":
        np.testing.assert_array_equal(getattr(step, letter), getattr(varying, letter)[7])


@pytest.mark.parametrize("form", ["to_control", "to_scipy"])
def test_step_may_be_left_out_of_a_time_invariant_model(varying, form):
    for model in (constant_model(), constant_model(period=0)):
        np.testing.assert_array_equal(getattr(model, form)().A, model.A[0])
    with pytest.raises(ValueError, match="k: none found, a step from 0 to 39 needed: the model varies with time"):
        getattr(varying, form)()
    with pytest.raises(ValueError, match="k: 40 found, a whole number from 0 to 39 needed"):
        getattr(varying, form)(40)


@pytest.mark.parametrize("form", ["to_control", "to_scipy"])
def test_step_whose_states_change_has_no_object(form):
    model = growing_model()
    with pytest.raises(ValueError, match="k: step 3 has 1 states before and 2 after it.* pad=True, or one of the steps 4 to 5"):
        getattr(model, form)(3)
    assert getattr(model, form)(4).A.shape == (2, 2)
    padded = [getattr(model, form)(k, pad=True) for k in range(2, 7)]
    np.testing.assert_array_equal([step.A for step in padded], model.A.stack())
    np.testing.assert_array_equal([step.C for step in padded], model.C.stack())
    u = np.random.default_rng(5).normal(size=(2, 7, 1))
    close(simulate_ltv(padded, u[:, 2:]), model.simulate(u)[:, 2:])


# ---- simulation ----


def test_constant_model_as_control_has_it(inputs):
    model = constant_model(dt=0.1)
    system, x0 = model.to_control(), np.array([1.0, -2.0, 0.5])
    y, x = simulate_ltv(system, inputs[0], x0, return_states=True)
    response = control.forced_response(system, U=inputs[0].T, X0=x0)
    close(y, response.outputs.T)
    close(x[:-1], response.states.T)
    close(simulate_ltv([system] * STEPS, inputs[0], x0), response.outputs.T)
    close(model.simulate(inputs[0], x0), response.outputs.T)


def test_constant_model_as_scipy_has_it(inputs):
    model = constant_model(dt=0.1)
    system, x0 = model.to_scipy(), np.array([1.0, -2.0, 0.5])
    _, y, x = scipy.signal.dlsim(system, inputs[0], x0=x0)
    found, states = simulate_ltv(system, inputs[0], x0, return_states=True)
    close(found, y)
    close(states[:-1], x)


@pytest.mark.parametrize("form", ["at", "to_control", "to_scipy", "tuple"])
def test_varying_model_as_tokid_has_it(varying, inputs, form):
    def of(k):
        step = varying.at(k)
        return (step.A, step.B, step.C, step.D) if form == "tuple" else getattr(varying, form)(k)

    x0 = np.random.default_rng(2).normal(size=(3, 4))
    systems = [of(k) for k in range(STEPS)]
    close(simulate_ltv(systems, inputs, x0), varying.simulate(inputs, x0))
    close(simulate_ltv(systems, inputs[1]), varying.simulate(inputs[1]))
    close(simulate_ltv(systems, inputs[:, :9], x0), varying.simulate(inputs, x0)[:, :9])  # fewer steps than systems


def test_states_may_come_and_go():
    model = growing_model()
    u = np.random.default_rng(5).normal(size=(2, 7, 1))
    systems = [model.at(k) for k in range(model.k_begin, model.k_end)]
    y, x = simulate_ltv(systems, u[:, 2:], return_states=True)
    close(y, model.simulate(u)[:, 2:])
    assert x.shape == (2, 6, 2)
    assert np.isnan(x).sum(axis=(0, 2)).tolist() == [4, 2, 0, 0, 0, 2]


def test_missing_input_is_missing_from_there_on(varying, inputs):
    u = inputs[0].copy()
    u[11, 1] = np.nan
    y = simulate_ltv([varying.at(k) for k in range(STEPS)], u)
    assert not np.isnan(y[:11]).any() and np.isnan(y[12:]).all()


def test_what_can_not_be_simulated(varying, inputs):
    a, b, c, d = random_system()
    good = (a, b, c, d)
    with pytest.raises(ValueError, match=r"systems\[1\]: a system in continuous time found"):
        simulate_ltv([good, control.ss(a, b, c, d)], inputs[0, :2])
    with pytest.raises(ValueError, match=r"systems\[0\]: a system in continuous time found"):
        simulate_ltv([scipy.signal.lti(a, b, c, d)], inputs[0, :1])
    with pytest.raises(ValueError, match=r"u: 40 steps found, at most 2 needed"):
        simulate_ltv([good] * 2, inputs)
    with pytest.raises(ValueError, match=r"systems\[1\]: 2 states found, 3 needed"):
        simulate_ltv([good, random_system(2)], inputs[0, :2])
    with pytest.raises(ValueError, match=r"systems\[1\]: 1 outputs found, 2 needed"):
        simulate_ltv([good, random_system(outputs=1)], inputs[0, :2])
    with pytest.raises(ValueError, match=r"systems\[0\].B: shape \(2, 2\) found, \(3, 2\) needed"):
        simulate_ltv([(a, b[:2], c, d)], inputs[0, :1])
    with pytest.raises(ValueError, match="sample times 0.1 to 0.2 s found, one needed"):
        simulate_ltv([control.ss(*good, 0.1), control.ss(*good, 0.2)], inputs[0, :2])
    with pytest.raises(ValueError, match=r"systems\[0\]: dict found"):
        simulate_ltv([{}], inputs[0, :1])
    with pytest.raises(ValueError, match=r"x0: shape \(4,\) found, \(3,\) needed"):
        simulate_ltv(good, inputs, np.zeros(4))
    with pytest.raises(ValueError, match="Model.simulate"):
        simulate_ltv(varying, inputs)


# ---- xarray ----


def test_model_as_dataset(varying):
    dataset = varying.to_xarray()
    for name in "ABCDG":
        np.testing.assert_array_equal(dataset[name], np.asarray(getattr(varying, name)))
    assert dataset.A.dims == ("k", "state_next", "state")
    assert dataset.G.dims == ("k", "state_next", "output")
    np.testing.assert_array_equal(dataset.A.sel(k=7), varying.A[7])
    np.testing.assert_array_equal(dataset.B.sel(input="u2")[7], varying.B[7][:, 1])
    np.testing.assert_array_equal(dataset.time, np.arange(STEPS) * 0.05)
    assert dataset.time.attrs["units"] == "s"
    assert dataset.attrs["dt"] == 0.05 and json.loads(dataset.attrs["options"]) == {}


def test_entries_that_a_step_does_not_have_are_missing_in_a_dataset():
    model = growing_model()
    dataset = model.to_xarray()
    assert dataset.k.values.tolist() == [2, 3, 4, 5, 6]
    assert dataset.state_dim.values.tolist() == [0, 1, 2, 2, 2]
    assert dataset.state_dim_next.values.tolist() == [1, 2, 2, 2, 1]
    for s, matrix in enumerate(model.A):
        kept = dataset.A[s, : matrix.shape[0], : matrix.shape[1]]
        np.testing.assert_array_equal(kept, matrix)
        assert np.isnan(dataset.A[s]).sum() == 4 - matrix.size
    np.testing.assert_array_equal(dataset.A.fillna(0.0), model.A.stack())


def test_all_that_a_model_knows_is_in_its_dataset():
    data = tokid.example("oscillator", experiments=40, steps=12)
    data.y[...] += np.arange(12)[:, np.newaxis]  # a mean motion
    model = tokid.identify(
        data.u, data.y, dt=0.5, states=4, lags=2, nominal="mean", input_units=["N", "N"], output_units=["m", "m/s"]
    )
    dataset = model.to_xarray()
    for s, sigma in enumerate(model.singular_values):
        np.testing.assert_array_equal(dataset.singular_value[s, : len(sigma)], sigma)
    for name in ("condition", "rank", "lags"):
        np.testing.assert_array_equal(dataset[name], getattr(model, name))
    assert dataset.y_nominal.dims == ("step", "output")
    np.testing.assert_array_equal(dataset.y_nominal, model.y_nominal)
    assert dataset.output_unit.values.tolist() == ["m", "m/s"]
    assert json.loads(dataset.attrs["options"]) == model.options


def test_ensemble_as_dataset(data):
    dataset = data.to_xarray()
    np.testing.assert_array_equal(dataset.y, data.y)
    np.testing.assert_array_equal(dataset.u.sel(experiment=3, input="u2"), data.u[3, :, 1])
    np.testing.assert_array_equal(dataset.time, data.time)
    assert dataset.attrs == {"dt": 0.05, "initial_state": "unknown"}
    assert np.shares_memory(dataset.u.values, data.u)
    free = tokid.example(experiments=3, steps=5, free_responses=2).to_xarray()
    assert free.free_y.dims == ("free_experiment", "free_k", "output")
    assert isinstance(free.mean("experiment"), xr.Dataset)


@pytest.mark.parametrize("kind", ["plain", "with gaps", "of unequal length"])
def test_ensemble_comes_back_from_a_dataset(kind):
    ensemble = ensembles()[kind]
    dataset = ensemble.to_xarray()
    same(tokid.Ensemble.from_xarray(dataset), ensemble)
    same(tokid.Ensemble.from_xarray(dataset.transpose()), ensemble)
    same(tokid.Ensemble.from_xarray(dataset.isel(k=slice(None, None, -1))), ensemble)
    same(tokid.Ensemble.from_xarray(dataset.isel(experiment=[2, 0])), ensemble.subset([2, 0]))
    same(tokid.Ensemble.from_xarray(dataset.isel(k=slice(2, 6))), ensemble.stretch(2, 6))
    same(tokid.Ensemble.from_xarray(dataset.swap_dims(k="time").drop_vars("k")), ensemble)
    every_second = tokid.Ensemble.from_xarray(dataset.isel(k=slice(None, None, 2)))
    assert (every_second.steps, every_second.dt) == (5, pytest.approx(2 * ensemble.dt))
    if ensemble.length is not None:
        assert every_second.length.tolist() == [(n + 1) // 2 for n in ensemble.length]
    holed = tokid.Ensemble.from_xarray(dataset.isel(k=[0, 1, 4, 8]))
    assert holed.steps == 9 and np.isnan(holed.u[:, 2:4]).all()
    np.testing.assert_array_equal(holed.y[:, [0, 1, 4, 8]], ensemble.y[:, [0, 1, 4, 8]])


def test_free_responses_come_back_from_a_dataset():
    ensemble = tokid.example(experiments=3, steps=5, free_responses=2)
    dataset = ensemble.to_xarray()
    np.testing.assert_array_equal(tokid.Ensemble.from_xarray(dataset).free_y, ensemble.free_y)
    assert tokid.Ensemble.from_xarray(dataset.isel(k=slice(1, 5))).free_y is None  # as of stretch


def test_datasets_of_others():
    time = pd.date_range("2026-11-22", periods=4, freq="250ms")
    dataset = xr.Dataset({"u": ("time", np.arange(4)), "y": (("output", "time"), np.ones((2, 4)))}, {"time": time})
    ensemble = tokid.Ensemble.from_xarray(dataset, output_names=["a", "b"])
    assert (ensemble.u.shape, ensemble.y.shape, ensemble.dt) == ((1, 4, 1), (1, 4, 2), 0.25)
    assert ensemble.u[0, 3, 0] == 3 and ensemble.output_names == ["a", "b"] and ensemble.initial_state is None
    assert tokid.Ensemble.from_xarray(dataset.drop_vars("time"), dt=0.5).dt == 0.5
    for wrong, text in (
        (dataset.rename(u="force"), None),
        (dataset.rename(u="force", y="angle"), r"data: variables \['force', 'angle'\] found, 'u' or 'y' needed"),
        (dataset.rename(time="t"), r"u: dimensions \('t',\) found, 'k' or 'time' needed"),
        (dataset.expand_dims("trial"), "apart from it only 'experiment' and 'input'; rename"),
        (dataset.assign(u=("k", np.ones(3))), "u, y: steps along 'k' and 'time' found, one dimension needed"),
        (dataset.isel(time=[0, 1, 1]), "time: two entries found for a step, one needed"),
        (dataset.isel(time=[]), "data: no steps found"),
        (dataset.assign(u=("time", list("abcd"))), "u: an array of <U1 found, real numbers needed"),
    ):
        if text is None:
            assert tokid.Ensemble.from_xarray(wrong).inputs == 0
            continue
        with pytest.raises(ValueError, match=text):
            tokid.Ensemble.from_xarray(wrong)
    with pytest.raises(ValueError, match="data: ndarray found, a Dataset needed"):
        tokid.Ensemble.from_xarray(np.ones(3))


def test_identify_takes_datasets():
    data = tokid.example("oscillator", experiments=30, steps=12)
    options = {"states": 4, "lags": 2}
    model, dataset = tokid.identify(data, **options), data.to_xarray()
    np.testing.assert_array_equal(np.asarray(tokid.identify(dataset, **options).A), np.asarray(model.A))
    assert tokid.identify(dataset, input_names=["a", "b"], **options).input_names == ["a", "b"]
    state = tokid.identify(data, **options, refine=False, keep_state=True).state
    fresh = tokid.example("oscillator", experiments=30, steps=12, seed=2).to_xarray()
    more = tokid.update(state, fresh.drop_attrs().drop_vars("time"))  # in the sample time of the state
    assert more.updated.experiments == 60 and more.dt == data.dt
    np.testing.assert_array_equal(model.simulate(dataset), model.simulate(data))
    np.testing.assert_array_equal(model.predict(dataset), model.predict(data))
    with pytest.raises(ValueError, match="y: found beside a Dataset"):
        model.predict(dataset, data.y)
    with pytest.raises(ValueError, match="y: found beside a Dataset"):
        tokid.update(state, dataset, data.y)
    with pytest.raises(ValueError, match="y: found beside a Dataset"):
        tokid.identify(dataset, data.y)
    with pytest.raises(ValueError, match="'u' and 'y' needed"):
        tokid.identify(dataset[["u"]])


# ---- pandas ----


def ensembles():
    plain = tokid.example("oscillator", experiments=4, steps=9, measurement_noise=0.1)
    holed = tokid.example("oscillator", experiments=4, steps=9, measurement_noise=0.1)
    holed.y[1, 3, 0] = np.nan
    holed.u[2, 4:6] = holed.y[2, 4:6] = np.nan
    holed.u[0, 7] = holed.y[0, 7] = np.nan
    u, y = np.array(plain.u), np.array(plain.y)
    short = tokid.Ensemble(
        u,
        y,
        dt=1 / 3,
        length=[9, 7, 5, 9],
        initial_state="unknown",
        input_names=["torque", "load, left"],
        output_names=["angle", "rate"],
        input_units=["N m", "N"],
        output_units=["rad", "rad/s"],
    )
    short.u[1, 7:] = short.y[1, 7:] = short.u[2, 5:] = short.y[2, 5:] = np.nan
    return {"plain": plain, "with gaps": holed, "of unequal length": short}


def same(a, b):
    assert a.fingerprint == b.fingerprint and a.dt == b.dt
    np.testing.assert_array_equal(a.u, b.u)
    np.testing.assert_array_equal(a.y, b.y)
    assert (a.length is None) == (b.length is None) and (a.length is None or np.array_equal(a.length, b.length))
    for name in ("initial_state", "input_names", "output_names", "input_units", "output_units", "experiment_names"):
        assert getattr(a, name) == getattr(b, name)


@pytest.mark.parametrize("kind", ensembles())
def test_ensemble_comes_back_from_a_table(kind):
    ensemble = ensembles()[kind]
    table = ensemble.to_dataframe()
    same(tokid.Ensemble.from_dataframe(table), ensemble)
    same(tokid.Ensemble.from_dataframe(table.sample(frac=1, random_state=0)), ensemble)


@pytest.mark.parametrize("kind", ensembles())
def test_table_is_the_one_that_the_tool_writes(kind, tmp_path):
    ensemble = ensembles()[kind]
    ensemble.save(tmp_path / "data.npz")
    subprocess.run([TOKID, "convert", tmp_path / "data.npz", tmp_path / "data.csv"], check=True, capture_output=True)
    exact = {} if int(pd.__version__.split(".")[0]) > 2 else {"float_precision": "round_trip"}  # by default from 3 on
    written = pd.read_csv(tmp_path / "data.csv", comment="#", **exact)
    pd.testing.assert_frame_equal(ensemble.to_dataframe(), written, check_exact=True)
    # And the other way: the tool's file is read as the table is.
    notes = {"inputs": ensemble.input_names, "outputs": ensemble.output_names}
    from_table = tokid.Ensemble.from_dataframe(written, dt=ensemble.dt, **notes)
    from_file = tokid.load(tmp_path / "data.csv")
    np.testing.assert_array_equal(from_table.u, from_file.u)
    np.testing.assert_array_equal(from_table.y, from_file.y)


@pytest.mark.parametrize("dt", [0.05, 0.1, 1 / 3, 1e-3, 2.0, 7e-5])
def test_spacing_is_what_the_reader_of_csv_finds(dt, tmp_path):
    k = np.array([0, 1, 3, 4, 5, 9])
    table = pd.DataFrame({"experiment": "a", "time": 0.7 + k * dt, "u1": k * 1.0, "y1": k + 0.5})
    table.to_csv(tmp_path / "data.csv", index=False)
    found, wanted = tokid.Ensemble.from_dataframe(table), tokid.load(tmp_path / "data.csv")
    same(found, wanted)
    assert found.steps == 10 and found.dt == pytest.approx(dt, rel=1e-9)


def tables():
    """Tables with columns in every form, as the .csv file of the same."""
    base = pd.DataFrame(
        {
            "experiment": ["b", "b", "a", "a"],
            "k": [3, 5, 3, 4],
            "u1": [1.0, 2.0, 3.0, 4.0],
            "y1": [0.5, np.nan, 1.5, 2.5],
            "other": ["p", "q", "r", "s"],
        }
    )
    return {
        "floats": base,
        "whole numbers": base.astype({"u1": int}),
        "32 bits": base.astype({"u1": np.float32, "k": np.int8}),
        "numbers of pandas": base.astype({"u1": "Int64", "y1": "Float64"}),
        "texts": base.astype({"u1": str}).assign(y1=["0.5", "NA", " 1.5", "2.5e0"]),
        "objects": base.assign(y1=np.array([0.5, None, 1.5, 2.5], dtype=object)),
        "categories": base.astype({"experiment": "category"}),
        "an index": base.set_index(["experiment", "k"]),
        "other columns between": base[["y1", "other", "u1", "k", "experiment"]],
    }


@pytest.mark.parametrize("kind", tables())
def test_table_in_every_form(kind):
    ensemble = tokid.Ensemble.from_dataframe(tables()[kind])
    assert (ensemble.experiments, ensemble.steps, ensemble.dt) == (2, 3, 1.0)
    np.testing.assert_array_equal(ensemble.u[:, :, 0], [[1, np.nan, 2], [3, 4, np.nan]])
    np.testing.assert_array_equal(ensemble.y[:, :, 0], [[0.5, np.nan, np.nan], [1.5, 2.5, np.nan]])


def test_columns_chosen_by_name():
    table = pd.DataFrame({"time": [0.0, 0.1], "speed": [1.0, 2.0], "u9": [3.0, 4.0], "y": [5.0, 6.0]})
    ensemble = tokid.Ensemble.from_dataframe(table, inputs=["speed"], outputs=["u9"], input_units=["m/s"])
    assert (ensemble.input_names, ensemble.output_names, ensemble.input_units) == (["speed"], ["u9"], ["m/s"])
    assert ensemble.dt == 0.1 and ensemble.u[0, 1, 0] == 2.0 and ensemble.y[0, 1, 0] == 4.0
    bare = tokid.Ensemble.from_dataframe(table[["u9", "y"]].set_axis([7, 8], axis=1), inputs=[7], outputs=[8])
    assert bare.steps == 2 and bare.input_names == ["7"]  # rows are steps where nothing else is said
    assert tokid.Ensemble.from_dataframe(table, dt=0.05).steps == 3


def test_notes_hold_only_as_far_as_the_table_is_still_the_same():
    ensemble = ensembles()["of unequal length"]
    table = ensemble.to_dataframe()
    part = tokid.Ensemble.from_dataframe(table[table["experiment"] >= 2])
    assert part.length.tolist() == [5, 9] and part.dt == 1 / 3
    every_second = table[np.isclose(table["time"] * 3 % 2, 0)]
    assert tokid.Ensemble.from_dataframe(every_second).dt == pytest.approx(2 / 3)
    filled = table.fillna(0.0)
    filled = pd.concat([filled, pd.DataFrame({"experiment": [2], "time": [8 / 3], "angle": [7.0]})])
    filled.attrs = table.attrs
    longer = tokid.Ensemble.from_dataframe(filled)
    assert longer.length is None and longer.y[2, 8, 0] == 7.0
    renamed = tokid.Ensemble.from_dataframe(table.rename(columns={"torque": "u1", "load, left": "u2"}))
    assert renamed.input_names == ["u1", "u2"] and renamed.input_units == ["", ""]
    assert renamed.output_units == ["rad", "rad/s"]


BAD = {
    "no inputs": (
        {"v": [1.0], "y1": [1.0]},
        {},
        "no column whose name begins with u found among 'v', 'y1'; name the inputs",
    ),
    "no outputs": (
        {"u1": [1.0]},
        {"outputs_required": True},
        "no column whose name begins with y found among 'u1'; name the outputs",
    ),
    "unknown column": ({"u1": [1.0]}, {"inputs": ["v"]}, "no column 'v' found among 'u1'"),
    "both": (
        {"u1": [1.0], "y1": [1.0]},
        {"outputs": ["u1"], "inputs": ["u1"]},
        "column 'u1' is listed both as an input and as an output. List it only once",
    ),
    "text": ({"u1": ["1", "x"], "y1": [1.0, 2.0]}, {}, "row 1, column 'u1': 'x' found, a number needed"),
    "dates": ({"k": pd.to_datetime(["2026-01-01"]), "u1": [1.0]}, {}, "column 'k': datetime64"),
    "no date": (
        {"time": pd.to_datetime(["2026-01-01", None]), "u1": [1.0, 2.0]},
        {},
        "row 1, column 'time': 'NaT' found, a finite time needed",
    ),
    "days apart": (
        {"experiment": [1, 2], "time": pd.to_datetime(["2026-01-01", "2026-01-02"]), "u1": [1.0, 2.0]},
        {},
        "column 'time': experiment '2' begins 86400 s after the end of '1', times from a common origin needed",
    ),
    "no experiment": (
        {"experiment": ["a", None], "u1": [1.0, 2.0]},
        {},
        "row 1, column 'experiment': nothing found, a number or name needed",
    ),
    "nameless experiment": (
        {"experiment": ["a", ""], "u1": [1.0, 2.0]},
        {},
        "row 1, column 'experiment': nothing found, a number or name needed",
    ),
    "half a step": ({"k": [0, 0.5], "u1": [1.0, 2.0]}, {}, "row 1, column 'k': '0.5' found, a whole number needed"),
    "endless time": (
        {"time": [0, np.inf], "u1": [1.0, 2.0]},
        {},
        "row 1, column 'time': 'inf' found, a finite time needed",
    ),
    "twice": (
        {"experiment": ["a", "b", "a"], "k": [1, 1, 1], "u1": [1.0, 2.0, 3.0]},
        {},
        "row 2: a second row for step 0 of experiment 'a' found, one needed",
    ),
    "uneven": (
        {"time": [0, 1, 2.2], "u1": [1.0, 2.0, 3.0]},
        {"dt": 1.0},
        "row 2, column 'time': 2.2 found, which differs by 0.2 from even steps of 1 that begin at 0; resample to "
        "even times (option resample), or number the steps in a column 'k'",
    ),
    "wild": (
        {"k": [0, 10**9], "u1": [1.0, 2.0]},
        {},
        "1 experiments of 1000000001 steps found in only 2 rows, so most rows would be missing. Check the times or "
        "step numbers",
    ),
    "no rows": ({"u1": [], "y1": []}, {}, "no rows found, samples needed"),
    "endless": ({"u1": [np.inf], "y1": [1.0]}, {}, "input u1: infinite value in experiment 0 at step 0"),
    "another name": ({"u1": [1.0]}, {"inputs": "u2"}, "no column 'u2' found among 'u1'"),
    "no time": ({"time": [0, 1], "u1": [1.0, 2.0]}, {"dt": 0.0}, "dt: 0 found, a positive time in seconds needed"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_wrong_with_a_table_is_said(kind):
    columns, options, text = BAD[kind]
    with pytest.raises(ValueError) as raised:
        tokid.Ensemble.from_dataframe(pd.DataFrame(columns), **options)
    assert text in str(raised.value)


TIMES = {
    "dates": lambda t: pd.Timestamp("2026-11-22 10:00") + pd.to_timedelta(t, unit="s"),
    "dates of a zone": lambda t: pd.Timestamp(1792889999, unit="s", tz="Europe/Berlin") + pd.to_timedelta(t, unit="s"),
    "differences": lambda t: pd.to_timedelta(t + 5, unit="s"),
    "floats": lambda t: pd.Index(t + 0.7),
}


@pytest.mark.parametrize("kind", TIMES)
@pytest.mark.parametrize("dt", [0.05, 1 / 3, 1 / 30000])
def test_index_and_column_of_times(kind, dt):
    k = np.array([0, 1, 3, 4])
    table = pd.DataFrame({"u1": k * 1.0, "y1": k + 0.5}, index=TIMES[kind](k * dt))
    # Digits beyond a nanosecond are not there.
    tolerance = 1e-12 if kind == "floats" else 1e-9 / 4
    for form in (table, table[::-1], table.rename_axis("time"), table.rename_axis("time").reset_index()):
        found = tokid.Ensemble.from_dataframe(form)
        assert found.dt == pytest.approx(dt, abs=tolerance)
        np.testing.assert_array_equal(found.u[0, :, 0], [0, 1, np.nan, 3, 4])
    assert tokid.Ensemble.from_dataframe(table, dt=dt / 2).steps == 9
    both = pd.concat([table.assign(experiment=n) for n in (10, 9)])
    found = tokid.Ensemble.from_dataframe(both.assign(u1=both["u1"] + both["experiment"]))
    np.testing.assert_array_equal(found.u[:, 4, 0], [13, 14])
    if kind != "floats":  # a name says more than numbers do
        assert tokid.Ensemble.from_dataframe(table.rename_axis("stamp")).dt == pytest.approx(dt, abs=tolerance)
    period = tokid.Ensemble.from_dataframe(table.set_axis(pd.period_range("2026-01-01", periods=4, freq="h")))
    assert (period.dt, period.steps) == (3600, 4)
    timed = tokid.Ensemble.from_dataframe(table.assign(k=k))  # a column says it already
    assert (timed.dt, timed.steps) == (1, 5)


def test_index_that_is_not_understood_is_refused():
    table = pd.DataFrame({"u1": [1.0, 2.0], "y1": [3.0, 4.0]})
    dates = table.set_axis(["2026-01-01", "2026-01-02"])
    needed = "one of times or step numbers with the name 'time' or 'k' needed. If the rows are steps, state dt"
    with pytest.raises(ValueError, match=f"index: unnamed, of (str|object) found, {needed}"):
        tokid.Ensemble.from_dataframe(dates)
    pressures = table.set_axis(pd.Index([1.0, 1.5], name="pressure"))
    with pytest.raises(ValueError, match=f"index: 'pressure', of float64 found, {needed}"):
        tokid.identify(pressures)
    for known in (dates, pressures):
        found = tokid.Ensemble.from_dataframe(known, dt=0.5)
        assert (found.steps, found.dt) == (2, 0.5)
    records = pd.concat([table, table])
    with pytest.raises(ValueError, match=r"row 2: index 0 found a second time, a column 'experiment' needed"):
        tokid.Ensemble.from_dataframe(records, dt=0.5)
    with pytest.raises(ValueError, match=r"index: levels None, None found, the names 'experiment' and 'time' or 'k'"):
        tokid.Ensemble.from_dataframe(pd.concat({"a": table, "b": table}))
    named = pd.concat({"a": table, "b": table}, names=["experiment", "k"])
    assert len(tokid.Ensemble.from_dataframe(named)) == 2
    assert len(tokid.Ensemble.from_dataframe(records.assign(experiment=["a", "a", "b", "b"]))) == 2
    assert tokid.Ensemble.from_dataframe(records.assign(k=range(4))).steps == 4
    assert tokid.Ensemble.from_dataframe(records.reset_index(drop=True)).steps == 4


@pytest.mark.parametrize("kind", ["int64", "float32", "Int64", "uint8"])
def test_numbers_of_experiments_come_in_their_order(kind):
    table = pd.DataFrame({"experiment": [10, 2, 9, 2], "k": [0, 1, 0, 0], "u1": [10.0, 2.5, 9.0, 2.0]})
    found = tokid.Ensemble.from_dataframe(table.astype({"experiment": kind}))
    np.testing.assert_array_equal(found.u[:, :, 0], [[2, 2.5], [9, np.nan], [10, np.nan]])


def test_columns_of_one_name_are_told():
    table = pd.DataFrame([[1.0, 2.0, 3.0]], columns=["u1", "u1", "y1"])
    with pytest.raises(ValueError, match="columns: 2 columns 'u1' found, one needed"):
        tokid.Ensemble.from_dataframe(table)


def test_identify_and_models_take_tables():
    data = tokid.example("oscillator", experiments=30, steps=12)
    model = tokid.identify(data, states=4, lags=2)
    table = data.to_dataframe()
    from_table = tokid.identify(table, states=4, lags=2)
    for name in "ABCDG":
        np.testing.assert_array_equal(np.asarray(getattr(from_table, name)), np.asarray(getattr(model, name)))
    renamed = table.rename(columns={"u1": "a", "u2": "b", "y1": "c", "y2": "d"})
    named = tokid.identify(renamed, states=4, lags=2, input_names=["a", "b"], output_names=["c", "d"])
    np.testing.assert_array_equal(np.asarray(named.A), np.asarray(model.A))
    assert named.output_names == ["c", "d"]

    np.testing.assert_array_equal(named.simulate(renamed), model.simulate(data))
    np.testing.assert_array_equal(named.simulate(renamed.drop(columns=["c", "d"])), model.simulate(data))
    np.testing.assert_array_equal(named.predict(renamed), model.predict(data))
    with pytest.raises(ValueError, match="no column 'd' found"):
        named.predict(renamed.drop(columns="d"))
    with pytest.raises(ValueError, match="y: found beside a DataFrame"):
        model.predict(table, data.y)
    with pytest.raises(ValueError, match="y: found beside a DataFrame"):
        tokid.identify(table, data.y)
    with pytest.raises(ValueError, match="u, y: two DataFrames found, one DataFrame with all columns needed; input_names"):
        tokid.identify(table[["u1", "u2"]], table[["y1", "y2"]])


def test_computed_outputs_in_a_table(varying):
    data = tokid.example("oscillator", experiments=3, steps=STEPS, measurement_noise=0.1)
    table = varying.to_dataframe(data, horizon=3)
    assert table.columns.tolist() == [
        "experiment",
        "time",
        "u1",
        "u2",
        "y1",
        "y2",
        "simulated_y1",
        "simulated_y2",
        "predicted_y1",
        "predicted_y2",
    ]
    assert len(table) == 3 * STEPS
    second = table[table["experiment"] == 1]
    np.testing.assert_array_equal(second["time"], data.time)
    np.testing.assert_array_equal(second["y2"], data.y[1, :, 1])
    np.testing.assert_array_equal(second["simulated_y2"], varying.simulate(data)[1, :, 1])
    np.testing.assert_array_equal(second["predicted_y2"], varying.predict(data, horizon=3)[1, :, 1])
    same(tokid.Ensemble.from_dataframe(table, dt=data.dt, initial_state="zero"), data)
    alone = varying.to_dataframe(data.u[0])
    assert alone.columns.tolist() == ["experiment", "time", "u1", "u2", "simulated_y1", "simulated_y2"]


def test_any_samples_in_a_table():
    samples = np.arange(12.0).reshape(2, 3, 2)
    table = dataframe_of(samples, ["a", "b"], dt=0.5)
    assert table.values.tolist() == [
        [0, 0, 0, 1],
        [0, 0.5, 2, 3],
        [0, 1, 4, 5],
        [1, 0, 6, 7],
        [1, 0.5, 8, 9],
        [1, 1, 10, 11],
    ]
    with pytest.raises(ValueError, match="names: 'ab' found, a list of 2 texts needed"):
        dataframe_of(samples, "ab")


def test_what_does_not_fit_into_a_table():
    with pytest.raises(ValueError, match="free responses don't fit into a DataFrame"):
        tokid.example(experiments=2, steps=4, free_responses=1).to_dataframe()
    twice = tokid.Ensemble(np.zeros((1, 2, 1)), np.zeros((1, 2, 1)), input_names=["a"], output_names=["a"])
    with pytest.raises(ValueError, match="channel name 'a' found twice"):
        twice.to_dataframe()


# ---- packages that are not there ----

ABSENT = r"""
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"control", "scipy", "xarray", "pandas", "matplotlib"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
import tokid
model, data = tokid.example_system(steps=10), tokid.example(experiments=3, steps=10)
model.simulate(data)
tokid.interop.simulate_ltv([model.at(k) for k in range(10)], data.u)
for use in (lambda: model.to_control(1), lambda: model.to_scipy(1), model.to_xarray, data.to_xarray, data.to_dataframe,
            lambda: model.to_dataframe(data), lambda: tokid.Ensemble.from_dataframe({}),
            lambda: tokid.plot.poles(model)):
    try:
        use()
    except ImportError as error:
        print(error)
"""


def test_absent_packages_are_named_with_what_installs_them():
    result = subprocess.run([sys.executable, "-c", ABSENT], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines() == [
        "to_control needs control: pip install tokid[control]",
        "to_scipy needs scipy: pip install scipy",
        "to_xarray needs xarray: pip install tokid[xarray]",
        "to_xarray needs xarray: pip install tokid[xarray]",
        "a DataFrame needs pandas: pip install tokid[pandas]",
        "a DataFrame needs pandas: pip install tokid[pandas]",
        "a DataFrame needs pandas: pip install tokid[pandas]",
        "tokid.plot needs matplotlib: pip install tokid[plot]",
    ]


def test_nothing_optional_is_imported_with_tokid():
    code = (
        "import sys, tokid; found = {'control', 'scipy', 'xarray', 'pandas', 'matplotlib'} & set(sys.modules);"
        "assert not found, found; assert 'plot' in dir(tokid)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# ---- what is shown of them ----

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """What the examples of docstrings presume."""
    monkeypatch.chdir(tmp_path)
    data = tokid.example("oscillator", experiments=60, steps=40, measurement_noise=0.01)
    model = tokid.identify(data, states=4, lags=2, smoothing=0.0, refine=False)
    yield {"tokid": tokid, "np": np, "data": data, "model": model}
    pyplot.close("all")


@pytest.mark.parametrize("name", ["interop", "plot"])
def test_docstrings(name, shown):
    found = doctest.testmod(importlib.import_module(f"tokid.{name}"), extraglobs=shown, optionflags=FLAGS)
    assert found.failed == 0 and found.attempted > 3


def test_guide(tmp_path, monkeypatch, other_processor):
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).resolve().parents[2] / "docs" / "python-interop.md"
    found = doctest.testfile(str(page), module_relative=False, optionflags=FLAGS)
    pyplot.close("all")
    assert found.failed == 0 and found.attempted > 25
