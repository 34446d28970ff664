# SPDX-License-Identifier: BSD-3-Clause
"""Raw columns → the times of the rows: which column is the clock, in which unit it counts, and what its cells say."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Optional

import numpy as np

from .channels import Channels
from .recording import Ints, Options, Recording, Remark, quoted
from .stamps import NS, day_ticks, first_stamp, stamp_ticks
from .words import SUMMARY, split_unit, time_unit

_Unit = tuple[int, int]
_STRONG = re.compile(
    r"(time since start|time elapsed|elapsed time|elapsed|timestamp|date ?time|time|zeit|t)(?:(?:(?<!^t)| ) ?(?:in )?(\w+))?"
)
_WEAK = re.compile(
    r"(?:up|unix|utc|gps|local|sim|simulation|sys|system|boot)? ?(?:time|tow|utc|epoch|clock|uptime|stamp)"
    r"(?: (?:since )?(?:start|boot))? ?(?:in )?(\w*)"
)
_ALONE = {"us", "ms", "ns", "usec", "msec", "nsec", "usecs", "msecs", "millis", "micros", "nanos"}
_SURE = {"sec", "seconds", "milliseconds", "microseconds", "nanoseconds", "seconds since start"}
_STEPS = re.compile(r"(step|sample)( number| no| index)?")


@dataclass(frozen=True)
class Clock:
    """The times of the rows of a recording.

    `ticks` are whole numbers wherever the file has whole numbers. One tick has `unit` seconds. `kind` is "time",
    "step" (numbers of steps) or "row" (the rows are the steps).
    """

    kind: str
    ticks: Ints
    unit: _Unit = (1, 1)
    columns: tuple[int, ...] = ()
    dated: bool = False
    remarks: Sequence[Remark] = ()

    def seconds(self, rows: Ints) -> tuple[np.ndarray[Any, Any], Fraction]:
        """The times [s] of some rows after the earliest of them, and this one."""
        first = self.ticks[rows].min()  # subtracted as a whole number, so that no digit is lost
        since = (self.ticks[rows] - first).astype(np.float64) * self.unit[0] / self.unit[1]
        return since, Fraction(first.item()) * Fraction(*self.unit)


def clock(recording: Recording, channels: Channels, options: Options) -> Clock:
    """Find the times of a recording. The option `time` names their column; otherwise its name or its cells do."""
    stated = channels.stated(recording)
    free = [c for c in range(len(recording.names)) if c not in stated]
    if options.time:
        column = recording.need(options.time)
        if column in (*stated, channels.experiments(recording)):
            role = "a channel" if column in stated else "names of experiments"
            raise recording.error(f"column '{recording.label(column)}' is stated as times and as {role}. State it once")
        return _of_column(recording, column, options, [], split_unit(options.time)[1])
    pair, named = _pair(recording, free), _named(recording, free)
    if pair is not None:
        return pair
    found = _stamped(recording, free) if named is None else named
    if found is not None and not ("k" in recording.names and _only_dates(recording, found)):
        return _of_column(recording, found, options, free)
    steps = [c for c in free if recording.names[c] == "k"] or [
        c for c in free if _STEPS.fullmatch(re.sub(r"[_\-. ]+", " ", recording.names[c].lower()).strip())]
    if steps:
        return _of_steps(recording, _only(recording, steps, "step numbers", "k"))
    like = next((c for c in free if _even(recording, c)), None)
    text = (
        ""
        if like is None
        else f"column '{recording.label(like)}' rises evenly like a clock. If it has the times, state it (option time)"
    )
    return Clock("row", np.arange(len(recording.table)), remarks=[Remark(text, recording.place)] if text else [])


# ---- which column ----


def unit_of_name(name: str, unit: str) -> Optional[tuple[bool, Optional[_Unit]]]:
    """Whether a name is surely that of a column of times, and the unit that it states. None for other names."""
    last = re.sub(r"[_\-/,:. ]+", " ", re.sub(r"(?<=[a-z])(?=US$|MS$|NS$)", " ", name.lstrip("%# "))).strip()
    lower, bracket = last.lower(), time_unit(unit)
    if unit and bracket is None and ":" not in unit:
        return (True, None) if lower == "time" else None
    strong = _STRONG.fullmatch(lower)
    if (
        strong
        and last != "T"
        and (not strong[2] or time_unit(strong[2]))
        and not (strong[1] == "t" and strong[2] in ("min", "h", "d"))
    ):
        return True, bracket or time_unit(strong[2] or "")
    weak = _WEAK.fullmatch(lower) or _WEAK.fullmatch(" ".join(lower.split()[-2:]))
    if weak and (not weak[1] or time_unit(weak[1])):
        return False, bracket or time_unit(weak[1])
    return (lower in _SURE, time_unit(lower.split()[0])) if lower in _SURE | _ALONE else None


def _only(recording: Recording, found: Sequence[int], what: str, name: str) -> int:
    if len(found) > 1:
        raise recording.error(f"columns: {quoted([recording.label(c) for c in found])} found, one column of {what} "
                              f"needed; give this column the name '{name}'")
    return found[0]


def _named(recording: Recording, free: Sequence[int]) -> Optional[int]:
    """The column "time"; else the only column with a sure name of times; else one with another such name that rises."""
    names = {c: own for c in free if (own := unit_of_name(recording.names[c], recording.units[c])) is not None}
    exact = [c for c in names if recording.names[c].lower() == "time"]
    sure = [c for c, (sure, _) in names.items() if sure]
    if sure:
        return exact[0] if len(exact) == 1 else _only(recording, sure, "times", "time")
    return next((c for c in names if np.mean(_gaps(recording, c) > 0) > 0.8), None)


def _gaps(recording: Recording, column: int) -> np.ndarray[Any, Any]:
    """The differences of the numbers of a column; [-1] for a column of texts."""
    if recording.kind(column) not in "fiu" or len(recording.table) < 2:
        return np.asarray([-1.0])
    return np.diff(recording.table[column].to_numpy(dtype=np.float64, na_value=np.nan))


def _even(recording: Recording, column: int) -> bool:
    gaps = _gaps(recording, column)
    return len(gaps) > 2 and bool(gaps.min() > 0 and gaps.max() - gaps.min() <= 1e-3 * gaps.max())


def _stamped(recording: Recording, free: Sequence[int]) -> Optional[int]:
    """The first column of time stamps; one with the time of day before one of dates only."""
    found = [c for c in free if first_stamp(recording, c) or recording.kind(c) in "mM"]
    return min(found, key=lambda c: (_only_dates(recording, c), c), default=None)


def _only_dates(recording: Recording, column: int) -> bool:
    return ":" not in (first_stamp(recording, column) or ":")


def _pair(recording: Recording, free: Sequence[int]) -> Optional[Clock]:
    """Two columns of one clock: seconds and nanoseconds since 1970, as ROS has them."""
    ends = {re.split(r"[._ ]", recording.names[c].lower())[-1]: c for c in reversed(free) if recording.kind(c) in "iu"}
    seconds, fraction = ends.get("sec", ends.get("secs")), ends.get("nanosec", ends.get("nsec", ends.get("nsecs")))
    if seconds is None or fraction is None:
        return None
    ticks = recording.table[seconds].to_numpy(np.int64) * NS + recording.table[fraction].to_numpy(np.int64)
    text = f"columns '{recording.label(seconds)}' and '{recording.label(fraction)}' were read as one time"
    return Clock("time", ticks, (1, NS), (seconds, fraction), True, [Remark(text, recording.place)])


# ---- what the cells say ----


def _of_steps(recording: Recording, column: int) -> Clock:
    numbers = recording.numbers(column)
    wrong = np.flatnonzero(~np.isfinite(numbers) | (numbers != np.floor(numbers)))
    if len(wrong):
        raise recording.error(f"{recording.text(wrong[0], column)} found, a whole number needed; rename the column if "
                              "it has no steps",
                              wrong[0], column)
    return Clock("step", numbers.astype(np.int64), columns=(column,))


def _of_column(recording: Recording, column: int, options: Options, free: Sequence[int], stated: str = "") -> Clock:
    series, kind, name = recording.table[column], recording.kind(column), recording.label(column)
    if first_stamp(recording, column):
        return _of_stamps(recording, column, options, free)
    if kind in "mM":
        _no_gaps(recording, column, series.isna().to_numpy())
        series = (
            series.dt.tz_convert("UTC").dt.tz_localize(None)
            if getattr(series.dtype, "tz", None) is not None
            else series
        )
        ticks = series.to_numpy(dtype=f"{'datetime' if kind == 'M' else 'timedelta'}64[ns]").astype(np.int64)
        return Clock("time", ticks, (1, NS), (column,), kind == "M")
    known = unit_of_name(recording.names[column], recording.units[column])
    unit = time_unit(stated or recording.units[column]) or (known[1] if known else None)
    if unit is None and (stated or recording.units[column]):
        raise recording.error(f"column '{name}': the unit '{stated or recording.units[column]}' is not known; one of "
                              "s, ms, us, ns, min, h, d needed")
    words = recording.codes(column)[1] if kind == "O" else []
    summary = next((word for word in words if word.lower().strip(":. ") in SUMMARY), None)
    if summary is not None:
        row = int(np.argmax((series == summary).to_numpy()))
        raise recording.error(f"'{summary}' found, a time needed. This row sums up the samples. Delete it and rows "
                              "like it", row, column)
    ticks = series.to_numpy(np.int64) if kind in "iu" and not series.isna().any() else recording.numbers(column)
    _no_gaps(recording, column, np.isnan(ticks))
    unit, text = (unit, "") if unit else _guessed(recording, column, ticks)
    return Clock("time", ticks, unit, (column,), False, [Remark(text, recording.place)] if text else [])


def _no_gaps(recording: Recording, column: int, missing: Ints) -> None:
    if missing.any():
        row = int(np.argmax(missing))
        raise recording.error(f"{recording.text(row, column)} found, a finite time needed. If rows without a time sum "
                              "up the others (mean, max), delete them", row, column)


def _guessed(recording: Recording, column: int, ticks: Ints) -> tuple[_Unit, str]:
    """The unit of times without one: the magnitude of a date tells it. Otherwise it is the second, if that can be."""
    name, middle = recording.label(column), float(np.median(ticks))
    for power, unit in ((3, "ms"), (6, "us"), (9, "ns")):
        if 4e8 < middle / 10**power < 4.2e9:
            return (
                1,
                10**power,
            ), f"column '{name}' was read as {unit} since 1970. If this is wrong, write its unit into its name"
    gaps = np.abs(np.diff(ticks))
    step = float(np.median(gaps[gaps > 0])) if (gaps > 0).any() else 0.0
    whole = bool(np.all(ticks == np.round(ticks)))
    rough: Callable[[float], float] = lambda value: abs(value / float(f"{value:.2g}") - 1)  # noqa: E731
    if 29000 < middle < 60000 and not whole and 0 < step < 0.05 and rough(step * 86400) < 0.1 * max(rough(step), 0.01):
        return (86400, 1), f"column '{name}' was read as days since 1900, as spreadsheets count them"
    if abs(middle) > 3000 * 365.25 * 86400 or (whole and step >= 1000 and step % 60):
        raise recording.error(f"{recording.text(0, column)} and steps of {step:g} found, which would be "
                              f"{step / 3600:.3g} h in seconds. State the unit, such as time='{name} [us]', or write "
                              "it into the name of the column", 0, column)
    text = f"column '{name}' was read in seconds: a step is {step / 3600:.3g} h. If wrong, write the unit into its name"
    return (1, 1), text if whole and step > 3600 else ""


def _of_stamps(recording: Recording, column: int, options: Options, free: Sequence[int]) -> Clock:
    """Times from time stamps, or from a column of dates and a column of times of day."""
    def has_date(c: int) -> bool:
        return bool(re.search(r"[-/ ]\d|[A-Za-z]{3}|\d\.\d+\.\d", (first_stamp(recording, c) or "").split(":")[0]))

    others = [c for c in free if c != column and first_stamp(recording, c) and has_date(c) != has_date(column)]
    others = [c for c in others if _only_dates(recording, c) or _only_dates(recording, column)]
    if others:
        dates, times = (column, others[0]) if has_date(column) else (others[0], column)
        ticks, texts = stamp_ticks(recording, dates, options.dates)
        ticks = ticks + day_ticks(recording, times, passes=False)[0]
        texts = [*texts, f"columns '{recording.label(dates)}' and '{recording.label(times)}' were read as one time"]
        columns: tuple[int, ...] = (dates, times)
    else:
        columns = (column,)
        ticks, texts = (
            stamp_ticks(recording, column, options.dates) if has_date(column) else day_ticks(recording, column)
        )
    return Clock("time", ticks, (1, NS), columns, True, [Remark(text, recording.place) for text in texts])
