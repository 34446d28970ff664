# SPDX-License-Identifier: BSD-3-Clause
"""Time stamps as texts → whole nanoseconds."""

from __future__ import annotations

import re
from typing import Any, Optional

import numpy as np

from .recording import Ints, Recording
from .words import STAMP

NS = 10**9
_MONTHS = {m: str(n + 1) for n, m in enumerate("jan feb mar apr may jun jul aug sep oct nov dec".split())}
_PATTERN = (
    r"^\s*(?:(?P<a>\d{1,4})[-./ ](?P<b>\d{1,2}|[A-Za-z]{3})[-./ ](?P<c>\d{1,4})(?:[ T]+|$))?"
    r"(?:(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,](?P<part>\d*))?)?)?"
    r"\s*(?P<half>[AaPp])?\.?(?:[Mm]\.?)?\s*(?P<zone>Z|[-+]\d{2}:?\d{2})?\s*$"
)


def first_stamp(recording: Recording, column: int) -> Optional[str]:
    """The first time stamp of a column of texts, if most of its first cells are time stamps; else None."""
    if recording.kind(column) != "O":
        return None
    cells = [str(cell) for cell in recording.table[column].iloc[:20] if cell == cell and cell not in (None, "")]
    stamps = [cell for cell in cells if STAMP.fullmatch(cell)]
    return stamps[0] if 2 * len(stamps) >= len(cells) > 0 else None


def _parts(recording: Recording, column: int, needed: str) -> Any:
    """The parts of the stamps, as texts; empty where a stamp has no such part."""
    series = recording.table[column].astype(object)
    parts = series.where(series.notna(), "").astype(str).str.extract(_PATTERN).astype(object)
    wrong = np.flatnonzero(parts[needed].isna().to_numpy())
    if len(wrong):
        stamp = first_stamp(recording, column)
        raise recording.error(f"{recording.text(wrong[0], column)} found, a time stamp like '{stamp}' "
                              "needed", wrong[0], column)
    return parts.where(parts.notna(), "")


def _ints(texts: Any) -> Ints:
    return np.asarray(texts.where(texts != "", "0").astype(np.int64))


def _of_day(parts: Any) -> Ints:
    """The time of day [ns]."""
    hour, half = _ints(parts["hour"]), parts["half"].str.lower()
    hour = np.where(half == "p", hour % 12 + 12, np.where(half == "a", hour % 12, hour))
    seconds = (hour * 60 + _ints(parts["minute"])) * 60 + _ints(parts["second"])
    return np.asarray(seconds * NS + _ints(parts["part"].str[:9].str.ljust(9, "0")), dtype=np.int64)


def stamp_ticks(recording: Recording, column: int, dates: Optional[str]) -> tuple[Ints, list[str]]:
    """Nanoseconds since 1970 of dates with or without a time of day, and remarks."""
    parts = _parts(recording, column, "a")
    a, c = _ints(parts["a"]), _ints(parts["c"])
    months = parts["b"].str.lower().map(lambda text: _MONTHS.get(text, text))
    if not months.str.isdigit().all():
        raise recording.error(f"{recording.text(0, column)} found, months such as Jan or 01 needed", 0, column)
    b, remarks = _ints(months), list[str]()
    if (a > 31).any():
        year, month, day = a, b, c
    else:
        day_first, remarks = (True, []) if parts["b"].str.isalpha().all() else _order(recording, column, a, b, c, dates)
        day, month = (a, b) if day_first else (b, a)
        year = np.where(c < 70, c + 2000, np.where(c < 100, c + 1900, c))
    wrong = np.flatnonzero((month < 1) | (month > 12) | (day < 1) | (day > 31))
    if len(wrong):
        raise recording.error(f"{recording.text(wrong[0], column)} found, a valid date needed", wrong[0], column)
    days = ((year - 1970).astype("datetime64[Y]").astype("datetime64[M]") + (month - 1)).astype("datetime64[D]") + (
        day - 1
    )
    zones = parts["zone"]
    mixed = np.flatnonzero(((zones == "") != (zones.iloc[0] == "")).to_numpy())
    if len(mixed):
        raise recording.error(f"{recording.text(mixed[0], column)} found, but {recording.text(0, column)} in "
                              f"{recording.row(0)}: a time zone in all rows or in none needed", mixed[0], column)
    return (
        days.astype("datetime64[ns]").astype(np.int64) + _of_day(parts) - zones.map(_offset).to_numpy(np.int64),
        remarks,
    )


def _order(
    recording: Recording, column: int, a: Ints, b: Ints, c: Ints, dates: Optional[str]
) -> tuple[bool, list[str]]:
    """Whether the day comes first in dates such as 03/04/2026."""
    if dates is not None:
        return dates == "day-first", []
    late = [np.flatnonzero(part > 12) for part in (a, b)]
    if len(late[0]) and len(late[1]):
        raise recording.error(f"{recording.text(late[0][0], column)}: the first number can only be the day, but in "
                              f"{recording.row(late[1][0])} only the second one can be", late[0][0], column)
    if len(late[1]):
        return False, [f"dates were read as month/day, because of {recording.text(late[1][0], column)}"]
    if not len(late[0]) and not all((part == part[0]).all() for part in (a, b, c)):
        raise recording.error(f"{recording.text(0, column)}: this may be day/month or month/day, and no date of the "
                              "column shows which of them. State dates='day-first' or dates='month-first'", 0, column)
    return True, []


def _offset(zone: str) -> int:
    minutes = int(zone[1:3]) * 60 + int(zone[-2:]) if zone not in ("", "Z") else 0
    return (-minutes if zone.startswith("-") else minutes) * 60 * NS


def day_ticks(recording: Recording, column: int, passes: bool = True) -> tuple[Ints, list[str]]:
    """Nanoseconds of times of day. If they pass midnight, the days after it are counted, and remarks say so."""
    parts = _parts(recording, column, "hour")
    ticks, remarks, unit = _of_day(parts), [], recording.units[column].lower()
    if not passes:
        return ticks, []
    if (parts["second"] == "").all():
        if re.fullmatch(r"m(m|in)?:s(s|ec)?", unit):
            return ticks // 60, []
        if (ticks >= 24 * 3600 * NS).any() and not unit:
            raise recording.error("a time of day needed. If these are minutes and seconds, add [mm:ss] to the "
                                  "name", column=column)
        remarks += [] if unit else [f"column '{recording.label(column)}': {recording.text(0, column)} was read as "
                                    "hours and minutes. If these are minutes and seconds, add [mm:ss] to the name of "
                                    "the column"]  # fmt: skip
    change = np.diff(ticks)
    sign = 1 if (change > 0).sum() >= (change < 0).sum() else -1
    # A clock that is set back is not a new day. Midnight moves the time by more than six hours.
    turns = np.flatnonzero(sign * change < -6 * 3600 * NS) + 1
    if len(turns):
        row, hours = int(turns[0]), ticks // (3600 * NS)
        if (parts["half"] == "").all() and hours.min() >= 1 and hours.max() <= 12:
            raise recording.error(f"{recording.text(row, column)} found after {recording.text(row - 1, column)}; "
                                  "without AM and PM, this may be noon or midnight. Add the dates to the "
                                  "times", row, column)
        remarks.append(f"the times of day pass midnight: {recording.text(row, column)} in {recording.row(row)} was "
                       "read as one of another day")
        ticks = ticks + sign * np.cumsum(np.isin(np.arange(len(ticks)), turns)) * 24 * 3600 * NS
    return ticks, remarks
