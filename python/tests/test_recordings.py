# SPDX-License-Identifier: BSD-3-Clause
"""Data as they were recorded: many files, tables of pandas and datasets of xarray with an experiment each."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import tokid

pytestmark = pytest.mark.filterwarnings("ignore::tokid.TokidWarning")

T = np.arange(12) * 0.1
CHANNELS = {"inputs": ["valve [%]"], "outputs": ["T"]}


def table(start, rows=12):
    """A table with time stamps; the valve opens at a step."""
    return pd.DataFrame(
        {
            "when": pd.Timestamp("2026-11-27 13:12:05") + pd.to_timedelta(T[:rows], unit="s"),
            "valve [%]": np.where(np.arange(rows) < start, 0.0, 60.0),
            "T [degC]": 20 + np.arange(rows) - start,
        }
    )


RUNS = {"run10": table(3), "run9": table(5, 10)}


def test_files_folders_and_patterns(tmp_path):
    for name, run in RUNS.items():
        run.to_csv(tmp_path / f"{name}.csv", index=False)
    folder = tokid.read(tmp_path, **CHANNELS)
    assert isinstance(folder, tokid.Ensemble)
    assert folder.experiment_names == ["run9", "run10"] and folder.dt == 0.1
    assert folder.input_units == ["%"] and list(folder.length) == [10, 12]
    for paths in (str(tmp_path / "run*.csv"), [tmp_path / "run10.csv", tmp_path / "run9.csv"]):
        assert tokid.read(paths, **CHANNELS).fingerprint == folder.fingerprint
    with pytest.raises(tokid.IoError, match="no file matches this pattern"):
        tokid.load(tmp_path / "*.txt")
    with pytest.raises(FileNotFoundError):
        tokid.Ensemble.load([tmp_path / "run9.csv", tmp_path / "run8.csv"])


def test_a_dict_and_a_list_of_tables(tmp_path):
    data = tokid.Ensemble.from_dataframe(RUNS, **CHANNELS)
    assert data.experiment_names == ["run10", "run9"] and data.dt == 0.1
    np.testing.assert_array_equal(data.y[1, :10, 0], RUNS["run9"]["T [degC]"])
    assert np.isnan(data.y[1, 10:]).all()
    listed = tokid.Ensemble.from_dataframe(list(RUNS.values()), **CHANNELS, initial_state="zero")
    assert listed.fingerprint == data.fingerprint and listed.initial_state == "zero"
    assert list(listed.length) == [12, 10]


def test_trigger_and_resampling_of_tables():
    aligned = tokid.Ensemble.from_dataframe(RUNS, **CHANNELS, trigger="valve > 50", before=2)
    np.testing.assert_array_equal(aligned.y[:, :7, 0], [np.arange(18.0, 25.0)] * 2)
    # One long table with the experiments in a column.
    long = pd.concat([run.assign(experiment=name) for name, run in RUNS.items()])
    same = tokid.Ensemble.from_dataframe(long, **CHANNELS, trigger="valve > 50", before=2)
    np.testing.assert_array_equal(same.y, aligned.y)
    assert same.experiment_names == aligned.experiment_names
    with pytest.warns(tokid.TokidWarning, match="resampled from about 0.1 s to 0.05 s by the method linear"):
        fine = tokid.Ensemble.from_dataframe(RUNS, **CHANNELS, resample=0.05)
    assert fine.dt == 0.05
    np.testing.assert_allclose(fine.y[0, :, 0], 17 + np.arange(23) / 2, rtol=0, atol=1e-12)


def test_columns_of_experiments_and_held_channels(tmp_path):
    long = pd.concat([table(3).assign(run=name) for name in ("a", "b")], ignore_index=True)
    with pytest.raises(ValueError, match="column 'run' may name the experiments: state experiment_column='run'"):
        tokid.Ensemble.from_dataframe([long], **CHANNELS)
    data = tokid.Ensemble.from_dataframe(long, **CHANNELS, experiment_column="run")
    assert data.experiment_names == ["a", "b"]
    long.to_csv(tmp_path / "long.csv", index=False)
    assert tokid.read(tmp_path / "long.csv", **CHANNELS, experiment_column="run").fingerprint == data.fingerprint
    held = tokid.read(tmp_path / "long.csv", **CHANNELS, experiment_column="run", resample=0.05, held=["valve"])
    np.testing.assert_array_equal(held.u[0, :, 0], np.where(np.arange(23) < 6, 0.0, 60.0))
    np.testing.assert_allclose(held.y[0, :, 0], 17 + np.arange(23) / 2, rtol=0, atol=1e-12)


def test_words_and_times_in_tables():
    run = table(3).astype({"T [degC]": object})
    run.loc[4, "T [degC]"] = "I/O Timeout"
    run.loc[5, "T [degC]"] = "away"
    with pytest.raises(ValueError, match=r"table a, row 5, column 'T \[degC\]': 'away' found, a number needed"):
        tokid.Ensemble.from_dataframe({"a": run}, **CHANNELS)
    data = tokid.Ensemble.from_dataframe({"a": run}, **CHANNELS, missing=["away"])
    assert np.isnan(data.y[0, 4:6, 0]).all() and not np.isnan(data.y[0, 6:, 0]).any()
    indexed = table(3).set_index("when")
    assert tokid.Ensemble.from_dataframe([indexed, indexed], **CHANNELS).dt == 0.1
    numbered = table(3).assign(when=T).rename(columns={"when": "X"})
    assert tokid.Ensemble.from_dataframe([numbered], **CHANNELS, time="X").dt == 0.1
    elapsed = indexed.set_axis(indexed.index - indexed.index[0])
    assert tokid.Ensemble.from_dataframe([elapsed], **CHANNELS).fingerprint == \
        tokid.Ensemble.from_dataframe([table(3)], **CHANNELS).fingerprint


def test_notes_of_to_dataframe_are_kept():
    rng = np.random.default_rng(1)
    data = tokid.Ensemble(
        rng.standard_normal((3, 8, 1)),
        rng.standard_normal((3, 8, 2)),
        dt=0.5,
        length=[8, 6, 7],
        initial_state="zero",
        input_names=["valve"],
        output_names=["T", "p"],
        input_units=["%"],
        output_units=["degC", ""],
        experiment_names=["a", "b", "c"],
    )
    table = data.to_dataframe()
    facts = [
        (e.fingerprint, e.initial_state, e.input_units, e.output_units, e.input_names, list(e.length), e.dt, e.experiment_names)
        for e in (
            tokid.Ensemble.from_dataframe(table),
            tokid.Ensemble.from_dataframe(table, missing=["Fault"]),
            tokid.Ensemble.from_dataframe([table]),
        )
    ]
    assert facts[0] == facts[1] == facts[2]
    assert facts[0][1:4] == ("zero", ["%"], ["degC", ""]) and facts[0][5] == [8, 6, 7]
    # An event moves the begin of an experiment, so its state is not known, and its length is another one.
    moved = tokid.Ensemble.from_dataframe(table, trigger="valve > 0")
    assert moved.initial_state is None and moved.input_units == ["%"]
    halves = [table[table["experiment"] == "a"], table[table["experiment"] != "a"]]
    both = tokid.Ensemble.from_dataframe(dict(zip(("one", "two"), halves)))
    assert both.experiment_names == ["one", "two/b", "two/c"]
    assert both.initial_state == "zero" and list(both.length) == [8, 6, 7]
    halves[1].attrs["tokid"] = {**table.attrs["tokid"], "initial_state": "unknown"}
    with pytest.raises(ValueError, match="initial_state: 'zero' and 'unknown' found in the notes of the tables"):
        tokid.Ensemble.from_dataframe(halves)


def test_names_of_tables(recwarn):
    long = pd.concat([run.assign(experiment=name) for name, run in RUNS.items()])
    two = tokid.Ensemble.from_dataframe({"x": long, "table0": long}, **CHANNELS)
    assert two.experiment_names == ["x/run10", "x/run9", "table0/run10", "table0/run9"]
    assert tokid.Ensemble.from_dataframe({"only": table(3)}, **CHANNELS).experiment_names == ["only"]
    idle = table(3).assign(**{"valve [%]": 0.0})
    with pytest.warns(tokid.TokidWarning, match="never holds in experiment 'b', so this experiment was dropped"):
        tokid.Ensemble.from_dataframe({"a": table(3), "b": idle}, **CHANNELS, trigger="valve > 50")
    assert not any("recorded_table" in str(warning.message) for warning in recwarn)


def test_truth_values_are_numbers():
    run = table(3)
    run["valve [%]"] = run["valve [%]"] > 0
    mixed = run.astype({"valve [%]": object})
    mixed.loc[1, "valve [%]"] = None
    for part in (run, mixed):
        data = tokid.Ensemble.from_dataframe([part], **CHANNELS)
        np.testing.assert_array_equal(data.u[0, 3:, 0], np.ones(9))
        assert data.u[0, 0, 0] == 0


def test_times_of_tables_that_jitter():
    late = pd.DataFrame({"time": T + 0.001 * (np.arange(12) % 3), "u": T, "y": T})
    with pytest.raises(ValueError, match="move the times to even steps of 0.1 s"):
        tokid.Ensemble.from_dataframe([late])
    data = tokid.Ensemble.from_dataframe([late], dt=0.1)
    assert data.dt == 0.1 and data.steps == 12


def test_datasets():
    raw = xr.Dataset({"valve": ("time", np.arange(12.0)), "T": ("time", 20 + T)}, {"time": T})
    data = tokid.Ensemble.from_xarray({"a": raw, "b": raw.isel(time=slice(8))}, inputs=["valve"], outputs=["T"])
    assert data.experiment_names == ["a", "b"] and list(data.length) == [12, 8] and data.dt == 0.1
    np.testing.assert_array_equal(data.y[0, :, 0], 20 + T)
    runs = xr.concat([raw, raw + 1], dim=pd.Index(["a", "b"], name="experiment"))
    both = tokid.Ensemble.from_xarray(runs, inputs=["valve"], outputs=["T"], trigger="valve >= 2")
    np.testing.assert_array_equal(both.u[:, :10, 0], [np.arange(2.0, 12.0)] * 2)


def test_one_text_is_a_list_of_one(tmp_path):
    words = pd.DataFrame({"time": T, "valve": T, "T": [*map(str, T[:11]), "Schlecht"]})
    words.to_csv(tmp_path / "run.csv", index=False)
    listed = {"inputs": ["valve"], "outputs": ["T"], "missing": ["Schlecht"]}
    single = {name: words for name, (words,) in listed.items()}
    with pytest.raises(tokid.IoError, match="missing='Schlecht'"):
        tokid.read(tmp_path / "run.csv", inputs="valve", outputs="T")
    for read in (lambda **o: tokid.read(tmp_path / "run.csv", **o), lambda **o: tokid.Ensemble.from_dataframe(words, **o)):
        data = read(**single)
        assert data.missing == 1 and data.fingerprint == read(**listed).fingerprint
        assert (data.input_names, data.output_names) == (["valve"], ["T"])
    plain = tokid.Ensemble.from_dataframe(pd.DataFrame({"u1": T, "u2": T}), inputs="u1", outputs="u2")
    assert (plain.input_names, plain.output_names) == (["u1"], ["u2"])
    assert tokid.Ensemble(np.ones((2, 3, 1)), input_names="force").input_names == ["force"]


@pytest.mark.parametrize(
    "options, text",
    [
        ({"dates": "iso"}, "dates: 'iso' found, one of 'day-first', 'month-first' needed"),
        ({"resample_method": "cubic"}, "resample_method: 'cubic' found, one of 'linear', 'previous', 'mean' needed"),
        ({"trigger": "valve"}, "trigger: 'valve' found, a column, one of > >= < <= == != and a number needed"),
        ({"before": 2}, "before: no trigger found"),
        ({"resample": -1.0}, "resample: "),
        ({"longest_gap": 0}, "longest_gap: "),
        ({"held": ["valve"]}, "held: no resample found"),
        ({"dt": 0.1, "resample": 0.1}, "dt: a sample time found"),
    ],
)
def test_wrong_options(options, text):
    with pytest.raises(ValueError, match=text):
        tokid.Ensemble.from_dataframe(RUNS, **CHANNELS, **options)
