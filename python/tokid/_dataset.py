# SPDX-License-Identifier: BSD-3-Clause
"""Datasets of xarray, by the names of dimensions and coordinates that `Ensemble.to_xarray` gives them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._dataframe import Grid, seconds
from ._ensemble import core_of, describe, label
from ._errors import warn
from ._optional import need
from ._typing import Array, ArrayLike

_STEPS = ("k", "time")


def is_dataset(data: Any) -> bool:
    loaded = sys.modules.get("xarray")
    return loaded is not None and isinstance(data, loaded.Dataset)


def _samples(data: Any, name: str, channel: str) -> tuple[Optional[str], Optional[np.ndarray[Any, Any]]]:
    """The dimension of the steps and the samples (N, T, channels) of a variable, if it is there."""
    if name not in data.data_vars:
        return None, None
    variable = data[name]
    steps = [dim for dim in _STEPS if dim in variable.dims]
    if len(steps) != 1 or not set(variable.dims) <= {"experiment", channel, *steps}:
        raise ValueError(
            f"{name}: dimensions {variable.dims} found, 'k' or 'time' needed, and no others than 'experiment' and "
            f"'{channel}' beside it; rename or select"
        )
    for dim, axis in (("experiment", 0), (channel, -1)):
        if dim not in variable.dims:
            variable = variable.expand_dims(dim, axis)
    return steps[0], _arrays.numbers(name, variable.transpose("experiment", steps[0], channel).values)


def _coordinate(data: Any, name: str, dim: str) -> Optional[np.ndarray[Any, Any]]:
    return data[name].values if name in data.coords and data[name].dims == (dim,) else None


def _times(data: Any, dim: str, steps: int) -> tuple[Array, bool, float]:
    """Times of the steps, or their numbers where there are none; whether they are times, and what they are rounded to."""
    for name, timed in (("time", True), ("k", False)):
        found = _coordinate(data, name, dim)
        if found is not None:
            stamped = found.dtype.kind in "Mm"
            times = seconds(found) if stamped and timed else _arrays.numbers(name, found).astype(np.float64)
            wrong = np.flatnonzero(~np.isfinite(times) | ((times != np.floor(times)) if not timed else False))
            if wrong.size:
                needed = "finite times" if timed else "whole numbers"
                raise ValueError(f"{name}: {found[wrong[0]]} found at {wrong[0]}, {needed} needed")
            return times, timed, 1e-9 if stamped else 0.0
    return np.arange(steps, dtype=np.float64), False, 0.0


def _on_grid(samples: np.ndarray[Any, Any], grid: Grid) -> np.ndarray[Any, Any]:
    whole = np.full((samples.shape[0], grid.steps, samples.shape[2]), np.nan)
    whole[:, grid.step] = samples
    return whole


def _texts(data: Any, name: str, dim: str) -> Optional[list[str]]:
    found = _coordinate(data, name, dim)
    return None if found is None else [str(text) for text in found]


def from_xarray(
    data: Any,
    *,
    dt: Optional[float] = None,
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    initial_state: Optional[str] = None,
    input_names: Optional[Sequence[str]] = None,
    output_names: Optional[Sequence[str]] = None,
    input_units: Optional[Sequence[str]] = None,
    output_units: Optional[Sequence[str]] = None,
    experiment_names: Optional[Iterable[Any]] = None,
    outputs_required: bool = False,
) -> _tokid.Ensemble:
    need("xarray", "from_xarray", "tokid[xarray]")
    if not is_dataset(data):
        raise ValueError(f"data: {type(data).__name__} found, a Dataset needed")
    (u_dim, u), (y_dim, y) = _samples(data, "u", "input"), _samples(data, "y", "output")
    if (u is None and y is None) or (y is None and outputs_required):
        needed = "'u' and 'y'" if outputs_required else "'u' or 'y'"
        raise ValueError(f"data: variables {list(map(str, data.data_vars))} found, {needed} needed; rename or select")
    if u_dim is not None and y_dim is not None and u_dim != y_dim:
        raise ValueError(f"u, y: steps along '{u_dim}' and '{y_dim}' found, one dimension needed")
    some, dim = (u, u_dim) if u is not None else (y, y_dim)
    if some is None or dim is None or not some.shape[1]:
        raise ValueError("data: no steps found, samples needed")
    times, timed, rounded = _times(data, dim, some.shape[1])
    stated = None if dt is None else _options.real("dt", dt, 0.0)
    noted = data.attrs.get("dt")
    grid = Grid(times, timed, stated, None if noted is None else float(noted), 1, rounded)
    if len(np.unique(grid.step)) < len(times):
        raise ValueError(f"{dim}: two entries found for a step, one needed")
    even = grid.steps == len(times) and bool(np.all(np.diff(grid.step) == 1))
    if not even:
        u, y = (None if samples is None else _on_grid(samples, grid) for samples in (u, y))
    core, _ = core_of(u, y, grid.dt)
    core.dt_stated = grid.dt_stated

    # What is noted counts steps from where the ensemble began, of which this may be a stretch.
    numbered = _coordinate(data, "k", dim)
    numbers = np.arange(len(times)) if numbered is None else _arrays.numbers("k", numbered)
    begun = int(numbers.min()) == 0
    lengths = data["length"].values if "length" in data and data["length"].dims == ("experiment",) else None
    if length is None and lengths is not None:
        length = [int(grid.step[numbers < valid].max(initial=-1)) + 1 for valid in lengths]
    if initial_state is None:
        initial_state = data.attrs.get("initial_state") if begun else "unknown"
    dims = ("free_experiment", "free_k", "output")
    if free_y is None and "free_y" in data and set(data["free_y"].dims) == set(dims) and begun:
        if even and (noted is None or grid.dt == noted):
            free_y = data["free_y"].transpose(*dims).values
    names = {
        "input_names": _texts(data, "input", "input") if input_names is None else input_names,
        "output_names": _texts(data, "output", "output") if output_names is None else output_names,
    }
    for name, count, given in (("input_names", core.inputs, input_names), ("output_names", core.outputs, output_names)):
        if given is None and names[name] == [f"{'u' if name[0] == 'i' else 'y'}{i + 1}" for i in range(count)]:
            names[name] = None  # those that channels without a name have
    coordinate = _coordinate(data, "experiment", "experiment")
    if experiment_names is None and coordinate is not None:
        labels = [label(name) for name in coordinate]
        if all(labels) and len(set(labels)) == len(labels):
            experiment_names = labels
        else:
            warn(["experiment: empty or repeated labels found, so the experiments are known by their rows alone"])
    describe(
        core,
        length,
        free_y if core.outputs else None,
        initial_state,
        input_units=(_texts(data, "input_unit", "input") if core.inputs else None) if input_units is None else input_units,
        output_units=(
            (_texts(data, "output_unit", "output") if core.outputs else None) if output_units is None else output_units
        ),
        experiment_names=experiment_names,
        **names,
    )
    core.check(outputs_required)
    return core
