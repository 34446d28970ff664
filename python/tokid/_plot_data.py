# SPDX-License-Identifier: BSD-3-Clause
"""Models and data → the values that plots show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np

from ._ensemble import Ensemble
from ._model import Model
from . import _options
from ._options import integer
from ._samples import named
from ._typing import Array


# ---- outputs ----


@dataclass
class OutputCurves:
    """One output of one experiment: T values of each curve, and their name with unit, title and sample time [s]."""

    measured: Array
    simulated: Array
    predicted: Array
    nominal: Optional[Array]
    name: str
    title: str
    dt: float


def output_curves(
    model: Model, u: Any, y: Any, experiment: Optional[int], output: Union[int, str], initial_state: str
) -> OutputCurves:
    """The curves of an output, by default of the experiment with the median error."""
    core, _ = model._data(u, y, outputs=True)
    data = Ensemble._of(core)
    simulated = model._core.simulate_data(core, _options.initial_state(initial_state)).outputs_copied()
    predicted = model.predict(data, initial_state=initial_state)
    names, units = channel_names(model, data, "output")
    j = channel("output", output, names)
    n, title = chosen_experiment(model, data, experiment, initial_state)
    nominal = nominal_trajectory(model, "y", data.steps, data.outputs)
    return OutputCurves(
        data.y[n, :, j],
        simulated[n, :, j],
        predicted[n, :, j],
        None if nominal is None else nominal[:, j],
        named(names[j], units[j]),
        title,
        data.dt,
    )


def channel(name: str, value: Union[int, str], names: Sequence[str]) -> int:
    """The number of a channel, from its number or its name."""
    if isinstance(value, str):
        if value in names:
            return names.index(value)
        raise ValueError(f"{name}: {value!r} found, one of {', '.join(map(repr, names))} needed")
    return integer(name, value, 0, len(names) - 1)


def channel_names(model: Model, data: Optional[Ensemble], kind: str) -> tuple[list[str], list[str]]:
    """The names and units of the channels: those of the model, else those of the data."""
    cores = [model._core] + ([data._core] if data is not None else [])
    names = next((list(found) for core in cores if (found := getattr(core, f"{kind}_names"))), None)
    units = next((list(found) for core in cores if (found := getattr(core, f"{kind}_units"))), None)
    return names or getattr(model, f"{kind}_names"), units or getattr(model, f"{kind}_units")


def nominal_trajectory(model: Model, kind: str, steps: int, channels: int) -> Optional[Array]:
    """The nominal inputs "u" or outputs "y" (T, channels), NaN after their end; None if the model has none."""
    nominal = model.y_nominal if kind == "y" else model.u_nominal
    if nominal is None:
        return None
    whole = np.full((steps, channels), np.nan)
    whole[: len(nominal)] = nominal[:steps]
    return whole


def relative_errors(model: Model, data: Ensemble, computed: Array) -> Array:
    """Errors (N, T, m), relative to the spread of each output around the nominal trajectory, else around its mean."""
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


def chosen_experiment(
    model: Model, data: Ensemble, experiment: Optional[int], initial_state: str
) -> tuple[int, str]:
    """The given experiment, else the one with the median error, and its title as on the report page."""
    fits = model.experiment_fits(data, initial_state=initial_state)
    order, known = fits.worst_first, int((~np.isnan(fits.excess)).sum())
    worst, middle, best = (order[0], order[known // 2], order[known - 1]) if known else (-1, -1, -1)
    if experiment is None:
        n = middle if known else 0
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
    """A model in the frame of the eigenvalues and gains on the report page, and the steps that are in this frame."""

    model: Model
    begin: int
    end: int


def pole_frame(model: Model) -> Framed:
    """The reference frame of the first step with all states, if it reaches half of the steps, else the smooth frame."""
    rows = model._core.estimation_window()
    if model.states:
        s = model.full_begin
        try:
            reference = model.frame("reference", reference_step=s, rows=rows)
        except ValueError:
            reference = None  # the outputs from step s on do not determine the state of step s
        if reference is not None:
            begin, end = _reach(reference, s, rows)
            if 2 * (end - begin) >= model.full_end - s and end - begin > 1:
                return Framed(reference, begin, end - 1)
    return Framed(model.frame("smooth", rows=rows), model.k_begin, model.k_end)


def _reach(reference: Model, s: int, rows: int) -> tuple[int, int]:
    """The steps begin … end-1 around s whose states are in the frame: there, O_s⁺ O_k is the identity."""
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
    """The steps in the frame with square A, and the eigenvalues of A and of A + GC at these steps.

    Steps at which one of the two is not finite are left out.
    """
    frame = pole_frame(model)
    k = [
        k
        for k in range(frame.begin, frame.end)
        if (a := frame.model.A[k - model.k_begin]).shape[0] == a.shape[1] and a.size
    ]
    if not k:
        raise ValueError("no step has equal numbers of states before and after it, so that there are no eigenvalues")
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
        raise ValueError("A or A + GC is infinite or NaN at every step, so that there are no eigenvalues")
    return np.asarray(finite), opened, closed
