# SPDX-License-Identifier: BSD-3-Clause
"""Samples at any times → samples at even times, for each channel from its samples that are not missing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .recording import Ints, Options, quoted
from .words import split_unit

if TYPE_CHECKING:
    from .grid import _Run

Floats = np.ndarray[Any, Any]
_NOISE = {
    "linear": "interpolation makes the noise of neighbouring steps correlated",
    "previous": "a repeated sample has the same noise",
    "mean": "means reduce the standard deviation of the noise",
}


def resampled(
    runs: Sequence[_Run], names: Sequence[str], options: Options
) -> tuple[list[Floats], list[Ints], list[str]]:
    """The samples (T, channels) of each experiment, their steps, and remarks."""
    dt, before = float(options.resample or 1.0), options.before
    held = {split_unit(name)[0] for name in options.held} | set(options.held)
    unknown = [name for name in options.held if not {name, split_unit(name)[0]} & set(names)]
    if unknown:
        raise ValueError(f"held: column '{unknown[0]}' found, which is neither an input nor an output. Name a channel")
    methods = ["previous" if name in held else options.resample_method for name in names]
    distances = np.concatenate([np.diff(np.unique(run.times)) for run in runs])
    usual = float(np.median(distances)) if len(distances) else dt
    parts, places, changed, repeated, gone, age = [], [], [], 0, 0, 0.0
    for run in runs:
        times, slack = (
            run.times,
            1e-6 * dt + 2 * run.resolution,
        )  # a time that is late by its rounding error is on time
        first = max(int(np.ceil((times[0] - slack) / dt)), -before if options.trigger else 0)
        last = int(np.floor((times[-1] + slack) / dt))
        if last - first > 1e6 + 1000 * len(times):
            raise ValueError(f"resample: {last - first} steps of {dt:g} s found for {len(times)} rows. Check it and "
                             "the times")
        steps = np.arange(first, last + 1)
        part = np.full((len(steps), len(names)), np.nan)
        for c, method in enumerate(methods):
            known = ~np.isnan(run.values[:, c])
            limit = options.longest_gap or (np.inf if method == "previous" else 3)
            found = _channel(times[known], run.values[known, c], steps * dt, method, dt, slack, limit * max(dt, usual))
            part[:, c], old = found
            age = max(age, old)
        exact = np.round(times / dt)
        on_grid = (
            np.array_equal(exact, np.arange(exact[0], exact[0] + len(exact)))
            and np.abs(times - exact * dt).max() <= slack
        )
        changed += [] if on_grid and not np.isnan(run.values).any() else [run.one.name]
        repeated += int((np.diff(times) <= run.resolution).sum())
        gone += int(np.isnan(part).sum())
        parts.append(part)
        places.append(steps + before)
    if not changed:
        return parts, places, [f"all samples already lie at even steps of {dt:g} s, so resampling changed nothing"]
    method = "previous" if set(methods) == {"previous"} else options.resample_method
    text = f"the samples were resampled from about {usual:.4g} s to {dt:g} s by the method {method}; {_NOISE[method]}"
    if len(changed) < len(runs):
        text = f"{quoted(changed[:3])}, {len(changed)} in all: {text}. Samples of the others stay"
    repeats = [name for name, own in zip(names, methods) if own == "previous"]
    remarks = [text + (f". Held channels {quoted(repeats)} repeat samples that are up to {age:.4g} s "
                       "old" if repeats and age > slack else "")]
    if usual > 2 * dt and method != "mean":
        remarks.append(f"the samples are about {usual:.4g} s apart, so most steps of {dt:g} s have no sample of their "
                       "own")
    if repeated:
        remarks.append(f"{repeated} rows have the time of an earlier row. Their samples were replaced by their mean, "
                       "or by the last one of a held channel. Check whether experiments lie in one table")
    if gone:
        remarks.append(f"{gone} samples stay missing, because their gap is longer than the longest gap to fill, or at "
                       "an end")
    for c in (c for c, kind in enumerate(methods) if kind == "linear"):
        own = [run.values[:, c][~np.isnan(run.values[:, c])] for run in runs]
        if 0 < sum(int((np.diff(v) != 0).sum()) for v in own) <= 0.05 * sum(map(len, own)):
            remarks.append(f"channel '{names[c]}' changes at few samples, and these changes were interpolated. If it "
                           "holds its value until the next sample, state it as held (option held)")
    return parts, places, remarks


def _channel(
    times: Floats, values: Floats, at: Floats, method: str, dt: float, slack: float, limit: float
) -> tuple[Floats, float]:
    """The samples at some times, and the largest age of a repeated sample."""
    found = np.full(len(at), np.nan)
    if not len(times) or not len(at):
        return found, 0.0
    if method == "mean":
        places = np.searchsorted(times, np.append(at - dt / 2, at[-1] + dt / 2) - slack, "left")
        number = np.diff(places)
        full = number > 0
        if full.any():
            found[full] = np.add.reduceat(values[: places[-1]], places[:-1][full]) / number[full]
        return found, 0.0
    if method == "linear":
        same = np.flatnonzero(np.append(True, np.diff(times) > 0))
        times, values = times[same], np.add.reduceat(values, same) / np.diff(np.append(same, len(times)))
    before = np.searchsorted(times, at + slack, "right") - 1
    left, inside, last = np.maximum(before, 0), before >= 0, before + 1 >= len(times)
    age, right = at - times[left], np.minimum(left + 1, len(times) - 1)
    # A gap that is too long is not filled, not even at its begin.
    gap = np.where(age <= slack, 0.0, np.where(last, age, times[right] - times[left]))
    close = inside & (gap <= limit + slack)
    if method == "previous":
        found[close] = values[left[close]]
        return found, float(np.max(age, where=close, initial=0.0))
    close &= (gap == 0) | ~last
    share = np.where(gap > 0, age / np.where(gap > 0, gap, 1.0), 0.0)
    found[close] = (values[left] + share * (values[right] - values[left]))[close]
    return found, 0.0
