# SPDX-License-Identifier: BSD-3-Clause
"""What is taken for granted of data is a warning, and comes once: no sample time, columns that are not used, axes in
another order."""

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
import tokid


@pytest.fixture(scope="module")
def data():
    return tokid.example("oscillator", experiments=40, steps=30, seed=3)


def told(call):
    """What a call gives, and the warnings that it issues."""
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        result = call()
    assert all(issubclass(entry.category, tokid.TokidWarning) for entry in record)
    return result, [str(entry.message) for entry in record]


NO_DT = "the data contain no sample time, so tokid assumes dt = 1 s. If the sample time is different, add dt to the data"


def test_arrays_without_a_sample_time(data):
    model, found = told(lambda: tokid.identify(data.u, data.y))
    assert found.count(NO_DT) == 1 and model.dt == 1.0 and model.warnings.count(NO_DT) == 1
    model, found = told(lambda: tokid.identify(data.u, data.y, dt=1.0))
    assert NO_DT not in found and NO_DT not in model.warnings
    _, found = told(lambda: tokid.cross_validate(data.u, data.y, folds=2, lags=2, states=4))
    assert not any(NO_DT in text for text in found)


def test_an_ensemble_without_a_sample_time_is_told_of_once(data):
    ensemble, found = told(lambda: tokid.Ensemble(data.u, data.y))
    assert found == [NO_DT] and not ensemble.dt_stated and ensemble.dt == 1.0
    model, found = told(lambda: tokid.identify(ensemble))
    assert NO_DT not in found and NO_DT in model.warnings  # the model knows
    for call in (lambda: model.validate(ensemble), lambda: model.predict(ensemble), lambda: ensemble.split(0.2)[0],
                 lambda: ensemble[3], lambda: pickle.loads(pickle.dumps(ensemble))):
        assert not any("sample time" in text for text in told(call)[1])
    assert not pickle.loads(pickle.dumps(ensemble)).dt_stated
    assert told(lambda: tokid.Ensemble(data.u, data.y, dt=1))[1] == []
    assert told(lambda: tokid.Ensemble.empty(3, 4, 1, 1))[1] == [NO_DT]
    assert told(lambda: tokid.Ensemble.empty(3, 4, 1, 1, dt=0.1))[1] == []


def test_files_are_told_of_when_they_are_loaded(data, tmp_path):
    np.savez(tmp_path / "data.npz", u=data.u, y=data.y)
    loaded, found = told(lambda: tokid.Ensemble.load(tmp_path / "data.npz"))
    assert found == [NO_DT]
    assert NO_DT not in told(lambda: tokid.identify(loaded))[1]
    rows = "".join(f"{n},{k},{n},{np.sin(k * n)},{np.cos(k * n)}\n" for n in range(6) for k in range(30))
    (tmp_path / "data.csv").write_text("# dt = 0.001\nexperiment,k,batch,u1,y1\n" + rows[:-1])
    loaded, found = told(lambda: tokid.Ensemble.load(tmp_path / "data.csv"))
    assert loaded.dt == 0.001 and len(found) == 2
    assert "'batch' is not used" in found[0] and "without a line break" in found[1]
    model, again = told(lambda: tokid.identify(loaded, lags=1, states=1, period=1))
    assert not set(found) & set(again) and set(found) <= set(model.warnings)


def test_a_table_that_was_changed(data, tmp_path):
    path = tmp_path / "data.csv"
    tokid.Ensemble(data.u, data.y, dt=0.1).save(path)
    assert told(lambda: tokid.Ensemble.load(path))[1] == []
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert told(lambda: tokid.Ensemble.load(path))[1] == []
    path.write_bytes(path.read_bytes()[:-3] + b"7\r\n")
    text, = told(lambda: tokid.Ensemble.load(path))[1]
    assert f"'{path}' does not match its line" in text and "Remove this line" in text


ROWS = "no column 'time' or 'k' found, so the rows were taken as successive steps"


def test_rows_and_step_numbers(tmp_path):
    """Of tables as of files."""

    def of(columns, **options):
        table = pd.DataFrame(columns)
        loaded, found = told(lambda: tokid.Ensemble.from_dataframe(table, **options))
        if not options and "index" not in columns:  # a .csv with such a column and without times is refused
            table.to_csv(tmp_path / "data.csv", index=False)
            same, told_of = told(lambda: tokid.Ensemble.load(tmp_path / "data.csv"))
            assert found == told_of and loaded.steps == same.steps
        return loaded.steps, found

    u = {"u1": [1.0, 2.0, 3.0]}
    assert of({"k": [3, 5, 4], **u}) == (3, [NO_DT])
    assert of({"Time": [0, 1, 5], **u}) == (6, [])
    steps, found = of({"index": [0, 1, 5], **u})
    assert steps == 3 and "'index' is not used" in found[0] and ROWS in found[1] and found[2] == NO_DT
    assert of(u, dt=0.1) == (3, [])  # whoever says this knows


def test_what_comes_back_of_no_sample_time(data, tmp_path):
    ensemble, _ = told(lambda: tokid.Ensemble(data.u, data.y))
    for extension in ("npz", "h5", "mat", "csv"):
        ensemble.save(tmp_path / f"copy.{extension}")
        assert not told(lambda: tokid.Ensemble.load(tmp_path / f"copy.{extension}"))[0].dt_stated


def test_axes_in_another_order(data):
    u, y = data.u.swapaxes(0, 1), data.y.swapaxes(0, 1)
    found = told(lambda: tokid.Ensemble(u, y, dt=0.1))[1]
    assert len(found) == 1 and "(experiments, steps, channels), not (steps, experiments, channels)" in found[0]
    with pytest.raises(ValueError, match=r"both look like \(N, channels, T\) in place of \(N, T, channels\)"):
        tokid.identify(data.u.swapaxes(1, 2), data.y[..., :1].swapaxes(1, 2))
    with pytest.raises(ValueError, match=r"not \(experiments, channels, steps\)"):
        tokid.identify(data.u.swapaxes(1, 2), data.y.swapaxes(1, 2), dt=0.1)
    found = told(lambda: tokid.Ensemble(data.u[..., 0].T[:12], data.y[..., 0].T[:12], dt=0.1))[1]
    assert len(found) == 1 and "u of shape (12, 40) was read as one experiment of 12 steps with 40 inputs" in found[0]


def test_axes_in_another_order_beside_a_model(data):
    model, _ = told(lambda: tokid.identify(data.u, data.y, dt=0.1))
    u, y = data.u.swapaxes(0, 1), data.y.swapaxes(0, 1)
    for use in (lambda: model.predict(u, y), lambda: model.validate(u, y)):
        found = told(use)[1]
        assert len([text for text in found if "(experiments, steps, channels), not (steps, experiments, channels)" in text]) == 1
    assert not [text for text in told(lambda: model.validate(data.u, data.y))[1] if "axes" in text]


def table(time, values, **more):
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(1)
    columns = {"experiment": np.repeat([0, 1], 9), time: np.tile(values, 2)}
    return pandas.DataFrame({**columns, **more, "u1": rng.standard_normal(18), "y1": rng.standard_normal(18)})


@pytest.mark.parametrize("name,unit", [("t", 1), ("t [ms]", 1e-3), ("time_us", 1e-6), ("Time (min)", 60), ("TIME", 1)])
def test_names_of_times_in_tables(name, unit):
    steps = np.r_[0:5, 6:10]
    found, texts = told(lambda: tokid.read(table(name, steps * 0.05 / unit)))
    assert found.dt == pytest.approx(0.05, rel=1e-12) and found.steps == 10 and texts == []
    assert np.isnan(found.u[:, 5]).all()


def test_other_columns_of_tables():
    _, texts = told(lambda: tokid.Ensemble.from_dataframe(table("time", np.arange(9.0), batch=3, note="x")))
    assert len(texts) == 1 and "columns 'batch', 'note' are not used" in texts[0]
    with pytest.raises(ValueError, match="'time', 'TIME' found, one column 'time' needed"):
        tokid.Ensemble.from_dataframe(table("time", np.arange(9.0), TIME=3.0))
    chosen = tokid.Ensemble.from_dataframe(table("time", np.arange(9.0), t=1.0), inputs=["t"], outputs=["y1"])
    assert chosen.input_names == ["t"]


def test_tables_and_datasets_without_a_sample_time(data):
    pytest.importorskip("pandas")
    ensemble, _ = told(lambda: tokid.Ensemble(data.u, data.y))
    frame = ensemble.to_dataframe()
    assert "k" in frame.columns and "time" not in frame.columns
    assert told(lambda: tokid.Ensemble.from_dataframe(frame))[1] == [NO_DT]
    pytest.importorskip("xarray")
    dataset = ensemble.to_xarray()
    assert "dt" not in dataset.attrs and "time" not in dataset.coords
    assert told(lambda: tokid.Ensemble.from_xarray(dataset))[1] == [NO_DT]
