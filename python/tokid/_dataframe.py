# SPDX-License-Identifier: BSD-3-Clause
"""Tidy tables of pandas from and to ensembles, by the rules of .csv files."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np

from . import _options, _tokid
from ._channels import channel_texts
from ._optional import need
from ._samples import describe, experiment_names, label, labels_of, one_or_more
from ._time_grid import Grid, seconds, text_of
from ._typing import Array

_RESERVED = ("experiment", "time", "k")
_NOTES = "tokid"  # key in DataFrame.attrs of values that have no column in a table


def pandas() -> Any:
    return need("pandas", "a DataFrame", "tokid[pandas]")


def is_dataframe(data: Any) -> bool:
    loaded = sys.modules.get("pandas")
    return loaded is not None and isinstance(data, loaded.DataFrame)


def notes_of(data: Any) -> dict[str, Any]:
    """The values that `to_dataframe` stored beside a table; none for other data."""
    notes = getattr(data, "attrs", {}).get(_NOTES)
    return notes if isinstance(notes, dict) else {}


def noted_names(notes: Mapping[str, Any], columns: Sequence[str], side: str) -> list[str]:
    """The noted names of the inputs or outputs, if the table still has all these columns."""
    noted = notes.get(f"{side}_names") or []
    return list(noted) if all(label in columns for label in noted) else []


# ---- columns ----


def _quoted(names: Sequence[str]) -> str:
    return "'" + "', '".join(names) + "'" if names else "nothing"


def _is_time(name: str) -> bool:
    return name.lower() == "time"


def _is_place(name: str) -> bool:
    """Whether a column contains times or step numbers."""
    return name == "k" or _is_time(name)


def with_index(table: Any, timed: bool) -> Any:
    """The table with the experiments and times of its index as columns.

    An index of unknown meaning is an error, because it must not be ignored. Without `timed`, the user gave the sample
    time, and rows may be steps.
    """
    levels = [name for name in table.index.names if name in _RESERVED or (name is not None and _is_place(str(name)))]
    if levels:
        table = table.reset_index(level=levels)
    columns = {str(label) for label in table.columns}
    if not len(table) or any(map(_is_place, columns)):
        return table
    index = table.index
    if index.nlevels == 1:
        if isinstance(index, pandas().PeriodIndex):
            index = index.to_timestamp()
        kind = getattr(index.dtype, "kind", "O")
        if kind in "Mm" or (kind == "f" and index.name is None):
            return table.set_axis(index, axis=0).rename_axis("time").reset_index()
        if kind not in "iu" and timed:
            raise ValueError(
                f"index: {'unnamed' if index.name is None else repr(index.name)}, of {index.dtype} found, one of times "
                "or step numbers with the name 'time' or 'k' needed. If the rows are steps, state dt"
            )
    if "experiment" not in columns:
        if index.nlevels > 1:
            names = ", ".join(map(repr, index.names))
            raise ValueError(f"index: levels {names} found, the names 'experiment' and 'time' or 'k' needed")
        if not index.is_unique:
            row = int(np.flatnonzero(index.duplicated())[0])
            raise ValueError(
                f"row {row}: index {index[row]} found a second time, a column 'experiment' needed. If all rows "
                "are steps of one experiment, use reset_index(drop=True)"
            )
    return table


class _Table:
    """A table whose columns, including levels of the index, are found by their names."""

    def __init__(self, table: Any, timed: bool) -> None:
        table = with_index(table, timed)
        self._table = table
        self.names = [str(label) for label in table.columns]
        self.rows = len(table)
        self.notes = notes_of(table)

    def find(self, name: str) -> Optional[int]:
        count = self.names.count(name)
        if count > 1:
            raise ValueError(f"columns: {count} columns '{name}' found, one needed")
        return self.names.index(name) if count else None

    def named(self, wanted: Sequence[str]) -> list[int]:
        columns = []
        for name in wanted:
            column = self.find(name)
            if column is None:
                raise ValueError(f"no column '{name}' found among {_quoted(self.names)}")
            columns.append(column)
        return columns

    def channels(self, name: str, wanted: Sequence[str], prefix: str, taken: Sequence[str]) -> list[int]:
        """The wanted columns; else those in the notes of the table; else those whose names have the prefix."""
        if wanted:
            return self.named(wanted)
        if noted := noted_names(self.notes, self.names, name):
            return self.named(noted)
        return self.named([n for n in self.names if n.startswith(prefix) and n not in _RESERVED and n not in taken])

    def series(self, column: int) -> Any:
        return self._table.iloc[:, column]

    def numbers(self, column: int) -> Array:
        series, name = self.series(column), self.names[column]
        dtype = series.dtype
        kind = getattr(dtype, "kind", "O")
        if isinstance(dtype, np.dtype) and kind in "fiub":
            return np.asarray(series.to_numpy(), dtype=np.float64)
        if kind in "fiub":  # integer and float types of pandas have their own marks of missing values
            return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)
        if kind in "cMm":
            raise ValueError(f"column '{name}': {dtype} found, numbers needed")
        missing = series.isna().to_numpy()
        values = np.full(self.rows, np.nan)
        for row, value in enumerate(series.to_numpy(dtype=object)):
            if not missing[row]:
                values[row] = _number(value, row, name)
        return values

    def stamped(self, column: Optional[int]) -> bool:
        """Whether a column has dates or time differences of pandas, which count nanoseconds."""
        return column is not None and getattr(self.series(column).dtype, "kind", "O") in "Mm"

    def time(self, channels: set[int]) -> Optional[int]:
        """The column "time"; it may have capital letters."""
        found = [c for c, label in enumerate(self.names) if c not in channels and _is_time(label)]
        if len(found) > 1:
            raise ValueError(f"columns: {_quoted([self.names[c] for c in found])} found, one column 'time' needed")
        return found[0] if found else None

    def remark_on_unused(self, used: set[Optional[int]]) -> list[str]:
        """The remark on columns that are not used, if there are any."""
        names = [name for column, name in enumerate(self.names) if column not in used]
        are = "column {} is" if len(names) == 1 else "columns {} are"
        text = f"{are.format(_quoted(names))} not used. Name the columns that are channels as inputs or outputs"
        return [text] if names else []

    def seconds(self, column: int) -> Array:
        """Times [s]; dates count from the first one."""
        if not self.stamped(column):
            return self.numbers(column)
        series = self.series(column)
        return seconds(series.to_numpy(dtype="datetime64[ns]" if series.dtype.kind == "M" else "timedelta64[ns]"))


def _number(value: Any, row: int, name: str) -> float:
    text = str(value).strip()
    if isinstance(value, str) and text in ("", "NA"):
        return float("nan")
    try:
        if "_" not in text:
            return float(text)
    except ValueError:
        pass
    raise ValueError(f"row {row}, column '{name}': '{value}' found, a number needed")


# ---- experiments and steps ----


def _experiments(table: _Table, column: Optional[int]) -> tuple[Any, list[Any]]:
    """The number of the experiment of each row, and the names: numbers sorted, texts in order of appearance."""
    if column is None:
        return np.zeros(table.rows, dtype=np.int64), [""]
    series = table.series(column)
    # Numbers are sorted, because rows may be in any order. Texts are not sorted: "10" would come before "9".
    codes, names = pandas().factorize(series, sort=getattr(series.dtype, "kind", "O") in "fiub")
    names = list(names)
    nothing = codes < 0
    if "" in names:
        nothing |= codes == names.index("")
    if nothing.any():
        row = int(np.flatnonzero(nothing)[0])
        raise ValueError(f"row {row}, column 'experiment': nothing found, a number or name needed")
    return codes, names


def _times(table: _Table, time: Optional[int], step: Optional[int], experiment: Any) -> Array:
    column = time if time is not None else step
    if column is None:  # the number of each row in its experiment
        order = np.argsort(experiment, kind="stable")
        grouped = experiment[order]
        begin = np.flatnonzero(np.diff(grouped, prepend=-1))
        count = np.arange(table.rows) - np.repeat(begin, np.diff(np.append(begin, table.rows)))
        times = np.empty(table.rows)
        times[order] = count
        return times
    times = table.seconds(column) if time is not None else table.numbers(column)
    wrong = ~np.isfinite(times)
    if time is None:
        wrong |= times != np.floor(times)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        needed = "whole number" if time is None else "finite time"
        raise ValueError(
            f"row {row}, column '{table.names[column]}': '{table.series(column).iloc[row]}' found, a {needed} needed"
        )
    return times


def _ranges(values: Array, experiment: Any, experiments: int) -> tuple[Array, Array]:
    """The smallest and the largest value of each experiment."""
    begin, end = np.full(experiments, np.inf), np.full(experiments, -np.inf)
    np.minimum.at(begin, experiment, values)
    np.maximum.at(end, experiment, values)
    return begin, end


def _same_origin(times: Array, experiment: Any, names: list[Any]) -> None:
    """Reject dates of experiments made one after another, because their first steps are not the same step."""
    begin, end = _ranges(times, experiment, len(names))
    first, last = int(np.argmin(begin)), int(np.argmax(begin))
    if begin[last] > end[first]:
        raise ValueError(
            f"column 'time': experiment '{names[last]}' begins {text_of(begin[last] - end[first])} s after the end of "
            f"'{names[first]}', times from a common origin needed. Subtract the first time of each experiment"
        )


# ---- tables → ensembles ----


def from_dataframe(
    data: Any,
    *,
    inputs: Union[str, Sequence[Any], None] = None,
    outputs: Union[str, Sequence[Any], None] = None,
    dt: Optional[float] = None,
    outputs_required: bool = False,
    **described: Any,
) -> _tokid.Ensemble:
    """See `Ensemble.from_dataframe`. `described` has arguments of `describe`."""
    pandas()
    if not is_dataframe(data):
        raise ValueError(f"data: {type(data).__name__} found, a DataFrame needed")
    table = _Table(data, dt is None)
    notes = table.notes
    experiment = table.find("experiment")
    of_inputs, of_outputs = one_or_more(inputs), one_or_more(outputs)
    u = table.channels("input", of_inputs, "u", of_outputs)
    y = table.channels("output", of_outputs, "y", of_inputs)
    for column in u:
        if column in y:
            raise ValueError(f"column '{table.names[column]}' is listed both as an input and as an output. List it only once")
    if not u:
        raise ValueError(f"no column whose name begins with u found among {_quoted(table.names)}; name the inputs")
    if not y and outputs_required:
        raise ValueError(f"no column whose name begins with y found among {_quoted(table.names)}; name the outputs")
    if not table.rows:
        raise ValueError("no rows found, samples needed")
    time = table.time({*u, *y})
    step = None if time is not None else table.find("k")
    if step in (*u, *y):
        step = None

    row_experiment, experiments = _experiments(table, experiment)
    times = _times(table, time, step, row_experiment)
    stated = None if dt is None else _options.real("dt", dt, 0.0)
    stamped = table.stamped(time)
    if stamped:
        _same_origin(times, row_experiment, experiments)
    grid = Grid(times, time is not None, stated, notes.get("dt"), len(experiments), 1e-9 if stamped else 0.0)
    place = row_experiment * grid.steps + grid.step
    order = np.argsort(place, kind="stable")
    again = order[1:][np.diff(place[order]) == 0]
    if again.size:
        row = int(again.min())
        name = experiments[row_experiment[row]]
        of_experiment = "" if experiment is None else f" of experiment '{name}'"
        raise ValueError(
            f"row {row}: a second row for step {grid.step[row]}{of_experiment} found, one needed"
        )

    core = _tokid.Ensemble(len(experiments), grid.steps, len(u), len(y), grid.dt)
    core.dt_stated = grid.dt_stated
    core.reader_remarks = table.remark_on_unused({*u, *y, experiment, step if time is None else time})
    if time is None and step is None and dt is None:
        rows = "no column 'time' or 'k' found, so the rows were taken as successive steps"
        core.reader_remarks = [*core.reader_remarks, rows]
    for samples, columns in ((core.u(), u), (core.y(), y)):
        for channel, column in enumerate(columns):
            samples[row_experiment, grid.step, channel] = table.numbers(column)
    given = {name: value for name, value in described.items() if value is not None}
    begin = round(grid.begin / grid.dt) if time is not None else 0
    describe(core, **{**_description(table, core, u, y, experiments if experiment is not None else None), **given})
    if "length" not in given:
        keep_lengths(core, notes.get("length"), experiments, begin)
    core.check(outputs_required)
    return core


def _description(
    table: _Table, core: _tokid.Ensemble, u: list[int], y: list[int], experiments: Optional[list[Any]]
) -> dict[str, Any]:
    """The names in a table and the values in its notes, as the arguments of `describe`."""
    found: dict[str, Any] = {
        "initial_state": table.notes.get("initial_state"),
        "experiment_names": experiments,
    }
    units: dict[str, str] = table.notes.get("units") or {}
    for side, columns in (("input", u), ("output", y)):
        names = [table.names[column] for column in columns]
        if names != channel_texts(core, f"{side}_names") or f"{side}_names" in table.notes:
            found[f"{side}_names"] = names
        if any(name in units for name in names):
            found[f"{side}_units"] = [units.get(name, "") for name in names]
    return found


def keep_lengths(core: _tokid.Ensemble, noted: Any, experiments: list[Any], begin: int) -> None:
    """Use the lengths in the notes, unless the table now has samples beyond them."""
    if not isinstance(noted, dict) or any(label(name) not in noted for name in experiments):
        return
    lengths = [min(max(int(noted[label(name)]) - begin, 0), core.steps) for name in experiments]
    u, y = core.u(), core.y()
    if all(np.isnan(u[n, t:]).all() and np.isnan(y[n, t:]).all() for n, t in enumerate(lengths)):
        core.length = lengths


# ---- ensembles → tables ----


def _distinct_names(names: list[str]) -> None:
    for i, name in enumerate(names):
        if names.count(name) > 1 or (i > 1 and name in _RESERVED):
            raise ValueError(
                f"channel name '{name}' found twice or as the name of another column; distinct names needed"
            )


def tidy(dt: Optional[float], labels: Any, columns: Sequence[tuple[Sequence[str], Array]], kept: Any = None) -> Any:
    """Return a table with a row for each experiment and step, and a column for each channel.

    Parameters
    ----------
    dt : float or None
        Sample time [s]. Without it, the steps have their numbers instead of their times.
    labels : ndarray, shape (N,)
        Names of the experiments.
    columns : sequence of (names, ndarray of shape (N, T, channels))
        Channels.
    kept : ndarray of bool, shape (N, T), optional
        Rows to keep; by default all.
    """
    experiments, steps = columns[0][1].shape[:2]
    steps_name = "k" if dt is None else "time"
    names = ["experiment", steps_name] + [name for names, _ in columns for name in names]
    _distinct_names(names)
    rows = slice(None) if kept is None else kept.reshape(-1)
    values: dict[str, Any] = {
        "experiment": np.repeat(labels, steps)[rows],
        steps_name: np.tile(np.arange(steps) * (1 if dt is None else dt), experiments)[rows],
    }
    for channels, array in columns:
        for i, name in enumerate(channels):
            values[name] = np.ascontiguousarray(array[:, :, i]).reshape(-1)[rows]
    return pandas().DataFrame(values)


def to_dataframe(core: _tokid.Ensemble) -> Any:
    pandas()
    if core.free_y is not None:
        raise ValueError("free responses don't fit into a DataFrame; .npz, .h5 or .mat needed")
    u, y = core.u(), core.y()
    # Rows without a sample are left out, but not those of the first experiment and the first step. A reader of the
    # table thus finds every experiment and every step.
    kept = np.asarray(~(np.isnan(u).all(axis=2) & np.isnan(y).all(axis=2)))
    kept[:1] = True
    kept[:, :1] = True
    stated = core.dt if core.dt_stated else None
    inputs, outputs = channel_texts(core, "input_names"), channel_texts(core, "output_names")
    table = tidy(stated, labels_of(core), [(inputs, u), (outputs, y)], kept)
    notes: dict[str, Any] = {"dt": core.dt} if core.dt_stated else {}
    if core.initial_state is not None:
        notes["initial_state"] = core.initial_state
    if core.length:
        notes["length"] = {name: int(length) for name, length in zip(experiment_names(core), core.length)}
    notes.update({which: names for which in ("input_names", "output_names") if (names := list(getattr(core, which)))})
    units = {**dict(zip(inputs, core.input_units)), **dict(zip(outputs, core.output_units))}
    if units:
        notes["units"] = units
    table.attrs[_NOTES] = notes
    return table
