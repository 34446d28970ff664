# SPDX-License-Identifier: BSD-3-Clause
"""Arrays of a user: read without a copy, or rejected with the shape that is needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

# Types that the extension reads without a copy, in any order in memory.
_READ_IN_PLACE = frozenset("dfqlihbQLIHB")


def numbers(name: str, values: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """Return an array of real numbers that the extension can read, without a copy if possible.

    Raises
    ------
    ValueError
        If the values are complex numbers, texts or objects.
    """
    try:
        array = np.asarray(_unmasked(values))
    except ValueError:  # lists of unequal lengths
        raise ValueError(f"{name}: lists of unequal lengths found, an array of real numbers needed") from None
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name}: an array of {array.dtype} found, real numbers needed")
    whole = all(stride % array.itemsize == 0 for stride in array.strides)  # false for one field of a structured array
    if array.dtype.char not in _READ_IN_PLACE or not (array.dtype.isnative and array.flags.aligned and whole):
        array = array.astype(np.float64)
    return array


def _unmasked(values: Any) -> Any:
    """The values with NaN where they are masked: such samples are missing. NumPy would drop masks in lists."""
    if isinstance(values, (list, tuple)):
        return [_unmasked(value) for value in values]
    if isinstance(values, np.ma.MaskedArray):
        return np.ma.filled(values.astype(np.float64), np.nan) if values.dtype.kind in "fiub" else values.data
    return values


def samples(name: str, values: Any, channels: str) -> tuple[np.ndarray[Any, np.dtype[Any]], bool]:
    """Return samples as an array (N, T, channels), and whether they were (T, channels) of a single experiment."""
    array = numbers(name, values)
    if array.ndim == 2:
        return array[np.newaxis], True
    if array.ndim != 3:
        raise ValueError(
            f"{name}: shape {array.shape} found, (N, T, {channels}) needed, or (T, {channels}) for one experiment"
        )
    return array, False


def are_runs(values: Any) -> bool:
    """Is it a list of experiments of different lengths, or a list of masked arrays? NumPy would drop their masks."""
    if isinstance(values, np.ndarray):
        if values.dtype != object or values.ndim != 1:
            return False
    elif not isinstance(values, (list, tuple)):
        return False
    if not all(hasattr(one, "__len__") and getattr(one, "ndim", 1) > 0 for one in values):
        return False
    return len({len(one) for one in values}) > 1 or any(isinstance(one, np.ma.MaskedArray) for one in values)


def runs(name: str, values: Any, channels: str) -> list[np.ndarray[Any, np.dtype[Any]]]:
    """Return experiments of any lengths, each as an array (T, channels).

    Raises
    ------
    ValueError
        If they are not a list or an array of experiments, or have different channels. The message names the experiment.
    """
    if not are_runs(values):
        values = numbers(name, values)
        if values.ndim != 3:
            raise ValueError(f"{name}: shape {values.shape} found, a list of N experiments (T, {channels}) needed")
    result = [numbers(f"{name}[{n}]", one) for n, one in enumerate(values)]
    for n, one in enumerate(result):
        if one.ndim != 2:
            raise ValueError(
                f"{name}[{n}]: shape {one.shape} found, (T, {channels}) needed for an experiment in a list; for one "
                "channel, (T, 1)"
            )
        if one.shape[1] != result[0].shape[1]:
            raise ValueError(f"{name}[{n}]: shape {one.shape} found, (T, {result[0].shape[1]}) needed as in {name}[0]")
    return result


def outputs_beside(values: Any, inputs: np.ndarray[Any, Any], single: bool) -> np.ndarray[Any, np.dtype[Any]]:
    """Return outputs that match inputs (N, T, r). The inputs of a `single` experiment were (T, r)."""
    experiments, steps, r = inputs.shape
    array, alone = samples("y", values, "m")
    if alone != single or array.shape[:2] != (experiments, steps):
        wanted, beside = (f"({steps}, m)", (steps, r)) if single else (f"({experiments}, {steps}, m)", inputs.shape)
        order = _other_order(beside, np.shape(values))
        raise ValueError(f"y: shape {np.shape(values)} found, {wanted} needed beside u {beside}{order}")
    return array


def _other_order(u: Sequence[int], y: Sequence[int]) -> str:
    """A remark on shapes that would match in another order of the axes."""
    if len(u) != len(y) or u[-1] != y[-1] or u[-1] <= max(u[-2], y[-2]):
        return ""
    looks, needed = ("(channels, T)", "(T, channels)") if len(u) == 2 else ("(N, channels, T)", "(N, T, channels)")
    return f" (both look like {looks} in place of {needed})"


def shaped(name: str, values: Any, shape: Sequence[Optional[int]], letters: str = "") -> Any:
    """Return an array of the given shape. None stands for any size, which messages call by its letter."""
    array = numbers(name, values)
    if array.ndim != len(shape) or any(n is not None and n != found for n, found in zip(shape, array.shape)):
        words = [letter.strip() for letter in letters.split(",")] if letters else ["any"] * len(shape)
        wanted = ", ".join(word if n is None else str(n) for n, word in zip(shape, words))
        raise ValueError(f"{name}: shape {array.shape} found, ({wanted}{',' if len(shape) == 1 else ''}) needed")
    return array


def states(name: str, values: Any, experiments: int, size: int) -> Any:
    """Return states (size, N) of the experiments, from (N, size), or from (size,) or (1, size) for all of them."""
    array = numbers(name, values)
    if array.ndim == 1 or (array.ndim == 2 and len(array) == 1):
        array = np.broadcast_to(array, (experiments, array.shape[-1]))
    return shaped(name, array, (experiments, size)).T


def limits(name: str, values: Any, shape: tuple[int, ...]) -> Any:
    """Return limits of inputs (r,) or (T, r), from those or from a number for all."""
    array = numbers(name, values)
    try:
        return np.array(np.broadcast_to(array, shape), dtype=np.float64)
    except ValueError:
        shapes = f"({shape[-1]},)" if len(shape) == 1 else f"({shape[-1]},) or {shape}"
        raise ValueError(f"{name}: shape {array.shape} found, a number, {shapes} needed") from None


def weights(name: str, value: Any, size: int) -> list[Any]:
    """Return weights as matrices: none, one for all steps, or one for each step.

    A number stands for a multiple of the identity, `size` numbers for a diagonal.
    """
    if value is None:
        return []
    array = numbers(name, value).astype(np.float64)
    if array.ndim == 0:
        return [array * np.eye(size)]
    if array.shape == (size,):
        return [np.diag(array)]
    if array.ndim == 2:
        return [shaped(name, array, (size, size))]
    if array.ndim == 3:
        return list(shaped(name, array, (None, size, size), "S, m, m"))
    raise ValueError(
        f"{name}: shape {array.shape} found, a number, ({size},), ({size}, {size}) or (S, {size}, {size}) needed"
    )
