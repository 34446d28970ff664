# SPDX-License-Identifier: BSD-3-Clause
"""Experiments keep the names that their data give them."""

import copy
import pickle
import warnings

import numpy as np
import pytest

import tokid

pd = pytest.importorskip("pandas")
xr = pytest.importorskip("xarray")

NAMES = [str(n) for n in range(1, 41)]


@pytest.fixture(scope="module")
def named(noisy):
    return tokid.Ensemble(noisy.u, noisy.y, dt=noisy.dt, experiment_names=NAMES)


@pytest.fixture(scope="module")
def bad(noisy):
    y = np.array(noisy.y)
    y[16] = y[16, :, ::-1]
    return tokid.Ensemble(noisy.u, y, dt=noisy.dt, experiment_names=range(1, 41))


def ones(names=None):
    return tokid.Ensemble(np.arange(12.0).reshape(3, 4, 1), np.ones((3, 4, 1)), experiment_names=names)


def test_attribute_and_repr(noisy, named):
    assert noisy.experiment_names == [str(n) for n in range(40)]
    assert named.experiment_names == NAMES
    assert repr(named).endswith("dt = 0.05 s; experiments '1', '2', '3', … '40'>")
    assert repr(ones(["a", "b", 100 * "x"])).endswith(f"; experiments 'a', 'b', '{20 * 'x'}…'>")
    assert "; experiments" not in repr(noisy)
    assert ones([17, 4.0, np.int64(3)]).experiment_names == ["17", "4", "3"]
    assert ones(np.array([2.5, 1.0, 0.0])).experiment_names == ["2.5", "1", "0"]
    empty = tokid.Ensemble.empty(2, 3, 1, 1, experiment_names=["a", "b"])
    assert empty.experiment_names == ["a", "b"]


def test_wrong_names():
    with pytest.raises(ValueError, match='experiment_names: "a" found at rows 0 and 2, different names needed'):
        ones(["a", "b", "a"])
    with pytest.raises(ValueError, match="experiment_names: 2 names found for 3 experiments"):
        ones(["a", "b"])
    with pytest.raises(ValueError, match="experiment_names: 'abc' found, a list of 3 names needed"):
        ones("abc")
    with pytest.raises(ValueError, match="an empty text found at row 1"):
        ones(["a", "", "b"])


def test_parts_and_copies(named, noisy):
    assert named[16].experiment_names == ["17"]
    assert named[[3, -1]].experiment_names == ["4", "40"]
    assert noisy[[3, -1]].experiment_names == ["3", "39"]
    assert noisy[[3, 3]].experiment_names == ["0", "1"]  # none of their own
    training, held_out = named.split(0.25)
    assert set(training.experiment_names) | set(held_out.experiment_names) == set(NAMES)
    for name in held_out.experiment_names:
        one = held_out[held_out.experiment_names.index(name)]
        assert np.array_equal(one.u[0], named.u[int(name) - 1])
    assert named.stretch(2, 8).experiment_names == named.departures().experiment_names == NAMES
    for other in (copy.copy(named), pickle.loads(pickle.dumps(named[5:9])), pickle.loads(pickle.dumps(named[[2, 2]]))):
        assert other.experiment_names in (NAMES, ["6", "7", "8", "9"], ["0", "1"])


@pytest.mark.parametrize("extension", ["npz", "h5", "mat", "csv"])
def test_files(named, noisy, tmp_path, extension):
    file = tmp_path / f"data.{extension}"
    named[10:14].save(file)
    assert tokid.Ensemble.load(file).experiment_names == ["11", "12", "13", "14"]
    noisy[:4].save(file)
    assert tokid.Ensemble.load(file).experiment_names == ["0", "1", "2", "3"]


def test_the_bad_batch(bad):
    with pytest.warns(tokid.TokidWarning, match=r'experiment "17" \(row 16\) does not fit the other experiments'):
        model = tokid.identify(bad, refine=False)
    (outlier,) = model.identification.outliers
    assert (outlier.experiment, outlier.name) == (16, "17")
    with pytest.warns(tokid.TokidWarning, match=r'experiment "17" \(row 16\) does not fit the other experiments'):
        tokid.identify(bad.u, bad.y, experiment_names=bad.experiment_names, refine=False)
    with pytest.warns(tokid.TokidWarning, match="experiment 16 does not fit the other experiments"):
        model = tokid.identify(bad.u, bad.y, refine=False)
    assert model.identification.outliers[0].name is None
    # In a part of the data, it has another row and the same name.
    with pytest.warns(tokid.TokidWarning, match=r'experiment "17" \(row 11\) does not fit the other experiments'):
        tokid.identify(bad[5:], refine=False)


def test_infinite_samples(bad):
    wrong = copy.copy(bad)
    wrong.u[7, 3, 1] = np.inf
    with pytest.raises(ValueError, match=r'input u2: infinite value in experiment "8" \(row 7\) at step 3'):
        tokid.identify(wrong)
    with pytest.raises(ValueError, match=r'input u2: infinite value in experiment "8" \(row 7\) at step 3'):
        tokid.cross_validate(wrong, states=4, lags=2, method="tvera")


def test_folds(named, noisy):
    for data, names in ((named, NAMES[1::3]), (noisy, None)):
        found = tokid.cross_validate(data, folds=3, states=4, lags=2, method="tvera")
        assert found.folds[1].experiments == list(range(1, 40, 3))
        assert found.folds[1].experiment_names == names


def test_plots_and_pages(bad, tmp_path):
    plot = pytest.importorskip("tokid.plot")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = tokid.identify(bad, refine=False)
    assert plot.outputs(model, bad, experiment=16).get_title(loc="left") == 'Experiment "17" (row 16) (largest error)'
    assert plot.inputs(model, bad, experiment=3).get_title(loc="left") == 'Experiment "4" (row 3)'
    model.report(bad, tmp_path / "page.html")
    assert "Experiment &quot;17&quot; (row 16)" in (tmp_path / "page.html").read_text()


def test_tables(named, noisy):
    table = named.to_dataframe()
    assert table["experiment"].dtype.kind == "i" and table["experiment"].unique().tolist() == list(range(1, 41))
    assert tokid.Ensemble.from_dataframe(table).experiment_names == NAMES
    assert tokid.Ensemble.from_dataframe(noisy.to_dataframe())._core.experiment_names == []
    mixed = ones(["7", "007", "after lunch"])
    table = mixed.to_dataframe()
    assert table["experiment"].unique().tolist() == ["7", "007", "after lunch"]
    back = tokid.Ensemble.from_dataframe(table)
    assert back.experiment_names == ["7", "007", "after lunch"] and np.array_equal(back.u, mixed.u)
    # Numbers come in their order, lengths with them.
    short = tokid.Ensemble(np.ones((3, 4, 1)), np.ones((3, 4, 1)), length=[4, 3, 2], experiment_names=[5, 3, 9])
    back = tokid.Ensemble.from_dataframe(short.to_dataframe())
    assert back.experiment_names == ["3", "5", "9"] and back.length.tolist() == [3, 4, 2]
    floats = pd.DataFrame({"experiment": [17.0, 17.0, 3.5, 3.5], "u1": 1.0, "y1": 2.0})
    assert tokid.Ensemble.from_dataframe(floats).experiment_names == ["3.5", "17"]


def test_datasets(named, noisy):
    dataset = named.to_xarray()
    assert dataset["experiment"].values.tolist() == list(range(1, 41))
    assert np.array_equal(dataset["u"].sel(experiment=17), named.u[16])
    assert tokid.Ensemble.from_xarray(dataset).experiment_names == NAMES
    assert tokid.Ensemble.from_xarray(dataset.sel(experiment=[17, 4])).experiment_names == ["17", "4"]
    other = tokid.Ensemble.from_xarray(dataset, experiment_names=[f"e{n}" for n in range(40)])
    assert other.experiment_names[3] == "e3"
    assert tokid.Ensemble.from_xarray(noisy.to_xarray())._core.experiment_names == []
    assert ones(["7", "007", "x"]).to_xarray()["experiment"].values.tolist() == ["7", "007", "x"]
    with pytest.warns(tokid.TokidWarning, match="experiment: empty or repeated labels found"):
        both = tokid.Ensemble.from_xarray(xr.concat([dataset, dataset], "experiment"))
    assert both.experiments == 80 and both._core.experiment_names == []


def test_outputs_as_a_table(named):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = tokid.identify(named, states=4, lags=2, method="tvera")
    assert model.to_dataframe(named)["experiment"].unique().tolist() == list(range(1, 41))
