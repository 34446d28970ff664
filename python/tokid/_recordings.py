# SPDX-License-Identifier: BSD-3-Clause
"""Tables of pandas and datasets of xarray as they were recorded, read by the reader of .csv files.

The tables are written as .csv into a temporary folder, so that times, words for missing samples, triggers and resampling
have one implementation, that of the library.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Optional

import numpy as np

from . import _dataframe, _options, _tokid
from ._channels import channel_texts
from ._samples import describe, experiment_names, one_or_more

DATES = {"day-first": _tokid.DateOrder.day_first, "month-first": _tokid.DateOrder.month_first}


def _or_none(check: Callable[..., Any], *limits: Any) -> Callable[[str, Any], Any]:
    return lambda name, value: None if value is None else check(name, value, *limits)


# The options of the reader of files, as in `Ensemble.load`, and their checks.
_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "inputs": lambda _, value: one_or_more(value),
    "outputs": lambda _, value: one_or_more(value),
    "outputs_required": _options.switch,
    "time": _options.text,
    "experiment_column": _options.text,
    "missing": lambda _, value: one_or_more(value),
    "dates": lambda name, value: _tokid.DateOrder.automatic if value is None else _options.choice(name, value, DATES),
    "dt": _or_none(_options.real, 0.0),
    "trigger": _options.text,
    "before": lambda name, value: _options.integer(name, value, 0),
    "resample": _or_none(_options.real, 0.0),
    "resample_method": lambda name, value: _options.choice(name, value, _tokid.ResampleMethod.__members__),
    "held": lambda _, value: one_or_more(value),
    "longest_gap": _or_none(_options.integer, 1),
}


def among(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Select the options of the reader among the arguments of a call."""
    return {name: arguments[name] for name in _CHECKS}


def read_options(given: Mapping[str, Any]) -> _tokid.ReadOptions:
    """Check options of the reader of files."""
    options = _tokid.ReadOptions()
    for name, value in given.items():
        if name not in _CHECKS:
            raise TypeError(f"{name!r} is no option of a reader of files")
        setattr(options, name, _CHECKS[name](name, value))
    return options


def _is_dataset(data: Any) -> bool:
    loaded = sys.modules.get("xarray")
    return loaded is not None and isinstance(data, (loaded.Dataset, loaded.DataArray))


def is_several(data: Any) -> bool:
    """Whether data are a dict or a list of tables or datasets, with an experiment each."""
    if _dataframe.is_dataframe(data) or _is_dataset(data):
        return False
    parts = list(data.values()) if isinstance(data, Mapping) else data
    return (
        isinstance(parts, (list, tuple))
        and len(parts) > 0
        and all(_dataframe.is_dataframe(part) or _is_dataset(part) for part in parts)
    )


def _table(data: Any) -> Any:
    """The table of a part: times and experiments are columns."""
    if _is_dataset(data):
        if hasattr(data, "to_dataset"):
            data = data.to_dataset(dim=data.dims[-1]) if data.name is None else data.to_dataset()
        return data.to_dataframe().reset_index()
    if not _dataframe.is_dataframe(data):
        raise ValueError(f"data: {type(data).__name__} found, a DataFrame needed")
    return _dataframe.with_index(data, True)


def _written(table: Any, path: str) -> None:
    columns = {}
    for column in range(table.shape[1]):
        series = table.iloc[:, column]
        kind = getattr(series.dtype, "kind", "O")
        if kind == "m":
            series = series.dt.total_seconds()
        elif kind in "bO":
            series = series.map(lambda value: int(value) if isinstance(value, (bool, np.bool_)) else value)
        columns[column] = series
    text = _dataframe.pandas().DataFrame(columns)
    text.columns = [str(name) for name in table.columns]
    text.to_csv(path, index=False)


# The name of a file of a table, without its extension. No column or text of a table has it.
_FILE = re.compile(r"tokid_recorded_table_(\d+)(\.csv)?")


def load(data: Any, options: _tokid.ReadOptions, **described: Any) -> _tokid.Ensemble:
    """The ensemble of one table, or of a dict or list of them, by the rules of .csv files.

    The keys of a dict name the experiments. The notes of `to_dataframe` are used as far as they agree with the tables.
    `described` has arguments of `describe`.
    """
    several = is_several(data)
    parts = data if isinstance(data, Mapping) and several else dict(enumerate(data if several else [data]))
    labels = [str(label) for label in parts]
    tables = [_table(part) for part in parts.values()]
    notes = [_dataframe.notes_of(part) for part in parts.values()]
    options.inputs = options.inputs or _noted_names(tables, notes, "input")
    options.outputs = options.outputs or _noted_names(tables, notes, "output")
    with tempfile.TemporaryDirectory(prefix="tokid-") as folder:
        paths = [os.path.join(folder, f"tokid_recorded_table_{number}.csv") for number in range(len(tables))]
        for table, path in zip(tables, paths):
            _written(table, path)
        try:
            core = _tokid.load_ensemble(paths, options)
        except _tokid.IoError as error:
            raise ValueError(_in_memory(str(error), folder, labels)) from None
    if isinstance(data, Mapping) and several and len(parts) == 1:  # the reader names the experiments of several files
        names = core.experiment_names
        core.experiment_names = [f"{labels[0]}/{name}" for name in names] if core.experiments > 1 else labels
    else:
        core.experiment_names = [_in_memory(name, folder, labels) for name in core.experiment_names]
    core.reader_remarks = [_in_memory(text, folder, labels) for text in core.reader_remarks]
    _keep_notes(core, tables, notes, labels if len(parts) > 1 or isinstance(data, Mapping) and several else None, options)
    given = {name: value for name, value in described.items() if value is not None}
    if given:
        describe(core, **given)
    return core


def _in_memory(text: str, folder: str, labels: Sequence[str]) -> str:
    """A text about the files, as one about the tables."""

    def name(found: re.Match[str]) -> str:
        label = labels[int(found[1])]
        return f"table {label}" if found[2] else label

    return _FILE.sub(name, text.replace(folder + os.sep, ""))


# ---- notes beside tables ----


def _noted_names(tables: Sequence[Any], notes: Sequence[Mapping[str, Any]], side: str) -> list[str]:
    """The noted names of the inputs or outputs of the first table, if all tables have these columns."""
    columns = [[str(name) for name in table.columns] for table in tables]
    found = [_dataframe.noted_names(notes[0], own, side) for own in columns]
    return found[0] if all(found) else []


def _keep_notes(
    core: _tokid.Ensemble,
    tables: Sequence[Any],
    notes: Sequence[Mapping[str, Any]],
    labels: Optional[Sequence[str]],
    options: _tokid.ReadOptions,
) -> None:
    """Use the notes beside the tables, where they still hold. `labels`: of several tables."""
    state = _common("initial_state", notes)
    if state is not None and not options.trigger:
        describe(core, initial_state=state)
    dt = _common("dt", notes)
    if dt is not None and not core.dt_stated:
        core.dt, core.dt_stated = float(dt), True
    units = {name: unit for own in notes for name, unit in (own.get("units") or {}).items()}
    for side in ("input", "output"):
        names = channel_texts(core, f"{side}_names")
        if not getattr(core, f"{side}_units") and any(name in units for name in names):
            setattr(core, f"{side}_units", [units.get(name, "") for name in names])
    if not options.trigger and options.resample is None:
        _keep_noted_lengths(core, tables, notes, labels)


def _common(key: str, notes: Sequence[Mapping[str, Any]]) -> Any:
    """The value that the notes agree on; None without any."""
    values = list(dict.fromkeys(own[key] for own in notes if own.get(key) is not None))
    if len(values) > 1:
        raise ValueError(f"{key}: {values[0]!r} and {values[1]!r} found in the notes of the tables, one value needed")
    return values[0] if values else None


def _keep_noted_lengths(
    core: _tokid.Ensemble,
    tables: Sequence[Any],
    notes: Sequence[Mapping[str, Any]],
    labels: Optional[Sequence[str]],
) -> None:
    names = experiment_names(core)
    begins = [_first_step(table, core.dt) for table in tables]
    if not any(own.get("length") for own in notes) or (labels is not None and any(begins)):
        return
    found = dict(zip(names, list(core.length) or [core.steps] * core.experiments))
    lengths = dict(found)
    for number, own in enumerate(notes):
        for name, length in (own.get("length") or {}).items():
            alone = labels is not None and labels[number] in lengths
            lengths[name if labels is None else labels[number] if alone else f"{labels[number]}/{name}"] = length
    if lengths != found:
        _dataframe.keep_lengths(core, lengths, names, begins[0] if labels is None else 0)


def _first_step(table: Any, dt: float) -> int:
    """The number of the first step in a table of `to_dataframe`."""
    for name, unit in (("time", dt), ("k", 1.0)):
        if name in table.columns and getattr(table[name].dtype, "kind", "O") in "fiu":
            return round(float(table[name].min()) / unit)
    return 0
