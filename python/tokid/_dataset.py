# SPDX-License-Identifier: BSD-3-Clause
"""Datasets of xarray from ensembles and models, and ensembles from datasets."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._channels import channel_texts
from ._errors import warn
from ._optional import need
from ._samples import core_of, describe, label, labels_of
from ._state_space import StateSpace
from ._time_grid import Grid, seconds
from ._typing import Array

_STEPS = ("k", "time")


def is_dataset(data: Any) -> bool:
    loaded = sys.modules.get("xarray")
    return loaded is not None and isinstance(data, loaded.Dataset)


def _samples(data: Any, name: str, channel: str) -> tuple[Optional[str], Optional[np.ndarray[Any, Any]]]:
    """The dimension of the steps, and the samples (N, T, channels), of a variable; None without the variable."""
    if name not in data.data_vars:
        return None, None
    variable = data[name]
    steps = [dim for dim in _STEPS if dim in variable.dims]
    if len(steps) != 1 or not set(variable.dims) <= {"experiment", channel, *steps}:
        raise ValueError(
            f"{name}: dimensions {variable.dims} found, 'k' or 'time' needed, and apart from it only 'experiment' and "
            f"'{channel}'; rename or select"
        )
    for dim, axis in (("experiment", 0), (channel, -1)):
        if dim not in variable.dims:
            variable = variable.expand_dims(dim, axis)
    return steps[0], _arrays.numbers(name, variable.transpose("experiment", steps[0], channel).values)


def _coordinate(data: Any, name: str, dim: str) -> Optional[np.ndarray[Any, Any]]:
    return data[name].values if name in data.coords and data[name].dims == (dim,) else None


def _times(data: Any, dim: str, steps: int) -> tuple[Array, bool, float]:
    """The times of the steps or their numbers, whether they are times, and their resolution [s]."""
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


def _description(data: Any, core: _tokid.Ensemble, dim: str, grid: Grid, names_given: bool) -> dict[str, Any]:
    """The values of a dataset that describe its samples, as the arguments of `describe`.

    They count steps from the begin of the ensemble. The samples may be a later stretch of it.
    """
    found: dict[str, Any] = {}
    numbered = _coordinate(data, "k", dim)
    numbers = np.arange(len(grid.step)) if numbered is None else _arrays.numbers("k", numbered)
    begun = int(numbers.min()) == 0
    if "length" in data and data["length"].dims == ("experiment",):
        lengths = data["length"].values
        found["length"] = [int(grid.step[numbers < valid].max(initial=-1)) + 1 for valid in lengths]
    found["initial_state"] = data.attrs.get("initial_state") if begun else "unknown"
    dims = ("free_experiment", "free_k", "output")
    if "free_y" in data and set(data["free_y"].dims) == set(dims) and begun:
        if grid.gapless and data.attrs.get("dt") in (None, grid.dt):
            found["free_y"] = data["free_y"].transpose(*dims).values
    for side, count in (("input", core.inputs), ("output", core.outputs)):
        names = _texts(data, side, side)
        if names != channel_texts(core, f"{side}_names"):  # these are the names that channels without names get
            found[f"{side}_names"] = names
        found[f"{side}_units"] = _texts(data, f"{side}_unit", side) if count else None
    coordinate = _coordinate(data, "experiment", "experiment")
    if coordinate is not None and not names_given:
        labels = [label(name) for name in coordinate]
        if all(labels) and len(set(labels)) == len(labels):
            found["experiment_names"] = labels
        else:
            warn(["experiment: empty or repeated labels found. The experiments are named by their rows"])
    return found


def from_xarray(
    data: Any, *, dt: Optional[float] = None, outputs_required: bool = False, **described: Any
) -> _tokid.Ensemble:
    """See `Ensemble.from_xarray`. `described` has the arguments of `describe`."""
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
    times, timed, resolution = _times(data, dim, some.shape[1])
    stated = None if dt is None else _options.real("dt", dt, 0.0)
    noted = data.attrs.get("dt")
    grid = Grid(times, timed, stated, None if noted is None else float(noted), 1, resolution)
    if len(np.unique(grid.step)) < len(times):
        raise ValueError(f"{dim}: two entries found for a step, one needed")
    if not grid.gapless:
        u, y = (None if samples is None else _on_grid(samples, grid) for samples in (u, y))
    core, _ = core_of(u, y, grid.dt)
    core.dt_stated = grid.dt_stated
    given = {name: value for name, value in described.items() if value is not None}
    description = {**_description(data, core, dim, grid, "experiment_names" in given), **given}
    if not core.outputs:
        description.pop("free_y", None)
    describe(core, **description)
    core.check(outputs_required)
    return core


# ---- ensembles and models → datasets ----


def _padded(matrices: Sequence[Array], shape: tuple[int, int]) -> Array:
    """One array of all steps. NaN where a matrix has no entry."""
    whole = np.full((len(matrices), *shape), np.nan)
    for s, matrix in enumerate(matrices):
        whole[s, : matrix.shape[0], : matrix.shape[1]] = matrix
    return whole


def _vector(values: Array, size: int) -> Array:
    return np.append(values, np.full(size - len(values), np.nan))


def _described(core: Any, kind: str) -> dict[str, Any]:
    """The coordinates of the inputs or outputs of an ensemble or a model: their names, and their units if known."""
    units = channel_texts(core, f"{kind}_units")
    coordinates: dict[str, Any] = {kind: (kind, np.asarray(channel_texts(core, f"{kind}_names"), dtype=str))}
    if any(units):
        coordinates[f"{kind}_unit"] = (kind, np.asarray(units, dtype=str))
    return coordinates


def of_ensemble(core: _tokid.Ensemble) -> Any:
    """The dataset of an ensemble. See `interop.ensemble_to_xarray`."""
    xr = need("xarray", "to_xarray", "tokid[xarray]")
    variables: dict[str, Any] = {}
    if core.inputs:
        variables["u"] = (("experiment", "k", "input"), core.u())
    if core.outputs:
        variables["y"] = (("experiment", "k", "output"), core.y())
    if core.length:
        variables["length"] = ("experiment", np.asarray(core.length, dtype=np.int64))
    if core.free_y is not None:
        variables["free_y"] = (("free_experiment", "free_k", "output"), core.free_y)
    k = np.arange(core.steps)
    coordinates: dict[str, Any] = {
        "experiment": ("experiment", labels_of(core)),
        "k": ("k", k, {"long_name": "Step"}),
    }
    if core.dt_stated:
        coordinates["time"] = ("k", k * core.dt, {"long_name": "Time", "units": "s"})
    if core.inputs:
        coordinates.update(_described(core, "input"))
    if core.outputs:
        coordinates.update(_described(core, "output"))
    attributes: dict[str, Any] = {"dt": core.dt} if core.dt_stated else {}
    if core.initial_state is not None:
        attributes["initial_state"] = core.initial_state
    return xr.Dataset(variables, coordinates, attributes)


def of_model(model: StateSpace) -> Any:
    """The dataset of a model. See `interop.model_to_xarray`."""
    xr = need("xarray", "to_xarray", "tokid[xarray]")
    n, r, m = model.states, model.inputs, model.outputs
    sizes = {"state_next": n, "state": n, "input": r, "output": m}
    variables: dict[str, Any] = {}
    for name, rows, columns in (
        ("A", "state_next", "state"),
        ("B", "state_next", "input"),
        ("C", "output", "state"),
        ("D", "output", "input"),
        ("G", "state_next", "output"),
        ("innovation_cov", "output", "output"),
        ("Q", "state_next", "state_next"),
        ("R", "output", "output"),
        ("K", "state", "output"),
    ):
        matrices = list(getattr(model, name))
        if matrices:
            dims = ("k", rows, columns if columns != rows else f"{columns}_2")
            variables[name] = (dims, _padded(matrices, (sizes[rows], sizes[columns])))
    variables["state_dim"] = ("k", model.state_dim[:-1])
    variables["state_dim_next"] = ("k", model.state_dim[1:])
    sigma = model.singular_values
    if sigma:
        most = max(len(values) for values in sigma)
        variables["singular_value"] = (("k", "number"), np.stack([_vector(values, most) for values in sigma]))
    for name in ("condition", "rank", "lags"):
        values = getattr(model, name)
        if len(values):
            variables[name] = ("k", values)
    for name, dim in (("u_nominal", "input"), ("y_nominal", "output")):
        nominal = getattr(model, name)
        if nominal is not None:
            variables[name] = (("step", dim), np.array(nominal))
    if model.x0_mean is not None:
        variables["x0_mean"] = ("state", _vector(model.x0_mean, n))
    if model.x0_cov is not None:
        variables["x0_cov"] = (("state", "state_2"), _padded([model.x0_cov], (n, n))[0])
    k = np.arange(model.k_begin, model.k_end)
    coordinates: dict[str, Any] = {
        "k": ("k", k, {"long_name": "Step"}),
        "time": ("k", k * model.dt, {"long_name": "Time", "units": "s"}),
        "state": ("state", np.arange(1, n + 1)),
        "state_next": ("state_next", np.arange(1, n + 1)),
        **_described(model._core, "input"),
        **_described(model._core, "output"),
    }
    if "singular_value" in variables:
        coordinates["number"] = ("number", np.arange(1, variables["singular_value"][1].shape[1] + 1))
    for name in ("u_nominal", "y_nominal"):
        if name in variables:
            coordinates["step"] = ("step", np.arange(len(variables[name][1])))
    attributes = {
        "dt": model.dt,
        "period": model.period,
        "frame": model.frame_name,
        "method": model.method,
        "initial_state": model.initial_state,
        "version": model.version,
        "options": json.dumps(model.options),
    }
    return xr.Dataset(variables, coordinates, attributes)
