# SPDX-License-Identifier: BSD-3-Clause
"""Iterative learning with limits of the inputs: a sparse quadratic program in inputs and states, solved by PIQP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._optional import need
from ._state_space import StateSpace
from ._typing import Array


def _at(weights: Sequence[Any], s: int) -> Any:
    return weights[0] if len(weights) == 1 else weights[s]


def _stack(sparse: Any, weights: Sequence[Any], steps: int, size: int) -> Any:
    """The weights of all steps as a block-diagonal matrix."""
    if not weights:
        return sparse.csc_matrix((steps * size, steps * size))
    return sparse.block_diag([_at(weights, s) for s in range(steps)], format="csc")


def limited_change(
    model: StateSpace,
    begin: int,
    error: Array,
    departures: Array,
    before: Array,
    limits: tuple[Array, Array],
    error_weight: Sequence[Any],
    input_weight: Sequence[Any],
    change_weight: Sequence[Any],
    rate_weight: Sequence[Any],
) -> Array:
    """Return the change (S, r) of the inputs of the steps begin ... that minimises the cost of `Model.learn`.

    error (S, m): reference minus output, NaN where it does not count. departures (S, r): inputs of the last run.
    before (r,): the input of the step before them.
    limits: smallest and largest change (S, r).
    """
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
