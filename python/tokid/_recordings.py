# SPDX-License-Identifier: BSD-3-Clause
"""Tables of pandas and datasets of xarray as they were recorded, read by the reader of .csv files.

The tables are written as .csv into a temporary folder, so that times, words for missing samples, triggers and resampling
have one implementation, that of the library.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any, Optional

from . import _dataframe, _options, _tokid
from ._samples import describe

METHODS = ("linear", "previous", "mean")


def read_options(
    *,
    inputs: Optional[Sequence[Any]] = None,
    outputs: Optional[Sequence[Any]] = None,
    outputs_required: bool = False,
    missing: Sequence[Any] = (),
    dates: Optional[str] = None,
    dt: Optional[float] = None,
    trigger: Optional[str] = None,
    before: int = 0,
    resample: Optional[float] = None,
    resample_method: str = "linear",
    longest_gap: Optional[int] = None,
) -> _tokid.ReadOptions:
    """The options of the reader of files. See `Ensemble.load`."""
    for name, words in (("inputs", inputs), ("outputs", outputs), ("missing", missing)):
        if isinstance(words, str):
            raise ValueError(f"{name}: {words!r} found, a list of texts needed")
    if dates not in (None, "day-first", "month-first"):
        raise ValueError(f"dates: {dates!r} found, 'day-first' or 'month-first' needed")
    if resample_method not in METHODS:
        raise ValueError(f"resample_method: {resample_method!r} found, one of {', '.join(METHODS)} needed")
    options = _tokid.ReadOptions()
    options.inputs = [str(name) for name in inputs or ()]
    options.outputs = [str(name) for name in outputs or ()]
    options.outputs_required = bool(outputs_required)
    options.missing = [str(word) for word in missing]
    options.dates = dates or ""
    options.dt = None if dt is None else _options.real("dt", dt, 0.0)
    options.trigger = trigger or ""
    options.before = _options.integer("before", before, 0)
    options.resample = None if resample is None else _options.real("resample", resample, 0.0)
    options.resample_method = resample_method
    options.longest_gap = None if longest_gap is None else _options.integer("longest_gap", longest_gap, 1)
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
        if getattr(series.dtype, "kind", "O") == "m":
            series = series.dt.total_seconds()
        columns[column] = series
    text = _dataframe.pandas().DataFrame(columns)
    text.columns = [str(name) for name in table.columns]
    text.to_csv(path, index=False)


def load(data: Any, options: _tokid.ReadOptions, **described: Any) -> _tokid.Ensemble:
    """The ensemble of one table, or of a dict or list of them, by the rules of .csv files.

    The keys of a dict name the experiments. `described` has arguments of `describe`.
    """
    several = is_several(data)
    parts = data if isinstance(data, Mapping) and several else dict(enumerate(data if several else [data]))
    with tempfile.TemporaryDirectory(prefix="tokid-") as folder:
        paths, labels = [], {}
        for number, (label, part) in enumerate(parts.items()):
            name = f"table{number}"
            labels[name] = str(label)
            paths.append(os.path.join(folder, f"{name}.csv"))
            _written(_table(part), paths[-1])
        try:
            core = _tokid.load_ensemble(paths, options)
        except _tokid.IoError as error:
            raise ValueError(_in_memory(str(error), folder, labels)) from None
    if several and core.experiment_names:
        core.experiment_names = [labels.get(name, name) for name in core.experiment_names]
    core.reader_remarks = [_in_memory(text, folder, labels) for text in core.reader_remarks]
    given = {name: value for name, value in described.items() if value is not None}
    if given:
        describe(core, **given)
    return core


def _in_memory(text: str, folder: str, labels: Mapping[str, str]) -> str:
    """A message about the files, as one about the tables."""
    text = text.replace(folder + os.sep, "")
    for name in sorted(labels, key=len, reverse=True):
        text = text.replace(f"{name}.csv", f"table {labels[name]}")
    return text
