# SPDX-License-Identifier: BSD-3-Clause
"""Experiments → the steps of one common grid: even times found, or a stated sample time, or samples resampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NoReturn, Optional

import numpy as np

from .channels import Columns
from .cut import Experiment, advice, candidate
from .recording import Ints, Options, Recording, quoted
from .resample import resampled

Floats = np.ndarray[Any, Any]
_EPSILON = float(np.finfo(np.float64).eps)
_EVEN = 1e-6  # the largest deviation of even times, as a share of a step


@dataclass(frozen=True)
class Grid:
    """Samples (N, T, channels) at even steps. `length` is None if the ends of the experiments are not known."""

    samples: Floats
    dt: float
    dt_stated: bool
    length: Optional[list[int]]
    remarks: Sequence[str]


@dataclass(frozen=True)
class _Run:
    """An experiment with its samples, and the uncertainty of its times [s] as numbers."""

    one: Experiment
    times: Floats
    values: Floats
    resolution: float


def grid(
    recordings: Sequence[Recording], columns: Columns, experiments: Sequence[Experiment], options: Options
) -> Grid:
    """Bring the samples of all experiments to the steps of one grid."""
    values = [np.column_stack([own.numbers(c, options.missing) for c in of]) for own, of in zip(recordings, columns.of)]
    runs = [_Run(one, one.times, values[one.number][one.rows], _resolution(one)) for one in experiments]
    kind, before, remarks = experiments[0].clock.kind, options.before, list[str]()
    noted = _noted(recordings)
    dt, stated = options.dt or noted or 1.0, bool(options.dt or noted or options.resample)
    if options.resample is not None:
        if kind != "time":
            raise recordings[0].error("resample: no column of times found. State the column (option time)")
        parts, places, remarks = resampled(runs, [*columns.inputs, *columns.outputs], options)
        dt = options.resample
    else:
        if kind == "time":
            dt, places, remarks, timed = _even(runs, options, dt)
            stated = stated or timed
        else:
            places = [run.times.astype(np.int64) for run in runs]
            if kind == "row" and not stated:
                remarks = ["no column of times or step numbers found: the rows of an experiment were taken as "
                           "successive steps. If a column has them, name it 'time' or 'k'"]
        kept = [place >= -before if options.trigger else place >= 0 for place in places]
        parts = [run.values if keep.all() else run.values[keep] for run, keep in zip(runs, kept)]
        places = [place[keep] + before for place, keep in zip(places, kept)]
        for run, place, keep in zip(runs, places, kept):
            _once(columns, run.one, place, keep, len(runs) > 1)
    lengths = [int(place.max(initial=-1)) + 1 for place in places]
    rows, spans = sum(map(len, places)), sum(int(place.max() - place.min()) + 1 for place in places if len(place))
    if max(lengths) * len(runs) > 1e6 + 1000 * rows:
        raise recordings[0].error(f"{len(runs)} experiments of {max(lengths)} steps found in only {rows} rows. Check "
                                  "the times")
    if kind == "time" and 5 * (spans - rows) > spans:
        remarks.append(f"{spans - rows} of {spans} steps have no row. If times are rounded, leave out their column and "
                       "state dt")
    samples = np.full((len(runs), max(lengths), len(columns.of[0])), np.nan)
    for n, (place, part) in enumerate(zip(places, parts)):
        samples[n, place] = part
    ends = options.trigger or options.resample or (kind != "row" and any(one.own for one in experiments))
    remarks = [*_told_words(recordings, columns, options), *remarks, *_odd(experiments, lengths)]
    return Grid(samples, dt, stated, lengths if len(recordings) > 1 or ends else None, remarks)


def _told_words(recordings: Sequence[Recording], columns: Columns, options: Options) -> list[str]:
    """Remarks on words for missing samples and on switches."""
    found = [(own, c, *own.words(c)) for own, of in zip(recordings, columns.of) for c in of]
    told = [(own, c, words, rows) for own, c, words, rows, _ in found if len(set(words) - set(options.missing))]
    remarks = []
    if told:
        own, c, _, rows = told[0]
        count, words = sum(len(rows) for *_, rows in told), sorted({word for _, _, words, _ in told for word in words})
        remarks.append(f"{count} cell{'s' if count > 1 else ''} with {quoted(words)} {'were' if count > 1 else 'was'} "
                       f"read as missing samples. The first one is at {own.at(int(rows[0]), c)}")
    if any(switches for *_, switches in found):
        remarks.append("cells with on and true were read as 1, and cells with off and false as 0")
    unseen = [
        word
        for word in options.missing
        if not any(own.has(c, word) for own, of in zip(recordings, columns.of) for c in of)
    ]
    return remarks + [f"missing={word!r}: no cell of a channel has this word. Check its spelling and decimal "
                      "mark" for word in unseen]


def _noted(recordings: Sequence[Recording]) -> Optional[float]:
    noted = list(dict.fromkeys(float(own.notes["dt"]) for own in recordings if own.notes.get("dt") is not None))
    if len(noted) > 1 or (noted and not noted[0] > 0):
        raise recordings[0].error(f"dt: {noted} found in the notes of the tables, one positive number needed")
    return noted[0] if noted else None


def _odd(experiments: Sequence[Experiment], lengths: Sequence[int]) -> list[str]:
    """A remark on experiments that are much longer than most."""
    usual = float(np.median(lengths))
    long = [n for n, length in enumerate(lengths) if length > 4 * usual and len(lengths) > 2]
    return [f"experiment '{experiments[n].name}' has {lengths[n]} steps, but the median is {usual:g}. Too few "
            "experiments have samples at its late steps. Leave it out, or cut it "
            "(Ensemble.stretch)" for n in long[:3]]  # fmt: skip


def _once(columns: Columns, one: Experiment, place: Ints, keep: Ints, several: bool) -> None:
    """Refuse two rows for one step."""
    order = np.argsort(place, kind="stable")
    twice = order[1:][np.diff(place[order]) == 0]
    if len(twice):
        again, used = int(twice.min()), [*columns.of[one.number], *one.clock.columns]
        hint = advice(one.recording, candidate(one.recording, np.sort(one.rows), np.zeros(0), used))
        of = f" of experiment '{one.name}'" if several else ""
        text = f"a second row for step {place[again]}{of} found, one needed{hint}"
        raise one.recording.error(text, one.rows[keep][again])


# ---- even times ----


def _resolution(one: Experiment) -> float:
    """The uncertainty of times [s] as numbers."""
    clock = one.clock
    if clock.ticks.dtype.kind in "iu":
        return 4 * _EPSILON * float(np.abs(one.times).max(initial=0.0)) + (1e-9 if clock.dated else 0.0)
    return 0.5 * _EPSILON * float(np.abs(clock.ticks).max(initial=0.0)) * clock.unit[0] / clock.unit[1]


def _rounding(one: Experiment) -> Floats:
    """The uncertainty of times [s] because of their printed digits."""
    ticks, scale = one.clock.ticks[one.rows], one.clock.unit[0] / one.clock.unit[1]
    if ticks.dtype.kind in "iu":
        power = next((p for p in range(18, -1, -1) if not (ticks % 10**p).any()), 0) if ticks.any() else 0
        return np.full(len(ticks), 0.5 * scale * 10**power)
    size, rounding = np.abs(ticks), np.zeros(len(ticks))
    # Numbers are rounded to decimals, or to digits by %g, or to single precision.
    decimals = next((n for n in range(11) if _whole(size * 10.0**n)), None)
    unit = 10.0 ** (np.floor(np.log10(np.where(size > 0, size, 1e-9))) + 1)
    digits = next((n for n in range(3, 10) if _whole(size / unit * 10.0**n)), None)
    if decimals is None and digits is None and np.array_equal(size, size.astype(np.float32).astype(np.float64)):
        rounding = size * 2.0**-24
    rounding = rounding if decimals is None else rounding + 0.5 * 10.0**-decimals
    rounding = rounding if digits is None else np.maximum(rounding, 0.5 * unit * 10.0**-digits)
    return np.asarray(rounding * scale)


def _whole(values: Floats) -> bool:
    return bool(np.all(np.abs(values - np.round(values)) <= 8 * _EPSILON * np.maximum(values, 1)))


def _even(runs: Sequence[_Run], options: Options, noted: float) -> tuple[float, list[Ints], list[str], bool]:
    """The sample time, the steps of all rows, remarks, and whether the times state the sample time."""
    gaps = np.concatenate([np.diff(run.times) for run in runs])
    gaps = gaps[gaps > 2 * max(run.resolution for run in runs)]
    if not len(gaps) and any(len(run.times) > 1 for run in runs):
        runs[0].one.refuse("is the time of all rows. Write times with more digits, or leave out their column and "
                           "state dt", 0)
    if not len(gaps):
        return noted, [np.zeros(len(run.times), dtype=np.int64) for run in runs], [], False
    if options.dt is not None:
        return (options.dt, *_moved(runs, options.dt), True)
    slack = [np.full(len(run.times), 0.5 * _EVEN * float(gaps.min()) + run.resolution) for run in runs]
    dt, places = _fitted(runs, slack)
    remarks = list[str]()
    if places is None and sum(map(len, slack)) >= 8:
        rounding = [_rounding(run.one) for run in runs]
        dt, places = _fitted(runs, [own + more * (1 + 1e-9) for own, more in zip(slack, rounding)])
        coarsest = 2 * max(float(own.max()) for own in rounding)
        if 3 * coarsest > dt * (1 + 1e-6):  # too coarse to count the steps
            places = None
        remarks = [f"the times are rounded to {coarsest:.3g} s. They were read as even steps of {dt:.10g} s"]
    if places is None:
        _refuse(runs, dt)
    sizes = [int(np.gcd.reduce(np.diff(place))) if len(place) > 1 else 0 for place in places]
    odd = next((n for n, size in enumerate(sizes) if size > 1 and 1 in sizes and len(places[n]) > 4), None)
    if odd is not None:
        text = f"steps of {sizes[odd] * dt:g} s found in experiment '{runs[odd].one.name}', but of {dt:g} s in others"
        raise runs[odd].one.recording.error(f"{text}; resample to even times (option resample), or state dt")
    for recording in (run.one.recording for run in runs):
        stated = float(recording.notes.get("dt") or dt)
        if abs(stated - dt) > 1e-6 * dt and recording.counted == "line":
            raise recording.error(f"'# dt = {stated:g}' found, but the times have steps of {dt:g} s. Correct it")
        dt = stated if abs(stated - dt) <= 1e-6 * dt else dt
    return dt, places, remarks, True


def _fitted(runs: Sequence[_Run], slacks: Sequence[Floats]) -> tuple[float, Optional[list[Ints]]]:
    """The even spacing of times with these uncertainties, and the steps of the rows; None where they are uneven.

    Two times that are n steps apart bound the spacing from both sides. Near times tell n, far times give narrow bounds.
    """
    low, high = _shortest(runs, slacks)
    lag, longest = 1, max(map(len, slacks))
    pairs = [(run.times, slack) for run, slack in zip(runs, slacks)]
    different = {(times.tobytes(), slack.tobytes()): (times, slack) for times, slack in pairs}.values()
    while lag < longest and 0 < low <= high:
        for times, slack in different:
            apart, off = times[lag:] - times[:-lag], slack[lag:] + slack[:-lag]
            fewest, most = np.ceil((apart - off) / high - 1e-9), np.floor((apart + off) / low + 1e-9)
            sure = (fewest == most) & (fewest > 0)
            if (fewest > most).any():
                return low, None
            if sure.any():
                low = max(low, float(((apart - off)[sure] / fewest[sure]).max()))
                high = min(high, float(((apart + off)[sure] / fewest[sure]).min()))
        lag *= 2 if max(float(slack.max()) for slack in slacks) > 0.01 * low else 16
    if not 0 < low <= high * (1 + 1e-12):
        return max(low, high), None
    dt = _roundest(low, high)
    placed = [_placed(run.one, dt, slack) for run, slack in zip(runs, slacks)]
    found = [place for place in placed if place is not None]
    return dt, found if len(found) == len(placed) else None


def _shortest(runs: Sequence[_Run], slacks: Sequence[Floats]) -> tuple[float, float]:
    """Bounds of the spacing from the longest run of gaps that are as short as the shortest one, within uncertainty."""
    pairs = [(np.diff(run.times), slack[1:] + slack[:-1]) for run, slack in zip(runs, slacks) if len(slack) > 1]
    shortest = min(float((gaps + 2 * off).min()) for gaps, off in pairs)
    count, span, uncertain = 0, 0.0, 0.0
    for gaps, off in pairs:
        ends = np.flatnonzero(np.append(gaps > shortest, True))
        begins = np.append(0, ends[:-1] + 1)
        longest = int(np.argmax(ends - begins))
        first, last = int(begins[longest]), int(ends[longest])
        if last - first > count:
            count, span, uncertain = last - first, float(gaps[first:last].sum()), float(off[first] + off[last - 1])
    return (span - uncertain) / count, (span + uncertain) / count


def _roundest(low: float, high: float) -> float:
    """The number with the fewest digits between two bounds; its reciprocal, a frequency, may have them instead."""
    middle = (low + high) / 2
    values = [v for n in range(1, 16) for v in (float(f"{middle:.{n}g}"), 1 / float(f"{1 / middle:.{n}g}"))]
    return next((value for value in values if low <= value <= high), middle)


def _placed(one: Experiment, dt: float, tolerance: Floats) -> Optional[Ints]:
    """The steps of the rows, or None if a time is not on the grid, which begins at the first time."""
    base = one.times[0] if one.own else 0.0
    steps = np.round((one.times - base) / dt)
    off = one.times - base - steps * dt
    low, high = float((off - tolerance).max()), float((off + tolerance).min())
    if low > high or (not one.own and abs(low + high) > 4 * tolerance.max()):
        return None
    return np.asarray(steps + round(float(base) / dt), dtype=np.int64)  # after a trigger, another row is step 0


def _moved(runs: Sequence[_Run], dt: float) -> tuple[list[Ints], list[str]]:
    """The nearest steps of a stated sample time. Times may be off by a tenth of a step."""
    places, largest = [], 0.0
    rough = [run.times - np.round(run.times / dt) * dt for run in runs]
    for run, mine in zip(runs, rough):
        offs = np.concatenate([mine] if run.one.own else rough)
        phase = (offs.max() + offs.min()) / 2  # the first time may be off, too
        steps = np.round((run.times - phase) / dt)
        off = run.times - steps * dt
        if np.abs(off - phase).max() > 0.1 * dt:
            text = f"lies more than a tenth of a step beside the even steps of {dt:g} s"
            worst = int(np.argmax(np.abs(off - np.median(off))))
            run.one.refuse(f"{text}. Correct dt, or resample to even times (option resample)", worst)
        largest = max(largest, float(np.abs(off - phase).max()))
        places.append(steps.astype(np.int64))
    whole = np.gcd.reduce(np.concatenate([np.diff(place) for place in places]))
    if whole > 1:
        raise runs[0].one.recording.error(f"'dt = {dt:g}' found, but all rows lie at multiples of {whole * dt:g} s")
    text = f"times were moved by up to {largest:.3g} s to even steps of {dt:g} s, as the option dt states"
    return places, [text] if largest > _EVEN * dt else []


def _refuse(runs: Sequence[_Run], dt: float) -> NoReturn:
    """Name the first time that is not on the grid."""
    gaps = np.concatenate([np.diff(run.times) for run in runs])
    usual = float(np.median(gaps)) or float(gaps.max())
    even = next((own for own in (float(f"{usual:.{n}g}") for n in (1, 2)) if abs(own - usual) < 0.02 * usual), usual)
    for run in runs:
        same = np.flatnonzero(np.diff(run.times) <= 2 * run.resolution)
        if len(same):
            text = "is the time of a second row, one row needed. If times have too few digits, leave out their column"
            run.one.refuse(f"{text} and state dt; or resample to even times (option resample)", same[0] + 1)
        off = np.abs(run.times - run.times[0] - np.round((run.times - run.times[0]) / even) * even)
        wrong = off > _EVEN * even + 2 * run.resolution
        if wrong.any():
            move = f"move the times to even steps of {even:g} s (option dt), " if off.max() <= 0.1 * even else ""
            text = f"differs by {off[wrong][0]:.4g} s from even steps of {even:g} s; {move}resample to even times"
            run.one.refuse(f"{text} (option resample), or number the steps in a column 'k'", int(np.argmax(wrong)))
    text = f"the experiments have times on different grids of {dt:g} s; resample to even times (option resample)"
    raise runs[0].one.recording.error(text)
