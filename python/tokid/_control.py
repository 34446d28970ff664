# SPDX-License-Identifier: BSD-3-Clause
"""Steps of a model → state-space objects of python-control and SciPy."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from ._optional import need
from ._state_space import StateSpace
from ._typing import Array


def _square_step(model: StateSpace, k: Optional[int], pad: bool) -> tuple[int, list[Array]]:
    """Return a step and its matrices A, B, C, D, with equal state dimensions before and after the step."""
    if k is None:
        stacks = (np.asarray(matrices) for matrices in (model.A, model.B, model.C, model.D))
        dims = model.state_dim
        if model.period != 1 and not (
            np.all(dims == dims[0]) and all(np.array_equal(s, np.broadcast_to(s[0], s.shape)) for s in stacks)
        ):
            raise ValueError(
                f"k: none found, a step from {model.k_begin} to {model.k_end - 1} needed: the model varies with time"
            )
        k = model.k_begin
    step = model.at(k)
    a, b, c, d = (np.array(matrix) for matrix in (step.A, step.B, step.C, step.D))
    after, before = a.shape
    if pad:
        n = model.states
        a = np.pad(a, ((0, n - after), (0, n - before)))
        b, c = np.pad(b, ((0, n - after), (0, 0))), np.pad(c, ((0, 0), (0, n - before)))
    elif after != before:
        raise ValueError(
            f"k: step {k} has {before} states before and {after} after it, equal numbers needed. Use pad=True, or one "
            f"of the steps {model.full_begin} to {model.full_end - 2}"
        )
    return step.k, [a, b, c, d]


def to_control(model: StateSpace, k: Optional[int], pad: bool) -> Any:
    """See `interop.to_control`."""
    control = need("control", "to_control", "tokid[control]")
    step, matrices = _square_step(model, k, pad)
    return control.StateSpace(
        *matrices,
        model.dt,
        inputs=model.input_names,
        outputs=model.output_names,
        name=f"step_{step}" if k is not None else "tokid",
        remove_useless_states=False,
    )


def to_scipy(model: StateSpace, k: Optional[int], pad: bool) -> Any:
    """See `interop.to_scipy`."""
    signal = need("scipy.signal", "to_scipy", "scipy")
    _, matrices = _square_step(model, k, pad)
    return signal.StateSpace(*matrices, dt=model.dt)
