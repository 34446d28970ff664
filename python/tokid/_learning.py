# SPDX-License-Identifier: BSD-3-Clause
"""Iterative learning control, and the lifted map of a model."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._state_space import StateSpace
from ._typing import Array, ArrayLike
from ._weights import weights
from .results import LearnedRun


class LiftedMap:
    """The map from inputs to outputs of the steps begin ... begin+S-1 of a model, from rest, as an operator.

    Inputs and outputs are departures from the nominal trajectory. Products take O(S). `Model.lifted_map` makes it.
    `shape`, `dtype`, `matvec` and `rmatvec` are those of a `scipy.sparse.linalg.LinearOperator`; vectors have the
    channels of one step side by side.
    """

    __slots__ = ("_core", "__weakref__")
    _core: _tokid.LiftedMap

    dtype = np.dtype(np.float64)

    def __init__(self) -> None:
        raise TypeError("lifted maps come from tokid.Model.lifted_map")

    @classmethod
    def _of(cls, model: StateSpace, begin: Optional[int], end: Optional[int]) -> LiftedMap:
        self = cls.__new__(cls)
        self._core = _tokid.LiftedMap(model._core, _options.step("begin", begin), _options.step("end", end))
        return self

    @property
    def begin(self) -> int:
        """First step."""
        return self._core.begin

    @property
    def steps(self) -> int:
        """Number of steps S."""
        return self._core.steps

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (S m, S r) of the matrix."""
        core = self._core
        return core.steps * core.outputs, core.steps * core.inputs

    def product(self, u: ArrayLike) -> Array:
        """Return the outputs (S, m) to the inputs (S, r)."""
        return self._core.product(_arrays.shaped("u", u, (self.steps, self._core.inputs)))

    def transposed_product(self, y: ArrayLike) -> Array:
        """Return the product (S, r) of the transposed map with (S, m)."""
        return self._core.transposed_product(_arrays.shaped("y", y, (self.steps, self._core.outputs)))

    def dense(self) -> Array:
        """Return the matrix (S m, S r), which has O(S^2) numbers."""
        return self._core.dense()

    def matvec(self, u: ArrayLike) -> Array:
        """Return the product with a vector (S r,)."""
        return np.asarray(self.product(np.reshape(u, (self.steps, -1)))).ravel()

    def rmatvec(self, y: ArrayLike) -> Array:
        """Return the product of the transposed map with a vector (S m,)."""
        return np.asarray(self.transposed_product(np.reshape(y, (self.steps, -1)))).ravel()

    def __repr__(self) -> str:
        return f"<tokid.LiftedMap: steps {self.begin} to {self.begin + self.steps - 1}, shape {self.shape}>"


def learn(
    model: StateSpace,
    reference: ArrayLike,
    u: ArrayLike,
    y: ArrayLike,
    error_weight: ArrayLike,
    input_weight: Optional[ArrayLike],
    input_change_weight: Optional[ArrayLike],
    input_rate_weight: Optional[ArrayLike],
) -> LearnedRun:
    """See `Model.learn`."""
    wanted: Any = _arrays.shaped("reference", reference, (None, model.outputs), "T, m")
    steps = len(wanted)
    found = _tokid.learn(
        model._core,
        wanted,
        _arrays.shaped("u", u, (steps, model.inputs)),
        _arrays.shaped("y", y, (steps, model.outputs)),
        weights("error_weight", error_weight, model.outputs),
        weights("input_weight", input_weight, model.inputs),
        weights("input_change_weight", input_change_weight, model.inputs),
        weights("input_rate_weight", input_rate_weight, model.inputs),
    )
    return LearnedRun(*found)
