# SPDX-License-Identifier: BSD-3-Clause
"""Arrays of the user, taken as they lie in memory or refused with the shape that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

# Read by the extension through their strides, whatever their order in memory.
_READ_IN_PLACE = frozenset("dfqlihbQLIHB")


def numbers(name: str, values: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """`values` as an array of real numbers that the extension can read, without a copy wherever there is one already.

    Raises
    ------
    ValueError
        For complex numbers, texts and objects.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)  # what is masked is missing
    try:
        array = np.asarray(values)
    except ValueError:  # lists of unequal lengths
        raise ValueError(f"{name}: lists of unequal lengths found, an array of real numbers needed") from None
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name}: an array of {array.dtype} found, real numbers needed")
    whole = all(stride % array.itemsize == 0 for stride in array.strides)  # unlike those of a field among others
    if array.dtype.char not in _READ_IN_PLACE or not (array.dtype.isnative and array.flags.aligned and whole):
        array = array.astype(np.float64)
    return array


def samples(name: str, values: Any, channels: str) -> tuple[np.ndarray[Any, np.dtype[Any]], bool]:
    """Samples as an array (N, T, channels), and whether they were (T, channels) of a single experiment."""
    array = numbers(name, values)
    if array.ndim == 2:
        return array[np.newaxis], True
    if array.ndim != 3:
        raise ValueError(
            f"{name}: shape {array.shape} found, (N, T, {channels}) needed, or (T, {channels}) for one experiment"
        )
    return array, False


def outputs_beside(values: Any, inputs: np.ndarray[Any, Any], single: bool) -> np.ndarray[Any, np.dtype[Any]]:
    """Outputs that go with inputs (N, T, r), which were (T, r) of a `single` experiment."""
    experiments, steps, r = inputs.shape
    array, alone = samples("y", values, "m")
    if alone != single or array.shape[:2] != (experiments, steps):
        wanted, beside = (f"({steps}, m)", (steps, r)) if single else (f"({experiments}, {steps}, m)", inputs.shape)
        order = _other_order(beside, np.shape(values))
        raise ValueError(f"y: shape {np.shape(values)} found, {wanted} needed beside u {beside}{order}")
    return array


def _other_order(u: Sequence[int], y: Sequence[int]) -> str:
    """What shapes that don't go together look like, if they would in another order of the axes."""
    if len(u) != len(y) or u[-1] != y[-1] or u[-1] <= max(u[-2], y[-2]):
        return ""
    looks, needed = ("(channels, T)", "(T, channels)") if len(u) == 2 else ("(N, channels, T)", "(N, T, channels)")
    return f" (both look like {looks} in place of {needed})"


def shaped(name: str, values: Any, shape: Sequence[Optional[int]], letters: str = "") -> Any:
    """An array of the given shape; None stands for any size."""
    array = numbers(name, values)
    if array.ndim != len(shape) or any(n is not None and n != found for n, found in zip(shape, array.shape)):
        words = [letter.strip() for letter in letters.split(",")] if letters else ["any"] * len(shape)
        wanted = ", ".join(word if n is None else str(n) for n, word in zip(shape, words))
        raise ValueError(f"{name}: shape {array.shape} found, ({wanted}{',' if len(shape) == 1 else ''}) needed")
    return array

