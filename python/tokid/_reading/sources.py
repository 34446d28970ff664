# SPDX-License-Identifier: BSD-3-Clause
"""Files, folders, patterns and objects in memory → recordings with raw columns."""

from __future__ import annotations

import glob
import importlib
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .. import _dataframe
from .._errors import IoError, reading
from .recording import Recording, quoted
from .text_table import read_text, table_of
from .words import split_unit

TEXTS = (".csv", ".txt", ".tsv", ".dat")
_Series = tuple[str, Any]  # the topic of a series, and a table of its fields with the column "time"


def recordings(source: Any, wanted: Sequence[str]) -> list[Recording]:
    """Read all tables of a source. Series without a `wanted` column are left out of logs of many series."""
    if _is_table(source):
        return [_in_memory(source, "", "")]
    if isinstance(source, Mapping):
        return [_in_memory(table, f"table {key}", str(key)) for key, table in source.items()]
    if isinstance(source, (str, bytes, os.PathLike)):
        source = [source]
    parts = list(source) if isinstance(source, Iterable) else []
    if not parts:
        raise ValueError(f"source: {type(source).__name__} without any recording found, files or tables needed")
    if all(map(_is_table, parts)):
        return [
            _in_memory(table, f"table {n}" if len(parts) > 1 else "", str(n) if len(parts) > 1 else "")
            for n, table in enumerate(parts)
        ]
    return list(_of_files(parts, wanted))


# ---- tables in memory ----


def _is_dataset(data: Any) -> bool:
    loaded = sys.modules.get("xarray")
    return loaded is not None and isinstance(data, (loaded.Dataset, loaded.DataArray))


def _is_table(data: Any) -> bool:
    return _dataframe.is_dataframe(data) or _is_dataset(data)


def is_several(data: Any) -> bool:
    """Whether data are a dict or a list of tables or datasets, with an experiment each."""
    parts = list(data.values()) if isinstance(data, Mapping) and not _is_table(data) else data
    return isinstance(parts, (list, tuple)) and len(parts) > 0 and all(map(_is_table, parts))


def _in_memory(data: Any, place: str, name: str) -> Recording:
    """The recording of a table or dataset. Its experiments and times are columns."""
    if _is_dataset(data):
        if hasattr(data, "to_dataset"):
            data = data.to_dataset(dim=data.dims[-1]) if data.name is None else data.to_dataset()
        table = data.to_dataframe().reset_index()
    elif _dataframe.is_dataframe(data):
        table = _dataframe.with_index(data, True)
    else:
        raise ValueError(f"data: {type(data).__name__} found, a DataFrame needed")
    notes = _dataframe.notes_of(data)
    noted = [label for side in ("input", "output") for label in notes.get(f"{side}_names") or ()]
    pairs = [(str(label), "") if str(label) in noted else split_unit(str(label)) for label in table.columns]
    plain = table.set_axis(list(range(table.shape[1])), axis=1).reset_index(drop=True)
    return Recording(name, place, plain, [own for own, _ in pairs], [unit for _, unit in pairs], "row", notes)


# ---- files ----


def _natural(path: str) -> list[Any]:
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in re.split(r"(\d+)", path)]


def _of_files(sources: Sequence[Any], wanted: Sequence[str]) -> Iterator[Recording]:
    paths: dict[str, tuple[str, str]] = {}
    remarks: list[str] = []
    for source in sources:
        for path, name in _expanded(os.fsdecode(source), remarks):
            first, _ = paths.setdefault(os.path.realpath(path), (path, name))
            if first != path and os.path.abspath(first) != os.path.abspath(path):
                remarks.append(f"'{first}' and '{path}' are the same file, which was read only once")
    files = sorted(paths.values(), key=lambda file: (_natural(file[1]), _natural(file[0])))
    names = [name for _, name in files]
    ends = [os.path.basename(path) for path, _ in files]
    for (path, name), end in zip(files, ends):
        parent = os.path.basename(os.path.dirname(os.path.abspath(path)))
        if names.count(name) > 1:
            name = f"{parent}/{name}"
        read = _READERS.get(extension(path))
        with reading(path):
            if read is None:
                raise IoError(_unknown(path))
            try:
                found = read(path, f"file {parent}/{end}" if ends.count(end) > 1 else f"file {end}", name, wanted)
            except IoError:
                raise
            except OSError as error:
                raise IoError(f"{path}: {error.strerror or error}. Check the name and the permissions") from None
            except Exception as error:  # other packages have errors of their own for damaged files
                raise IoError(f"{path}: {type(error).__name__}: {error}. The file may be damaged") from error
        yield Recording(**{**found.__dict__, "remarks": [*remarks, *found.remarks]})
        remarks = []


def _expanded(source: str, remarks: list[str]) -> list[tuple[str, str]]:
    """The files of a path, a folder or a pattern, and the names of their experiments."""
    if os.path.isdir(source):
        return _of_folder(source, remarks)
    if os.path.exists(source) or not glob.has_magic(source):
        return [(source, _stem(source))]
    found = glob.glob(source)
    if not found:
        raise IoError(f"{source}: no file matches this pattern. Check the folder and the extension")
    files = [path for path in found if os.path.isfile(path)]
    return [(path, _stem(path)) for path in files] or [file for path in found for file in _expanded(path, remarks)]


def _stem(path: str) -> str:
    return os.path.splitext(os.path.basename(path))[0]


def _of_folder(folder: str, remarks: list[str]) -> list[tuple[str, str]]:
    """The files in a folder; without any, the one file in each of its sub-folders, which names the experiment."""
    files, folders = _data_files(folder)
    below = {name: _data_files(os.path.join(folder, name))[0] for name in folders}
    below = {name: found for name, found in below.items() if found}
    if files:
        if below:
            remarks.append(f"the sub-folders {quoted(sorted(below, key=_natural))} of '{folder}' were not read")
        return [(path, _stem(path)) for path in files]
    if not below:
        raise IoError(
            f"{folder}: a folder without any data file found, one of {', '.join(sorted(_READERS))} needed"
        )
    for name, found in below.items():
        if len(found) > 1:
            raise IoError(
                f"{folder}: the sub-folder '{name}' has {len(found)} data files, one needed. To read a folder for each "
                f"run, give a pattern such as '{os.path.join(folder, '*', os.path.basename(found[0]))}'"
            )
    return [(found[0], name) for name, found in below.items()]


def _data_files(folder: str) -> tuple[list[str], list[str]]:
    files, folders = [], []
    for entry in sorted(os.scandir(folder), key=lambda entry: _natural(entry.name)):
        if entry.name.startswith((".", "~$")):
            continue
        if entry.is_dir():
            folders.append(entry.name)
        elif extension(entry.name) in _READERS:
            if not entry.is_file():
                raise IoError(f"{entry.path}: no regular file found. Remove a link to nothing, or a pipe, from the "
                              "folder")
            files.append(entry.path)
    return files, folders


def extension(path: str) -> str:
    return os.path.splitext(path)[1].lower()


def _unknown(path: str) -> str:
    if extension(path) in (".npz", ".h5", ".hdf5", ".mat"):
        return f"{path}: this file is an ensemble already. Use tokid.load"
    if not os.path.exists(path):
        return f"{path}: no such file found. Check the name"
    return f"{path}: the extension '{extension(path)}' found, one of {', '.join(sorted(_READERS))} needed"


# ---- formats ----


def _package(module: str, path: str, extra: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise IoError(f"{path}: this file needs {module.split('.')[0]}: pip install tokid[{extra}]") from None


def _excel(path: str, place: str, name: str, wanted: Sequence[str]) -> Recording:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    engine = "xlrd" if path.lower().endswith(".xls") else "openpyxl"
    _package(engine, path, "excel")
    sheets = pandas.read_excel(path, sheet_name=None, header=None, dtype=object, engine=engine)
    first, table = next(iter(sheets.items()))
    remarks = [f"only the first sheet '{first}' was read"] if len(sheets) > 1 else []
    return table_of(table.to_csv(header=False, index=False), remarks, place, name, wanted)


def _columns_of(read: str) -> Callable[[str, str, str, Sequence[str]], Recording]:
    def of(path: str, place: str, name: str, wanted: Sequence[str]) -> Recording:
        import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

        _package("pyarrow", path, "parquet")
        return _in_memory(getattr(pandas, read)(path), place, name)

    return of


def _log(extra: str, unit: str, series: Callable[[str], Iterator[_Series]]) -> Callable[..., Recording]:
    """A reader of a log, whose series become one table with a row for each time of any series."""

    def of(path: str, place: str, name: str, wanted: Sequence[str]) -> Recording:
        import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

        parts, topics, remarks = [], [], list[str]()
        several = list(series(path))
        for topic, fields in several:
            if "time" not in fields.columns:
                if len(several) > 1:
                    raise IoError(f"{place}: the series '{topic}' has no times, but the file has other series. Write it "
                                  "into a file of its own")
                return _in_memory(fields, place, name)
            again = int(fields["time"].duplicated().sum())
            if again:
                remarks.append(f"{again} samples of '{topic or name}' have the time of an earlier one. The last of each "
                               "time was used")
            own = fields.rename(columns={f: f"{topic}.{f}" if topic else str(f) for f in fields.columns if f != "time"})
            topics += [column for column in own.columns if column != "time"]
            used = [
                c for c in own.columns if c == "time" or not wanted or c in wanted or split_unit(str(c))[0] in wanted
            ]
            if len(used) > 1 and len(own):
                parts.append(own[used] if wanted else own)
        if not parts:
            shown = quoted(topics[:40]) + (" and more" if len(topics) > 40 else "")
            raise IoError(f"{place}: none of the wanted columns found among {shown}")
        table = pandas.concat(parts, ignore_index=True).groupby("time", sort=True).last().reset_index()
        if len(parts) > 1:
            remarks.append(f"{len(parts)} series on {len(parts)} clocks were joined by their times")
        found = _in_memory(table, place, name)
        units = [unit if label == "time" else own for label, own in zip(found.names, found.units)]
        return Recording(name, place, found.table, found.names, units, "row", {}, remarks)

    return of


def _ulg(path: str) -> Iterator[_Series]:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    log = _package("pyulog", path, "logs").ULog(path)
    for data in log.data_list:
        topic = data.name if not data.multi_id else f"{data.name}_{data.multi_id}"
        yield topic, pandas.DataFrame(data.data).rename(columns={"timestamp": "time"})


def _mcap(path: str) -> Iterator[_Series]:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    rows: dict[str, list[dict[str, Any]]] = {}
    for message in _package("mcap_ros2.reader", path, "logs").read_ros2_messages(path):
        fields = {"time": message.log_time_ns, **_flat(message.ros_msg)}
        rows.setdefault(message.channel.topic.lstrip("/").replace("/", "."), []).append(fields)
    for topic, found in rows.items():
        yield topic, pandas.DataFrame(found)


def _flat(message: Any, prefix: str = "") -> dict[str, float]:
    found: dict[str, float] = {}
    for name in message.__slots__ if hasattr(message, "__slots__") else vars(message):
        value = getattr(message, name)
        if isinstance(value, (bool, int, float)):
            found[prefix + name] = value
        elif isinstance(value, (list, tuple, np.ndarray)) and len(value) <= 64:
            found.update(
                {
                    f"{prefix}{name}[{n}]": float(v)
                    for n, v in enumerate(value)
                    if isinstance(v, (int, float, np.number))
                }
            )
        elif hasattr(value, "__slots__") or hasattr(value, "__dict__"):
            found.update(_flat(value, f"{prefix}{name}."))
    return found


def _alike(names: Sequence[str]) -> bool:
    """Whether groups have channels of the same name, which then need the name of the group."""
    return len(set(names)) < len(names)


def _mf4(path: str) -> Iterator[_Series]:
    with _package("asammdf", path, "logs").MDF(path) as log:
        groups = [log.get_group(number).rename_axis("time").reset_index() for number in range(len(log.groups))]
    alike = _alike([str(name) for group in groups for name in group.columns if name != "time"])
    for number, group in enumerate(groups):
        yield f"group{number}" if alike else "", group


def _tdms(path: str) -> Iterator[_Series]:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    groups = _package("nptdms", path, "logs").TdmsFile.read(path).groups()
    starts = [channel.properties.get("wf_start_time") for group in groups for channel in group.channels()]
    first = min((start for start in starts if start is not None), default=None)
    alike = _alike([channel.name for group in groups for channel in group.channels()])
    for group in groups:
        topic = group.name if alike else ""
        for channel in group.channels():
            if "wf_increment" not in channel.properties:
                yield topic, group.as_dataframe()
                break
            start, times = channel.properties.get("wf_start_time"), channel.time_track()
            if start is not None and first is not None:
                times = times + (start - first) / np.timedelta64(1, "s")
            yield topic, pandas.DataFrame({"time": np.round(times, 9), channel.name: channel[:]})


_READERS: dict[str, Callable[[str, str, str, Sequence[str]], Recording]] = {
    **dict.fromkeys(TEXTS, read_text),
    **dict.fromkeys((".xlsx", ".xls"), _excel),
    ".parquet": _columns_of("read_parquet"),
    ".feather": _columns_of("read_feather"),
    ".ulg": _log("logs", "us", _ulg),
    ".mcap": _log("logs", "ns", _mcap),
    ".mf4": _log("logs", "s", _mf4),
    ".tdms": _log("logs", "s", _tdms),
}
