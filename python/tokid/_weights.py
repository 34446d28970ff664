# SPDX-License-Identifier: BSD-3-Clause
"""Weights of a quadratic cost: numbers, diagonals, matrices or stacks of matrices."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from . import _arrays
from ._typing import ArrayLike


def weights(name: str, value: Optional[ArrayLike], size: int) -> list[Any]:
    """Return weights as matrices: none, one for all steps, or one for each step.

    A number stands for a multiple of the identity, `size` numbers for a diagonal.
    """
    if value is None:
        return []
    array = _arrays.numbers(name, value).astype(np.float64)
    if array.ndim == 0:
        return [array * np.eye(size)]
    if array.shape == (size,):
        return [np.diag(array)]
    if array.ndim == 2:
        return [_arrays.shaped(name, array, (size, size))]
    if array.ndim == 3:
        return list(_arrays.shaped(name, array, (None, size, size), "S, m, m"))
    raise ValueError(
        f"{name}: shape {array.shape} found, a number, ({size},), ({size}, {size}) or (S, {size}, {size}) needed"
    )
