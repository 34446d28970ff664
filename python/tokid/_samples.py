# SPDX-License-Identifier: BSD-3-Clause
"""Samples and their description → the ensemble of the library."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np

from . import _arrays, _options, _tokid
from ._typing import ArrayLike


def label(name: Any) -> str:
    """The name of an experiment as text. It may be a number: 17.0 gives "17"."""
    whole = isinstance(name, (float, np.floating)) and float(name).is_integer()
    return str(int(name) if whole else name)


def labels_of(data: _tokid.Ensemble) -> np.ndarray[Any, Any]:
    """The names (N,) of the experiments as an index: integers if all names are integers, else texts."""
    names = data.experiment_names
    if not names:
        return np.arange(data.experiments)
    if all(name.isascii() and name.isdecimal() and len(name) <= 18 and str(int(name)) == name for name in names):
        return np.asarray([int(name) for name in names])
    return np.asarray(names, dtype=object)


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def named(name: str, unit: str) -> str:
    """A channel with its unit, if it has one: "angle [rad]"."""
    return f"{name} [{unit}]" if unit else name


def sizes(e: Any) -> str:
    return (
        f"N = {plural(e.experiments, 'experiment')}, T = {plural(e.steps, 'step')}, r = {plural(e.inputs, 'input')}, "
        f"m = {plural(e.outputs, 'output')}, dt = {e.dt:g} s"
    )


def experiment_names(data: _tokid.Ensemble) -> list[str]:
    """The names (N) of the experiments; without names, their rows "0", "1", …"""
    return data.experiment_names or [str(n) for n in range(data.experiments)]


def new_core(
    experiments: int, steps: int, inputs: int, outputs: int, *, dt: Optional[float], unset: bool = False
) -> _tokid.Ensemble:
    """An ensemble of this size. Its samples are missing or, if `unset`, about to be written."""
    core = _tokid.Ensemble(experiments, steps, inputs, outputs, 1.0 if dt is None else _options.number("dt", dt), unset)
    core.dt_stated = dt is not None
    return core


def core_of(
    u: Any, y: Any, dt: Optional[float], length: Optional[ArrayLike] = None
) -> tuple[_tokid.Ensemble, bool]:
    """Return an ensemble with these samples, and whether they were those of a single experiment.

    Experiments of different lengths set the lengths of the ensemble. A `length` of the user is then an error.
    """
    if u is None and y is None:
        raise ValueError("u, y: none of them found, inputs (N, T, r) or outputs (N, T, m) needed")
    if _arrays.are_runs(u) or _arrays.are_runs(y):
        if length is not None:
            raise ValueError("length: found beside a list of experiments, whose lengths are known")
        return _core_of_runs(u, y, dt), False
    if u is None:
        outputs, single = _arrays.samples("y", y, "m")
        inputs = np.zeros((*outputs.shape[:2], 0))
    else:
        inputs, single = _arrays.samples("u", u, "r")
        none = np.zeros((*inputs.shape[:2], 0))
        outputs = none if y is None else _arrays.outputs_beside(y, inputs, single)
    experiments, steps, r = inputs.shape
    core = new_core(experiments, steps, r, outputs.shape[2], dt=dt, unset=True)
    core.write_inputs(inputs)
    core.write_outputs(outputs)
    return core, single


def _core_of_runs(u: Any, y: Any, dt: Optional[float]) -> _tokid.Ensemble:
    """Return an ensemble of experiments of different lengths."""
    inputs = None if u is None else _arrays.runs("u", u, "r")
    outputs = None if y is None else _arrays.runs("y", y, "m")
    if inputs is not None and outputs is not None:
        if len(inputs) != len(outputs):
            raise ValueError(f"y: {plural(len(outputs), 'experiment')} found, {len(inputs)} needed as in u")
        for n, (one, beside) in enumerate(zip(outputs, inputs)):
            if len(one) != len(beside):
                raise ValueError(f"y[{n}]: {plural(len(one), 'step')} found, {len(beside)} needed as in u[{n}]")
    lengths = [len(one) for one in (outputs if inputs is None else inputs) or ()]
    r, m = (one[0].shape[1] if one else 0 for one in (inputs, outputs))
    core = new_core(len(lengths), max(lengths), r, m, dt=dt)
    for samples, experiments in ((core.u(), inputs), (core.y(), outputs)):
        for n, one in enumerate(experiments or ()):
            samples[n, : len(one)] = one
    if min(lengths) < max(lengths):
        core.length = lengths
    return core


def taken_for_one(core: _tokid.Ensemble) -> str:
    """A remark on inputs that were taken for (T, r), but may be (N, T)."""
    steps, r = core.steps, core.inputs
    return (
        f"the array u of shape ({steps}, {r}) was read as one experiment of {plural(steps, 'step')} with "
        f"{plural(r, 'input')}. For {steps} experiments with one input, use the shape ({steps}, {r}, 1)"
    )


def with_remark(texts: Sequence[str], core: _tokid.Ensemble, remark: str) -> Sequence[str]:
    """The warnings, with the remark of `taken_for_one` if (N, T) is more likely, once."""
    if remark and core.inputs > core.steps and not any(remark in text for text in texts):
        return [remark, *texts]
    return texts


# The arguments of `Ensemble` that describe samples.
NAMES = ("input_names", "output_names", "input_units", "output_units")
DESCRIPTION = ("length", "free_y", "initial_state", *NAMES, "experiment_names")


def description(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Select those that describe samples among the arguments of a call."""
    return {name: arguments[name] for name in DESCRIPTION if name in arguments}


def describe(core: _tokid.Ensemble, **given: Any) -> None:
    """Set the parts of an ensemble that are not samples. The arguments are those of `DESCRIPTION`."""
    length, free_y, initial_state, names = map(given.get, ("length", "free_y", "initial_state", "experiment_names"))
    if length is not None:
        lengths = _arrays.shaped("length", length, (core.experiments,))
        if lengths.dtype.kind not in "iu":
            raise ValueError(f"length: an array of {lengths.dtype} found, whole numbers needed")
        core.length = [int(n) for n in lengths]
    if free_y is not None:
        core.free_y = _arrays.shaped("free_y", free_y, (None, None, core.outputs), "Nf, Tf, m")
    if initial_state is not None:
        _options.known_initial_state(initial_state)
        core.initial_state = initial_state
    name_channels(core, given)
    if names is not None:
        if isinstance(names, str):
            raise ValueError(f"experiment_names: {names!r} found, a list of {plural(core.experiments, 'name')} needed")
        core.experiment_names = [label(name) for name in names]


def one_or_more(values: Union[str, Iterable[Any], None]) -> list[str]:
    """The texts of an argument that may be one text, or several, or None."""
    return [values] if isinstance(values, str) else [str(value) for value in (() if values is None else values)]


def read_options(inputs: Any, outputs: Any, outputs_required: bool) -> _tokid.ReadOptions:
    """The options of the reader of the library."""
    options = _tokid.ReadOptions()
    options.inputs, options.outputs = one_or_more(inputs), one_or_more(outputs)
    options.outputs_required = _options.switch("outputs_required", outputs_required)
    return options


def name_channels(core: Any, given: Mapping[str, Any]) -> None:
    """Set the names and units of an ensemble or a model, one for each channel."""
    for name in NAMES:
        texts, count = given.get(name), core.inputs if name.startswith("input") else core.outputs
        if texts is not None:
            listed = one_or_more(texts)
            if len(listed) != count:
                found = repr(texts) if isinstance(texts, str) else f"{plural(len(listed), 'text')}"
                raise ValueError(f"{name}: {found} found, a list of {plural(count, 'text')} needed")
            setattr(core, name, listed)
