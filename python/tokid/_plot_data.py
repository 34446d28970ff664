# SPDX-License-Identifier: BSD-3-Clause
"""What plots show of models and data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np

from ._ensemble import Ensemble
from ._model import Model
from ._options import INITIAL_STATES, choice, integer
from ._typing import Array


# ---- outputs ----


@dataclass
class Outcome:
    """What the model makes of data."""

    data: Ensemble
    simulated: Array
    predicted: Array


def outcome(model: Model, u: Any, y: Any, initial_state: str) -> Outcome:
    core, _ = model._data(u, y, outputs=True)
    data = Ensemble._of(core)
    initial = choice("initial_state", initial_state, INITIAL_STATES)
    simulated = model._core.simulate_data(core, initial).outputs_copied()
    return Outcome(data, simulated, model.predict(data, initial_state=initial_state))


def channel(name: str, value: Union[int, str], names: Sequence[str]) -> int:
    """The number of a channel that is given by its number or name."""
    if isinstance(value, str):
        if value in names:
            return names.index(value)
        raise ValueError(f"{name}: {value!r} found, one of {', '.join(map(repr, names))} needed")
    return integer(name, value, 0, len(names) - 1)


def channel_names(model: Model, data: Optional[Ensemble], kind: str) -> tuple[list[str], list[str]]:
    """Names and units of the channels: the model's, or the data's where the model has none."""
    cores = [model._core] + ([data._core] if data is not None else [])
    names = next((list(found) for core in cores if (found := getattr(core, f"{kind}_names"))), None)
    units = next((list(found) for core in cores if (found := getattr(core, f"{kind}_units"))), None)
    return names or getattr(model, f"{kind}_names"), units or getattr(model, f"{kind}_units")


def nominal_trajectory(model: Model, kind: str, steps: int, channels: int) -> Optional[Array]:
    """The nominal inputs "u" or outputs "y" (T, channels), NaN where there are none."""
    nominal = model.y_nominal if kind == "y" else model.u_nominal
    if nominal is None:
        return None
    whole = np.full((steps, channels), np.nan)
    whole[: len(nominal)] = nominal[:steps]
    return whole


def relative_errors(model: Model, data: Ensemble, computed: Array) -> Array:
    """Errors (N, T, m), relative to the spread of each output about the nominal trajectory, or about its mean."""
    y = np.asarray(data.y)
    nominal = nominal_trajectory(model, "y", data.steps, data.outputs)
    about = y
    if nominal is not None:
        about = y - np.where(np.isnan(nominal), 0.0, nominal)
    spread = np.ones(data.outputs)
    for j in range(data.outputs):
        values = about[:, :, j][~np.isnan(about[:, :, j])]
        if values.size:
            variance = float(np.mean(values**2)) - (0.0 if nominal is not None else float(np.mean(values)) ** 2)
            spread[j] = math.sqrt(variance) if variance > 0 else 1.0
    relative: Array = (y - computed) / spread
    return relative


def root_mean_square(errors: Array, axes: tuple[int, ...]) -> Array:
    known = ~np.isnan(errors)
    count = known.sum(axis=axes)
    total = np.where(known, errors, 0.0) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        root: Array = np.sqrt(total.sum(axis=axes) / np.where(count > 0, count, np.nan))
    return root


def chosen_experiment(model: Model, found: Outcome, experiment: Optional[int]) -> tuple[int, str]:
    """The one asked for, or that of the median error; with the page's words for it."""
    data = found.data
    error = root_mean_square(relative_errors(model, data, found.simulated), (1, 2))
    if not np.isfinite(error).any():
        error = root_mean_square(relative_errors(model, data, found.predicted), (1, 2))
    order = np.argsort(error, kind="stable")  # those without an error come last
    known = int((~np.isnan(error)).sum())
    best, middle, worst = (order[0], order[(known - 1) // 2], order[known - 1]) if known else (-1, -1, -1)
    if experiment is None:
        n = int(middle) if known else 0
    else:
        n = integer("experiment", experiment, 0, data.experiments - 1)
    label = f"Experiment {data._core.experiment(n)}"
    if data.experiments > 1 and n == worst:
        label += " (largest error)"
    elif data.experiments > 1 and n == best:
        label += " (smallest error)"
    elif data.experiments > 2 and n == middle:
        label += " (median error)"
    return n, label


# ---- eigenvalues ----


@dataclass
class Framed:
    """A model in the frame in which the page shows eigenvalues and gains, at the steps that are in it."""

    model: Model
    begin: int
    end: int


def pole_frame(model: Model) -> Framed:
    """The reference frame of the first step with all states, if it reaches half of them, else the smooth frame."""
    rows = model._core.estimation_window()
    if model.states:
        s = model.full_begin
        try:
            reference = model.frame("reference", reference_step=s, rows=rows)
        except ValueError:
            # The outputs of step s don't tell its state: the smooth frame needs no such thing.
            reference = None
        if reference is not None:
            begin, end = _reach(reference, s, rows)
            # One that reaches half of the steps is a picture, less is a stub.
            if 2 * (end - begin) >= model.full_end - s and end - begin > 1:
                return Framed(reference, begin, end - 1)
    return Framed(model.frame("smooth", rows=rows), model.k_begin, model.k_end)


def _reach(reference: Model, s: int, rows: int) -> tuple[int, int]:
    """Steps begin … end-1 around s whose states are in the frame: O_s⁺ O_k is the identity in it."""
    core = reference._core
    projection = np.linalg.pinv(core.observability(s, rows))

    def inside(k: int) -> bool:
        if not reference.k_begin <= k <= reference.k_end - rows:
            return False
        product = projection @ core.observability(k, rows)
        return product.shape[0] == product.shape[1] and bool(np.allclose(product, np.eye(len(product)), atol=1e-6))

    begin = end = s
    while inside(begin - 1):
        begin -= 1
    while inside(end):
        end += 1
    return begin, end


def eigenvalues(model: Model) -> tuple[Any, Any, Any]:
    """Steps in the frame with as many states behind as before, and the eigenvalues of A and of A + GC there.

    Without those at which one of the two overflows, which has none."""
    frame = pole_frame(model)
    k = [
        k
        for k in range(frame.begin, frame.end)
        if (a := frame.model.A[k - model.k_begin]).shape[0] == a.shape[1] and a.size
    ]
    if not k:
        raise ValueError("no step has as many states before as after it: there are no eigenvalues")
    finite, opened, closed = [], [], []
    for step in k:
        at = frame.model.at(step)
        with np.errstate(over="ignore", invalid="ignore"):
            both = at.A, at.closed_loop
        if not all(np.isfinite(a).all() for a in both):
            continue
        finite.append(step)
        opened.append(np.linalg.eigvals(both[0]))
        closed.append(np.linalg.eigvals(both[1]))
    if not finite:
        raise ValueError("A or A + GC is not finite at any step: there are no eigenvalues")
    return np.asarray(finite), opened, closed
