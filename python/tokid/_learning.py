# SPDX-License-Identifier: BSD-3-Clause
"""Iterative learning control, and the lifted map of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._held import Held
from ._optional import need
from ._state_space import StateSpace
from ._typing import Array, ArrayLike
from .results import LearnedRun


class LiftedMap:
    """The map from inputs to outputs of the steps begin ... begin+S-1 of a model, from rest, as an operator.

    Inputs and outputs are departures from the nominal trajectory. Products take O(S). `Model.lifted_map` makes it.
    `shape`, `dtype`, `matvec` and `rmatvec` are those of a `scipy.sparse.linalg.LinearOperator`; vectors have the
    channels of one step side by side.
    """

    __slots__ = ("_core", "_model", "__weakref__")
    _core: _tokid.LiftedMap
    _model: StateSpace

    dtype = np.dtype(np.float64)

    def __init__(self) -> None:
        raise TypeError("lifted maps come from tokid.Model.lifted_map")

    @classmethod
    def _of(cls, model: StateSpace, begin: Optional[int], end: Optional[int]) -> LiftedMap:
        self = cls.__new__(cls)
        self._model = model
        self._core = _tokid.LiftedMap(model._core, _options.step("begin", begin), _options.step("end", end))
        return self

    begin = Held[int]("First step.")
    steps = Held[int]("Number of steps S.")

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

    def __reduce__(self) -> tuple[Any, ...]:
        return LiftedMap._of, (self._model, self.begin, self.begin + self.steps)

    def __repr__(self) -> str:
        return f"<tokid.LiftedMap: steps {self.begin} to {self.begin + self.steps - 1}, shape {self.shape}>"


def learn(
    model: StateSpace,
    reference: ArrayLike,
    u: ArrayLike,
    y: ArrayLike,
    costs: list[list[Any]],
    u_min: Optional[ArrayLike],
    u_max: Optional[ArrayLike],
) -> LearnedRun:
    """See `Model.learn`. costs: the weights of error, inputs, their change from the last run, and from step to step."""
    wanted: Any = _arrays.shaped("reference", reference, (None, model.outputs), "T, m")
    steps = len(wanted)
    last = [_arrays.shaped("u", u, (steps, model.inputs)), _arrays.shaped("y", y, (steps, model.outputs))]
    found: LearnedRun = _tokid.learn(model._core, wanted, *last, *costs)
    limits = [
        _arrays.limits("u_min", -np.inf if u_min is None else u_min, last[0].shape),
        _arrays.limits("u_max", np.inf if u_max is None else u_max, last[0].shape),
    ]
    for name, limit, never in zip(("u_min", "u_max"), limits, (np.inf, -np.inf)):
        if np.any(np.isnan(limit)):
            raise ValueError(f"{name}: NaN found, numbers needed")
        if np.any(limit == never):
            raise ValueError(f"{name}: {never} found, which no input satisfies, numbers needed")
    if np.any(limits[0] > limits[1]):
        raise ValueError("u_min: a limit above u_max found, limits up to u_max needed")
    part = slice(model.k_begin, steps if model.period else min(steps, model.k_end))  # steps with a model
    if np.all(found.u[part] >= limits[0][part]) and np.all(found.u[part] <= limits[1][part]):
        return found

    # The inputs exceed the limits.
    before, measured = (np.array(values, dtype=np.float64) for values in last)
    count = part.stop - part.start
    nominal = np.zeros((part.stop, model.inputs))
    known = np.asarray(model._core.continued(part.stop).u_nominal)[: part.stop]
    if known.size:
        nominal[: len(known)] = known
    change = _limited_change(
        model,
        part.start,
        (wanted - measured)[part],
        before[part] - nominal[part],
        before[part.start - 1] - nominal[part.start - 1] if part.start > 0 else np.zeros(model.inputs),
        (limits[0][part] - before[part], limits[1][part] - before[part]),
        costs,
    )
    following, predicted = before.copy(), measured.copy()
    following[part] = np.clip(before[part] + change, limits[0][part], limits[1][part])
    lifted = LiftedMap._of(model, part.start, part.start + count)
    predicted[part] += lifted.product(following[part] - before[part])
    return LearnedRun(following, predicted, _rms(wanted - measured), _rms(wanted - predicted))


def _rms(error: Any) -> Array:
    known = ~np.isnan(error)
    squares = np.where(known, np.nan_to_num(error) ** 2, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares / known.sum(axis=0)))


def _at(weights: Sequence[Any], s: int) -> Any:
    return weights[0] if len(weights) == 1 else weights[s]


def _stack(sparse: Any, weights: Sequence[Any], steps: int, size: int) -> Any:
    """The weights of all steps as a block-diagonal matrix."""
    if not weights:
        return sparse.csc_matrix((steps * size, steps * size))
    return sparse.block_diag([_at(weights, s) for s in range(steps)], format="csc")


def _limited_change(
    model: StateSpace,
    begin: int,
    error: Array,
    departures: Array,
    before: Array,
    limits: tuple[Array, Array],
    costs: list[list[Any]],
) -> Array:
    """Solve a sparse quadratic program in inputs and states by PIQP.

    Return the change (S, r) of the inputs of the steps begin ... that minimises the cost of `Model.learn`.

    error (S, m): reference minus output, NaN where it does not count. departures (S, r): inputs of the last run.
    before (r,): the input of the step before them.
    limits: smallest and largest change (S, r).
    """
    error_weight, input_weight, change_weight, rate_weight = costs
    piqp = need("piqp", "learn with limits of the inputs", "tokid[limits]")
    sparse = need("scipy.sparse", "learn with limits of the inputs", "tokid[limits]")
    steps, r = departures.shape
    core = model._core.continued(begin + steps)
    a, b, c, d = ([core.matrix(name, s) for s in range(steps)] for name in "ABCD")
    sizes = [matrix.shape[0] for matrix in a]  # of the states after each step
    inputs, states = steps * r, sum(sizes)

    # The variables are all changes of inputs, then the states x[begin+1] ... The first state does not change.
    after = sparse.block_diag(b, format="csc"), sparse.identity(states, format="lil")
    outputs = sparse.lil_matrix((error.size, states))
    row, column = sizes[0], 0
    for s in range(1, steps):
        width, height = a[s].shape[1], a[s].shape[0]
        after[1][row : row + height, column : column + width] = -a[s]
        outputs[s * error.shape[1] : (s + 1) * error.shape[1], column : column + width] = c[s]
        row, column = row + height, column + width
    dynamics = sparse.hstack([-after[0], after[1]], format="csc")
    response = sparse.hstack([sparse.block_diag(d, format="csc"), outputs], format="csc")

    counted = sparse.diags((~np.isnan(error)).astype(float).ravel())
    q = counted @ _stack(sparse, error_weight, steps, error.shape[1]) @ counted
    difference = sparse.identity(inputs) - sparse.eye(inputs, k=-r)
    own = _stack(sparse, input_weight, steps, r)
    own = own + difference.T @ _stack(sparse, rate_weight, steps, r) @ difference
    squares = response.T @ q @ response + sparse.block_diag(
        [own + _stack(sparse, change_weight, steps, r), sparse.csc_matrix((states, states))]
    )
    gradient = -(response.T @ (q @ np.nan_to_num(error).ravel()))
    gradient[:inputs] += own @ departures.ravel()
    if rate_weight:
        gradient[:r] -= _at(rate_weight, 0) @ before

    scale = float(abs(squares).max())
    free = np.full(states, np.inf)
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
    solver.setup(
        sparse.csc_matrix(squares / scale),
        gradient / scale,
        sparse.csc_matrix(dynamics),
        np.zeros(states),
        x_l=np.concatenate([limits[0].ravel(), -free]),
        x_u=np.concatenate([limits[1].ravel(), free]),
    )
    status = solver.solve()
    if status != piqp.PIQP_SOLVED:
        raise RuntimeError(f"learn: the quadratic program was not solved: {status}. Use larger weights on inputs")
    change: Array = np.clip(np.reshape(solver.result.x[:inputs], (steps, r)), *limits)
    return change
