# SPDX-License-Identifier: BSD-3-Clause
"""Times of samples → steps of one grid."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from ._typing import Array

_EPSILON = float(np.finfo(np.float64).eps)


def text_of(number: float) -> str:
    text = repr(float(number))
    return text[:-2] if text.endswith(".0") else text


def seconds(stamps: np.ndarray[Any, Any]) -> Array:
    """Time differences in seconds, or dates in seconds after the first one."""
    missing = np.isnat(stamps)
    dates = stamps.dtype.kind == "M"
    nanoseconds = stamps.astype("datetime64[ns]" if dates else "timedelta64[ns]").astype(np.int64)
    if dates and not missing.all():
        nanoseconds = nanoseconds - nanoseconds[~missing].min()
    times: Array = np.where(missing, np.nan, nanoseconds / 1e9)
    return times


def _distinct(times: Array, resolution: float) -> Array:
    """The distinct times. Times that differ by rounding errors are one."""
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
    """The even spacing. The smallest distance gives the number of steps, and the whole range the exact spacing."""
    if len(times) < 2:
        return 1.0
    gaps = np.diff(times)
    smallest = float(gaps.min())
    steps = float(np.floor(gaps / smallest + 0.5).sum())
    refined = float(times[-1] - times[0]) / steps
    # Many numbers are within the uncertainty. The intended one has few digits, in itself or in its frequency.
    uncertainty = (4 * _EPSILON * max(abs(float(times[0])), abs(float(times[-1]))) + 1e-8 * smallest) / steps
    for digits in range(1, 16):
        for meant in (float(f"{refined:.{digits}g}"), 1 / float(f"{1 / refined:.{digits}g}")):
            if abs(meant - refined) <= uncertainty:
                return meant
    return refined


class Grid:
    """The even grid of some times.

    Parameters
    ----------
    times : ndarray
        Times [s] of all samples, or their step numbers.
    timed : bool
        Whether they are times.
    dt, noted : float or None
        Sample time [s] from the user, and from the data.
    groups : int
        Number of experiments.
    rounding : float
        Resolution of the times [s].

    Attributes
    ----------
    dt, begin : float
        Sample time and first time [s].
    dt_stated : bool
        Whether the user or the data state the sample time.
    step : ndarray of int
        Step of each sample, from 0.
    steps : int
        Number of steps T.
    gapless : bool
        Whether the samples have the steps 0, 1, …, T-1 in this order.
    """

    def __init__(
        self, times: Array, timed: bool, dt: Optional[float], noted: Optional[float], groups: int, rounding: float
    ) -> None:
        resolution = rounding + 4 * _EPSILON * max(abs(float(times.min())), abs(float(times.max())))
        self.begin = float(times.min())
        spacing = 1.0
        self.dt_stated = dt is not None or noted is not None
        if timed:
            distinct = _distinct(times, resolution)
            found = _spacing(distinct)
            self.dt_stated = self.dt_stated or len(distinct) > 1
            # The sample time in the notes is exact, but the rows may have changed after it was noted.
            if noted is not None and len(distinct) > 1 and not abs(found - noted) <= 1e-6 * noted:
                noted = None
            self.dt = spacing = dt if dt is not None else noted if noted is not None else found
        else:
            self.dt = dt if dt is not None else noted if noted is not None else 1.0
        if not 0 < self.dt < np.inf:
            raise ValueError(f"dt: {text_of(self.dt)} found, a positive time in seconds needed")
        # A time of extreme size causes an error message below, not a warning of NumPy.
        with np.errstate(all="ignore"):
            step = np.floor((times - self.begin) / spacing + 0.5)
            uneven = ~(np.abs(times - self.begin - step * spacing) <= 1e-6 * spacing + resolution)
        if timed and uneven.any():
            row = int(np.flatnonzero(uneven)[0])
            off = abs(times[row] - self.begin - step[row] * spacing)
            raise ValueError(
                f"row {row}, column 'time': {text_of(times[row])} found, which differs by {off:.4g} from even steps of "
                f"{text_of(spacing)} that begin at {text_of(self.begin)}; resample to even times (option resample), "
                f"or number the steps in a column 'k'"
            )
        steps = float(step.max()) + 1
        # A single wrong time or step number must not require a huge grid.
        if not steps * groups <= 1e6 + 1000 * len(times):
            raise ValueError(
                f"{groups} experiments of {text_of(steps)} steps found in only {len(times)} rows, so most "
                f"rows would be missing. Check the times or step numbers"
            )
        self.steps = int(steps)
        self.step = step.astype(np.int64)
        self.gapless = np.array_equal(self.step, np.arange(self.steps))  # one time for each step, in this order
