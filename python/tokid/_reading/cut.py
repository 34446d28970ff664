# SPDX-License-Identifier: BSD-3-Clause
"""Recordings → experiments: by a column, at restarts of the clock, from a trigger on."""

from __future__ import annotations

import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NoReturn, Optional

import numpy as np

from .._samples import label
from .channels import Channels, Columns
from .clock import Clock
from .recording import CONDITION, Ints, Options, Recording, Remark, quoted
from .words import is_missing, number

_NAMED = re.compile(r"(run|batch|trial|cycle|test|versuch|charge|experiment|lot|series)\b.*")
_COMPARE = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
}


@dataclass(frozen=True)
class Experiment:
    """Rows of a recording in the order of their times.

    `times` are seconds, or step numbers, from the first row or from the event of a trigger. `begin` is the time of
    this origin on the clock. `own` tells whether the experiment begins at its first row, and not on a common clock.
    """

    name: str
    number: int
    recording: Recording
    clock: Clock
    rows: Ints
    times: np.ndarray[Any, Any]
    begin: Fraction
    own: bool = False

    def refuse(self, text: str, row: int) -> NoReturn:
        """Raise the error about the time of a row."""
        self.recording.refuse(text, self.rows[row], self.clock.columns[-1])


def experiments(
    recordings: Sequence[Recording], clocks: Sequence[Clock], channels: Channels, columns: Columns, options: Options
) -> tuple[list[Experiment], list[Remark]]:
    """Cut recordings into experiments, with a common origin of their times."""
    found: list[Experiment] = []
    remarks: list[Remark] = []
    odd = next((n for n, clock in enumerate(clocks) if clock.kind != clocks[0].kind), None)
    if odd is not None:
        one, other = (odd, 0) if clocks[odd].kind == "row" else (0, odd)
        raise recordings[one].error("no column of times or step numbers like "
                                    f"'{recordings[other].label(clocks[other].columns[0])}' in "
                                    f"{recordings[other].place} found. Add it, or leave this recording out")
    for number_of, (recording, clock) in enumerate(zip(recordings, clocks)):
        parts = _parts(recording, clock, channels, [*columns.of[number_of], *clock.columns], number_of, remarks)
        if not parts:
            raise recording.error("no rows found, samples needed")
        several = len(recordings) > 1 or recording.place.startswith("table")
        if several:
            parts = [replace(p, name=f"{recording.name}/{p.name}" if len(parts) > 1 else recording.name) for p in parts]
        found += parts
    if options.trigger:
        return _triggered(recordings, found, options, remarks), remarks
    return _with_origin(recordings, clocks[0], found, remarks), remarks


# ---- rows of an experiment ----


def _parts(
    recording: Recording, clock: Clock, channels: Channels, used: Sequence[int], number_of: int, remarks: list[Remark]
) -> list[Experiment]:
    rows = np.arange(len(recording.table))
    column = channels.experiments(recording)
    groups = [("", rows)] if column is None else _labelled(recording, column, rows, remarks)
    parts = []
    for name, own in groups:
        pieces = _in_order(recording, clock, own, [*used, column], remarks) if len(own) else []
        for piece, ordered in enumerate(pieces):
            times, begin = (
                clock.seconds(ordered) if clock.kind != "row" else (np.arange(len(ordered)) * 1.0, Fraction(0))
            )
            full = name if len(pieces) == 1 else f"{name}/{piece + 1}".lstrip("/")
            parts.append(Experiment(full, number_of, recording, clock, ordered, times, begin, len(pieces) > 1))
            gaps = np.diff(times)
            widest = int(np.argmax(gaps)) if len(gaps) > 2 else -1
            if widest >= 0 and gaps[widest] > 2 * float(np.median(gaps)) * max(len(times), 5):
                hint = advice(recording, candidate(recording, ordered, np.zeros(0), [*used, column]))
                remarks.append(Remark(f"{f'experiment {full!r} has ' if full else ''}a gap of {gaps[widest]:g} s "
                                      f"between {recording.row(ordered[widest])} and "
                                      f"{recording.row(ordered[widest + 1])}. Check whether these are two "
                                      f"experiments{hint}", recording.place))
    return parts


def _labelled(recording: Recording, column: int, rows: Ints, remarks: list[Remark]) -> list[tuple[str, Ints]]:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    codes, names = pandas.factorize(recording.table[column].iloc[rows])
    empty = np.flatnonzero((codes < 0) | np.isin(codes, [n for n, name in enumerate(names) if not str(name).strip()]))
    if len(empty):
        raise recording.error("nothing found, a number or name needed", rows[empty[0]], column)
    begins = np.flatnonzero(np.diff(codes, prepend=-1))
    again = next((n for n in begins[1:] if codes[n] in codes[:n]), None)
    if again is not None and len(rows) > 2 * len(begins):
        remarks.append(Remark(f"column '{recording.label(column)}': the rows of '{names[codes[again]]}' lie in several "
                              f"places, the second begins in {recording.row(rows[again])}. They were read as one "
                              "experiment. Check the names", recording.place))
    order, ends = np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes, minlength=len(names)))
    return [(label(name).strip(), rows[own]) for name, own in zip(names, np.split(order, ends[:-1]))]


def _in_order(
    recording: Recording, clock: Clock, rows: Ints, used: Sequence[Optional[int]], remarks: list[Remark]
) -> list[Ints]:
    """The rows in the order of their times. Falling times are cut only where the clock begins again."""
    ticks = clock.ticks[rows]
    change = np.diff(ticks)
    falls = np.flatnonzero(change < 0) + 1
    if clock.kind == "row" or not len(falls):
        return [rows]
    ordered = rows[np.argsort(ticks, kind="stable")]
    if clock.kind == "step":
        return [ordered]
    if (change <= 0).all() and len(rows) > 2:
        remarks.append(Remark("the times fall from row to row, so the rows were read from the last to the "
                              "first", recording.place))
        return [rows[::-1]]
    row = int(falls[0])
    known = " a second row for this time," if ticks[row] in ticks[:row] else ""
    now, last = (recording.text(rows[n], clock.columns[-1]) for n in (row, row - 1))
    text = f"{now} found after {last},{known} so the times fall"
    column = candidate(recording, rows, falls, used)
    if column is not None:
        raise recording.error(text + advice(recording, column), rows[row], clock.columns[-1])
    step = np.median(change[change > 0]) if (change > 0).any() else 0
    begins, sizes = np.append(0, falls), np.diff([0, *falls, len(rows)])
    if not clock.dated and sizes.min() > 3 and np.all(np.abs(ticks[begins] - ticks[0]) <= step):
        where = ", ".join(recording.row(rows[n]) for n in falls[:3]) + (" and more" if len(falls) > 3 else "")
        remarks.append(Remark(f"the times begin again at {where}, so the rows were cut into {len(begins)} experiments "
                              "there", recording.place))
        return list(np.split(rows, falls))
    if 5 * len(falls) > len(rows):
        remarks.append(Remark("the rows are not in the order of their times and were sorted by them", recording.place))
        return [ordered]
    raise recording.error(f"{text}. {_cause(recording, clock, rows[row - 1], rows[row])}. Correct the times, or write "
                          "each recording into a file of its own", rows[row], clock.columns[-1])


def _cause(recording: Recording, clock: Clock, before: int, after: int) -> str:
    """Why times may fall."""
    texts = [str(recording.table[clock.columns[-1]].iloc[row]) for row in (before, after)]
    hours = float(clock.ticks[before] - clock.ticks[after]) * clock.unit[0] / clock.unit[1] / 3600
    digits = [len(found[1]) if (found := re.search(r":\d+[.,](\d+)", text)) else 0 for text in texts]
    if clock.dated and digits[0] < digits[1]:
        return (
            "The fractions of seconds have different numbers of digits. If they count milliseconds, write three digits"
        )
    if clock.dated and 11 < hours <= 12:
        return "The clock may have 12 hours without AM and PM"
    if clock.dated and 0.4 < hours <= 1:
        return "Summer time may have ended. Then write the times in UTC"
    return "A recording may be appended, or the clock was set back"


def candidate(recording: Recording, rows: Ints, restarts: Ints, used: Sequence[Optional[int]]) -> Optional[int]:
    """The unused column that may name the experiments: it changes where the times begin again, or has such a name."""
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]

    found = []
    for c in (c for c in range(len(recording.names)) if c not in used):
        changes = np.flatnonzero(np.diff(pandas.factorize(recording.table[c].iloc[rows])[0])) + 1
        named = bool(_NAMED.match(recording.names[c].lower())) and len(changes) > 0
        found += [(not named, c)] if named or (len(restarts) and np.array_equal(changes, restarts)) else []
    return min(found)[1] if found else None


def advice(recording: Recording, column: Optional[int]) -> str:
    name = "" if column is None else recording.label(column)
    return (
        name
        and f"; column '{name}' may name the experiments: state experiment_column='{name}', or name it 'experiment'"
    )


# ---- origins ----


def _with_origin(
    recordings: Sequence[Recording], clock: Clock, found: Sequence[Experiment], remarks: list[Remark]
) -> list[Experiment]:
    """Let times count from a common origin if one clock recorded all experiments; else from their first rows."""
    own = [replace(one, own=True) for one in found]
    if any(one.own for one in found) or clock.kind == "row":
        return own
    begin = min(one.begin for one in found)
    begins = np.asarray([float(one.begin - begin) for one in found])
    ends = begins + [one.times[-1] for one in found]
    if len(recordings) > 1 and clock.dated:
        remarks.append(Remark("the time stamps count from the first row of each recording. Use a trigger if "
                              "experiments begin with an event"))
        return own
    common, shortest = float(ends.min() - begins.max()), float((ends - begins).min())
    named_k = clock.kind == "step" and len(recordings) == 1 and recordings[0].names[clock.columns[0]] == "k"
    enough = 0.5 * shortest if len(recordings) > 1 or clock.dated else 0.0
    if named_k or begins.max() == 0 or common >= enough:
        if begins.max() > 0 and not named_k:
            remarks.append(Remark("the times were read as readings of one clock, on which the experiments begin up to "
                                  f"{begins.max():g} apart"))
        return [replace(one, times=one.times + offset, begin=begin) for one, offset in zip(found, begins)]
    some = "nothing" if common < 0 else "less than half of the shortest experiment"
    remarks.append(Remark(f"the times of the experiments have {some} in common, so tokid lets each experiment begin at "
                          "its first row"))
    return own


# ---- triggers ----


def _triggered(
    recordings: Sequence[Recording], found: Sequence[Experiment], options: Options, remarks: list[Remark]
) -> list[Experiment]:
    kept, never, at_first = [], [], []
    conditions = [_condition(recording, options) for recording in recordings]
    for one in found:
        holds = conditions[one.number][one.rows]
        known = np.flatnonzero(~np.isnan(holds))
        turns = known[1:][(np.diff(holds[known]) > 0)]
        first = len(known) > 0 and holds[known[0]] == 1
        at_first += [one.name] if first else []
        if not len(turns) and not first:
            never.append(one.name)
            continue
        origin = float(one.times[turns[0] if len(turns) else known[0]])
        kept.append(replace(one, times=one.times - origin, begin=one.begin + Fraction(origin), own=True))
    start = f"trigger '{options.trigger}': this condition"
    if not kept:
        texts = recordings[0].codes(recordings[0].need(_parsed(options)[0]))[1]
        raise recordings[0].error(f"trigger '{options.trigger}': it holds at no row of any experiment. The column has "
                                  f"{quoted(texts[:5])}")
    if never:
        many = len(never) > 1
        remarks.append(Remark(f"{start} never holds in experiment{'s' if many else ''} {quoted(never)}, so "
                              f"{'they were' if many else 'this experiment was'} dropped"))
    if at_first:
        remarks.append(Remark(f"{start} already holds at the first row of {quoted(at_first[:5])}, so the event may be "
                              f"earlier. Step {options.before} is the row at which it begins to hold again, or the "
                              "first row"))
    return kept


def _parsed(options: Options) -> tuple[str, str, str]:
    name, compare, text = CONDITION.fullmatch(options.trigger).groups()  # type: ignore[union-attr]
    return name, compare, text


def _condition(recording: Recording, options: Options) -> np.ndarray[Any, Any]:
    """Whether the condition holds at each row: 1, 0, or NaN where the sample is missing."""
    name, compare, text = _parsed(options)
    column, value, word = recording.need(name), number(text), text.strip("'\"")
    if value is not None:
        values = recording.numbers(column, options.missing)
        return np.where(np.isnan(values), np.nan, _COMPARE[compare](values, value).astype(np.float64))
    if compare not in ("==", "!="):
        raise ValueError(f"trigger: '{options.trigger}' found, a number needed after {compare}")
    codes, texts = recording.codes(column)
    lost = [(is_missing(own) or own in options.missing) and own != word for own in texts]
    return np.asarray(
        [*(np.nan if gone else float(_COMPARE[compare](own, word)) for own, gone in zip(texts, lost)), np.nan]
    )[codes]
