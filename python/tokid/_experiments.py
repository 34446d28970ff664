# SPDX-License-Identifier: BSD-3-Clause
"""The experiments of a call, from an ensemble, a DataFrame, a Dataset, or arrays u and y."""

from __future__ import annotations

from typing import Any, Optional

from . import _dataframe, _dataset, _tokid
from ._channels import channel_texts
from ._ensemble import Ensemble
from ._errors import warn
from ._samples import core_of, describe, taken_for_one


def _no_outputs_beside(what: str, y: Any) -> None:
    if y is not None:
        raise ValueError(f"y: found beside {what}, which has the outputs already")


# ---- for tokid.identify and tokid.cross_validate ----


def to_identify(u: Any, y: Any, dt: Optional[float], described: dict[str, Any]) -> tuple[_tokid.Ensemble, str]:
    """The experiments of an identification with their description, and a remark on the shapes of arrays."""
    if _dataframe.is_dataframe(u):
        if _dataframe.is_dataframe(y):
            raise ValueError(
                "u, y: two DataFrames found, one DataFrame with all columns needed; input_names and output_names "
                "choose the columns"
            )
        _no_outputs_beside("a DataFrame", y)
        return _of_table(u, dt, described), ""
    if _dataset.is_dataset(u):
        _no_outputs_beside("a Dataset", y)
        return _dataset.from_xarray(u, dt=dt, outputs_required=True, **described), ""
    if isinstance(u, Ensemble):
        for name, value in {"y": y, "dt": dt, **described}.items():
            if value is not None:
                raise ValueError(f"{name}: found beside an Ensemble, which has it already")
        return u._ready(), ""
    if y is None:
        raise ValueError("y: none found, outputs (N, T, m) needed")
    core, single = core_of(u, y, dt, described.get("length"))
    describe(core, **described)
    return core, taken_for_one(core) if single else ""


def _of_table(data: Any, dt: Optional[float], described: dict[str, Any]) -> _tokid.Ensemble:
    """The ensemble of a table. Its channels have the names of the columns."""
    rest = {name: described.get(name) for name in ("length", "free_y", "input_units", "output_units")}
    if described.get("experiment_names") is not None:
        raise ValueError("experiment_names: found beside a DataFrame, whose column 'experiment' has them")
    return _dataframe.from_dataframe(
        data,
        inputs=described.get("input_names"),
        outputs=described.get("output_names"),
        dt=dt,
        outputs_required=True,
        **rest,
    )


# ---- for tokid.update ----


def to_add(state: _tokid.UpdateState, u: Any, y: Any) -> _tokid.Ensemble:
    """The experiments of an update. Arrays get the sample time of the state."""
    if isinstance(u, Ensemble):
        _no_outputs_beside("an Ensemble", y)
        return u._ready()
    if _dataframe.is_dataframe(u):
        _no_outputs_beside("a DataFrame", y)
        return _dataframe.from_dataframe(u, dt=state.dt, outputs_required=True)
    if _dataset.is_dataset(u):
        _no_outputs_beside("a Dataset", y)
        return _dataset.from_xarray(u, dt=state.dt, outputs_required=True)
    if y is None:
        raise ValueError(f"y: none found, outputs (N, T, {state.outputs}) needed")
    return core_of(u, y, state.dt)[0]


# ---- for the methods of a model ----


def for_model(model: _tokid.Model, u: Any, y: Any, outputs: bool) -> tuple[_tokid.Ensemble, bool]:
    """Data for a model, and whether they are one experiment. Arrays get the sample time and names of the model."""
    if isinstance(u, Ensemble):
        _no_outputs_beside("an Ensemble", y)
        return _by_name(model, u._ready()), False
    if _dataframe.is_dataframe(u):
        _no_outputs_beside("a DataFrame", y)
        return _columns_of(model, u, outputs), False
    if _dataset.is_dataset(u):
        _no_outputs_beside("a Dataset", y)
        found = _dataset.from_xarray(u, dt=None if "dt" in u.attrs else model.dt, outputs_required=outputs)
        return _by_name(model, found), False
    if outputs and y is None:
        raise ValueError(f"y: none found, outputs (N, T, {model.outputs}) needed")
    core, single = core_of(u, y, model.dt)
    for side in ("input", "output"):
        if getattr(core, f"{side}s") == getattr(model, f"{side}s"):
            for name in (f"{side}_names", f"{side}_units"):
                setattr(core, name, getattr(model, name))
    core.check(False)
    if outputs and (remark := core.swapped_axes()) is not None:
        warn([remark])
    return core, single


def _columns_of(model: _tokid.Model, data: Any, outputs_required: bool) -> _tokid.Ensemble:
    """The columns of a table with the names of the channels of the model."""
    inputs: Optional[list[str]] = model.input_names
    outputs: Optional[list[str]] = model.output_names
    if not outputs_required and not set(model.output_names) <= {str(label) for label in data.columns}:
        outputs = None
    return _dataframe.from_dataframe(data, inputs=inputs, outputs=outputs, outputs_required=outputs_required)


def _by_name(model: _tokid.Model, data: _tokid.Ensemble) -> _tokid.Ensemble:
    """The data with their channels in the order of the model, if they have its names."""
    ordered = model.in_order(data)
    if ordered is None:
        return data
    order = ", ".join(channel_texts(model, "output_names"))
    warn([f"the channels of the data were taken by name. Results have the order of the model: {order}"])
    return ordered
