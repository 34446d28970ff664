# SPDX-License-Identifier: BSD-3-Clause
"""From the times of samples to steps of one grid."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from ._typing import Array

_EPSILON = float(np.finfo(np.float64).eps)


def text_of(number: float) -> str:
    text = repr(float(number))
    return text[:-2] if text.endswith(".0") else text


def seconds(stamps: np.ndarray[Any, Any]) -> Array:
    """Times [s] of time differences, or of dates from the first one on."""
    missing = np.isnat(stamps)
    dates = stamps.dtype.kind == "M"
    nanoseconds = stamps.astype("datetime64[ns]" if dates else "timedelta64[ns]").astype(np.int64)
    if dates and not missing.all():
        nanoseconds = nanoseconds - nanoseconds[~missing].min()
    times: Array = np.where(missing, np.nan, nanoseconds / 1e9)
    return times


def _distinct(times: Array, resolution: float) -> Array:
    """Distinct times; those closer than rounding errors make them are one."""
    times = np.unique(times)
    if len(times) < 2:
        return times
    same = max(resolution, 1e-6 * float(np.diff(times).max()))
    if np.all(np.diff(times) > same):
        return times
    kept = [times[0]]
    for time in times[1:]:
        if time - kept[-1] > same:
            kept.append(time)
    return np.asarray(kept)


def _spacing(times: Array) -> float:
    """The even spacing: the smallest distance counts the steps of the others, and the whole range refines it."""
    if len(times) < 2:
        return 1.0
    gaps = np.diff(times)
    steps = float(np.floor(gaps / gaps.min() + 0.5).sum())
    refined = float(times[-1] - times[0]) / steps
    # Of the numbers that the times allow for, the one that was meant has few digits.
    rounded = float(f"{refined:.12g}")
    uncertainty = 2 * _EPSILON * (refined + max(abs(float(times[0])), abs(float(times[-1]))) / steps)
    return rounded if abs(rounded - refined) <= uncertainty else refined


class Grid:
    def __init__(
        self, times: Array, timed: bool, dt: Optional[float], noted: Optional[float], groups: int, rounded: float
    ) -> None:
        resolution = rounded + 4 * _EPSILON * max(abs(float(times.min())), abs(float(times.max())))
        self.begin = float(times.min())
        spacing = 1.0
        self.dt_stated = dt is not None or noted is not None
        if timed:
            distinct = _distinct(times, resolution)
            found = _spacing(distinct)
            self.dt_stated = self.dt_stated or len(distinct) > 1
            # What is noted is the exact one, if it still is that of the rows.
            still = noted is not None and (len(distinct) < 2 or abs(found - noted) <= 1e-6 * noted)
            self.dt = spacing = dt if dt is not None else noted if noted is not None and still else found
        else:
            self.dt = dt if dt is not None else noted if noted is not None else 1.0
        if not 0 < self.dt < np.inf:
            raise ValueError(f"dt: {text_of(self.dt)} found, a positive time in seconds needed")
        # Columns of NumPy's own arithmetic: the error of a wild number is a message, not a warning.
        with np.errstate(all="ignore"):
            step = np.floor((times - self.begin) / spacing + 0.5)
            uneven = ~(np.abs(times - self.begin - step * spacing) <= 1e-6 * spacing + resolution)
        if timed and uneven.any():
            row = int(np.flatnonzero(uneven)[0])
            off = abs(times[row] - self.begin - step[row] * spacing)
            raise ValueError(
                f"row {row}, column 'time': {text_of(times[row])} found, {off:.4g} off the even steps of {text_of(spacing)} "
                f"from {text_of(self.begin)} on, which are needed (or step numbers in a column 'k')"
            )
        steps = float(step.max()) + 1
        # A wild time or step number would otherwise ask for more memory than the table can be worth.
        if not steps * groups <= 1e6 + 1000 * len(times):
            raise ValueError(
                f"{groups} experiments of {text_of(steps)} steps found in {len(times)} rows, fewer gaps needed"
            )
        self.steps = int(steps)
        self.step = step.astype(np.int64)
