# SPDX-License-Identifier: BSD-3-Clause
"""The values that move from step to step: options, recordings, remarks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn, Optional

import numpy as np

from .. import _options
from .._errors import IoError
from .._samples import one_or_more
from .words import SILENT, SWITCHES, is_missing, number, split_unit

Ints = np.ndarray[Any, Any]
METHODS = {name: name for name in ("linear", "previous", "mean")}
DATES = {name: name for name in ("day-first", "month-first")}
CONDITION = re.compile(r"\s*(.+?)\s*(>=|<=|==|!=|>|<)\s*(.+?)\s*")


@dataclass(frozen=True)
class Options:
    """The options of `read`, checked."""

    inputs: Sequence[str] = ()
    outputs: Sequence[str] = ()
    outputs_required: bool = False
    time: str = ""
    experiment_column: str = ""
    missing: Sequence[str] = ()
    dates: Optional[str] = None
    dt: Optional[float] = None
    trigger: str = ""
    before: int = 0
    resample: Optional[float] = None
    resample_method: str = "linear"
    held: Sequence[str] = ()
    longest_gap: Optional[int] = None


def _or_none(check: Callable[..., Any], *limits: Any) -> Callable[[str, Any], Any]:
    return lambda name, value: None if value is None else check(name, value, *limits)


def _positive(name: str, value: Any) -> float:
    if not _options.number(name, value) > 0 or not np.isfinite(value):
        raise ValueError(f"{name}: {value!r} found, a positive number of seconds needed")
    return float(value)


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    **dict.fromkeys(("inputs", "outputs", "missing", "held"), lambda _, value: one_or_more(value)),
    **dict.fromkeys(("time", "experiment_column", "trigger"), _options.text),
    **dict.fromkeys(("dt", "resample"), _or_none(_positive)),
    "outputs_required": _options.switch,
    "dates": _or_none(_options.choice, DATES),
    "before": lambda name, value: _options.integer(name, value, 0),
    "resample_method": lambda name, value: _options.choice(name, value, METHODS),
    "longest_gap": _or_none(_options.integer, 1),
}
OPTIONS = tuple(_CHECKS)


def checked(given: Mapping[str, Any]) -> Options:
    """Check the options of `read`."""
    unknown = [name for name in given if name not in _CHECKS]
    if unknown:
        raise TypeError(f"{unknown[0]!r} is no option of a reader of tables")
    options = Options(**{name: _CHECKS[name](name, value) for name, value in given.items()})
    if options.trigger and not CONDITION.fullmatch(options.trigger):
        raise ValueError(f"trigger: {options.trigger!r} found, a column, one of > >= < <= == != and a number needed")
    if options.before and not options.trigger:
        raise ValueError("before: no trigger found. State the trigger before whose event the steps are kept")
    if options.resample is None and (options.held or options.longest_gap):
        raise ValueError(f"{'held' if options.held else 'longest_gap'}: no resample found. State the sample time of "
                         "the grid")
    if options.dt is not None and options.resample is not None:
        raise ValueError("dt: a sample time found together with resample. State only one of them")
    return options


@dataclass(frozen=True)
class Recording:
    """One table of raw columns, as it was recorded.

    The columns of `table` have the numbers 0, 1, …; `names` and `units` describe them. The index of `table` has the
    lines of the file, or the rows of a table in memory, for messages.
    """

    name: str
    place: str
    table: Any
    names: Sequence[str]
    units: Sequence[str]
    counted: str = "row"
    notes: Mapping[str, Any] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    decimal: str = "."
    thousands: Optional[str] = None

    def label(self, column: int) -> str:
        """A column with its unit, as messages name it."""
        name = self.names[column] or f"number {column + 1}, without a name"
        return f"{name} [{self.units[column]}]" if self.units[column] else name

    def labels(self) -> str:
        return quoted([self.label(c) for c in range(len(self.names))])

    def kind(self, column: int) -> str:
        """The kind of the values of a column, as NumPy has it; "O" for texts and mixtures."""
        return str(getattr(self.table[column].dtype, "kind", "O"))

    def row(self, row: int) -> str:
        return f"{self.counted} {self.table.index[row]}"

    def at(self, row: Optional[int] = None, column: Optional[int] = None) -> str:
        name = "" if column is None else f"column '{self.label(column)}'"
        return ", ".join(filter(None, [self.place, "" if row is None else self.row(row), name]))

    def error(self, text: str, row: Optional[int] = None, column: Optional[int] = None) -> Exception:
        """The error about a place in the recording."""
        place = self.at(row, column)
        words = f"{place}: {text}" if place else text
        return IoError(words) if self.place.startswith("file") else ValueError(words)

    def refuse(self, text: str, row: int, column: int) -> NoReturn:
        """Raise the error about a cell."""
        raise self.error(f"{self.text(row, column)} found, which {text}", row, column)

    def text(self, row: int, column: int) -> str:
        """A cell for messages."""
        value = self.table[column].iloc[row]
        return (
            "nothing"
            if value is None or value == "" or (value != value and self.kind(column) not in "mM")
            else f"'{value}'"
        )

    def find(self, wanted: str) -> Optional[int]:
        """The column of this name, with or without its unit; None without one. Equal columns of one name are one."""
        name, unit = split_unit(wanted)
        found = [c for c in range(len(self.names)) if wanted in (self.names[c], self.label(c))]
        if not found and unit:
            found = [c for c, own in enumerate(self.names) if own == name]
            if found and self.units[found[0]] not in ("", unit):
                raise self.error(f"column '{self.label(found[0])}' found, '{wanted}' needed: the units differ")
        if any(not self.table[c].equals(self.table[found[0]]) for c in found):
            raise self.error(f"{len(found)} columns '{wanted}' found, one needed. Give each column its own name, and "
                             "write experiments that stand side by side below each other")
        return found[0] if found else None

    def need(self, wanted: str) -> int:
        column = self.find(wanted)
        if column is None:
            raise self.error(f"no column '{wanted}' found among {self.labels()}")
        return column

    def numbers(self, column: int, words: Sequence[str] = ()) -> np.ndarray[Any, Any]:
        """The numbers of a column. Words for missing samples, also those of the option `missing`, are NaN."""
        series, kind = self.table[column], self.kind(column)
        if kind in "mM":
            raise self.error(f"{series.dtype} found, numbers needed", column=column)
        values = series.to_numpy(dtype=np.float64, na_value=np.nan) if kind in "fiub" else self._of_words(column, words)
        lost = [own for own in (number(word, self.decimal, self.thousands) for word in words) if own is not None]
        values = np.where(np.isin(values, lost), np.nan, values) if lost else values
        if np.isinf(values).any():
            row = int(np.argmax(np.isinf(values)))
            raise self.error(f"{self.text(row, column)} found, a finite number needed", row, column)
        return np.asarray(values)

    def codes(self, column: int) -> tuple[Ints, list[str]]:
        """The distinct texts of a column, and which of them each cell has; -1 for an empty cell."""
        from pandas import factorize  # type: ignore[import-not-found, import-untyped, unused-ignore]

        cells = self.table[column].astype(object)
        codes, texts = factorize(cells.where(cells.isna(), cells.map(str)))
        return codes, [text.strip() for text in texts]

    def _of_words(self, column: int, words: Sequence[str]) -> np.ndarray[Any, Any]:
        codes, texts = self.codes(column)
        values = [np.nan if t in words or is_missing(t) else number(t, self.decimal, self.thousands) for t in texts]
        bad = [n for n, value in enumerate(values) if value is None]
        if not bad:
            return np.asarray([*values, np.nan], dtype=np.float64)[codes]
        word = texts[bad[0]]
        if re.fullmatch(r"[-+]?\d+[.,]\d+", word):
            hint = f", with '{self.decimal}' as the decimal mark. Write all numbers with the same decimal mark"
        elif len(bad) < len(values):
            hint = f"; missing={word!r} reads it as a missing sample"
        elif len(bad) < 5:
            hint = f"; the column has only the texts {quoted(texts)}: replace them by numbers, such as 0 and 1"
        else:
            hint = "; the column has many texts and no numbers, so it can't be a channel"
        raise self.error(f"'{word}' found, a number needed{hint}", int(np.argmax(codes == bad[0])), column)

    def words(self, column: int) -> tuple[list[str], Ints, bool]:
        """The words for missing samples that a remark reports, their rows, and whether there are switches."""
        if self.kind(column) != "O":
            return [], np.zeros(0), False
        codes, texts = self.codes(column)
        found = [n for n, text in enumerate(texts) if is_missing(text) and text not in SILENT]
        return (
            [texts[n] for n in found],
            np.flatnonzero(np.isin(codes, found)),
            any(text.lower() in SWITCHES for text in texts),
        )

    def has(self, column: int, word: str) -> bool:
        """Whether a cell is this word or number."""
        if self.kind(column) == "O":
            return word in self.codes(column)[1]
        return bool((self.table[column] == number(word, self.decimal, self.thousands)).any())


@dataclass(frozen=True)
class Remark:
    """A text about a recording; equal texts about several recordings become one."""

    text: str
    of: str = ""


def joined(remarks: Iterable[Remark], recordings: int) -> list[str]:
    """The texts of remarks, with the recordings that they are about."""
    places: dict[str, list[str]] = {}
    for remark in remarks:
        of = places.setdefault(remark.text, [])
        of += [remark.of] if remark.of and remark.of not in of else []
    texts = []
    for text, of in places.items():
        alone = not of or recordings == 1
        more = f" and {len(of) - 1} more" if len(of) > 1 else ""
        texts.append(text if alone else f"in all recordings, {text}" if len(of) == recordings else f"{of[0]}{more}: "
                                                                                                   f"{text}")
    return texts


def quoted(names: Sequence[str]) -> str:
    return "'" + "', '".join(names) + "'" if names else "nothing"
