# SPDX-License-Identifier: BSD-3-Clause
"""Tables, logs and objects of pandas or xarray → an ensemble."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Optional

from .. import _dataframe, _tokid
from .._channels import channel_texts
from .._optional import need
from .._samples import core_of, describe, experiment_names, read_options
from . import channels, cut, grid, sources
from .clock import clock
from .cut import Experiment
from .recording import CONDITION, Options, Recording, Remark, checked, joined


def read(
    source: Any, options: Mapping[str, Any], described: Mapping[str, Any] = MappingProxyType({})
) -> _tokid.Ensemble:
    """Read an ensemble. `options` are those of `Options`, and `described` the arguments of `describe`."""
    chosen = checked(options)
    given = {name: value for name, value in described.items() if value is not None}
    if (own := _of_tokid(source, chosen)) is not None:
        describe(own, **given)
        return own
    need("pandas", "tokid.read", "tokid[read]")
    recordings = sources.recordings(source, _wanted(chosen))  # files or objects → raw columns
    stated = channels.stated(recordings, chosen)
    clocks = [clock(recording, stated, chosen) for recording in recordings]  # raw columns → times
    columns = channels.columns(recordings, clocks, stated, chosen)  # names → inputs and outputs
    experiments, cuts = cut.experiments(recordings, clocks, stated, columns, chosen)  # rows → experiments
    samples = grid.grid(recordings, columns, experiments, chosen)  # times → steps of one grid
    core = _core(samples, columns, experiments)
    told = [
        *cuts,
        *(remark for own in clocks for remark in own.remarks),
        *(Remark(text, own.place) for own in recordings for text in own.remarks),
        *map(Remark, samples.remarks),
        *columns.remarks,
    ]
    core.reader_remarks = joined(told, len(recordings))
    _keep_notes(core, recordings, experiments, chosen)
    describe(core, **given)
    core.check(chosen.outputs_required)
    return core


def _of_tokid(source: Any, options: Options) -> Optional[_tokid.Ensemble]:
    """The ensemble of a .csv that tokid wrote, with its checksum; None for other sources, and with other options."""
    stated = {name for name, value in vars(options).items() if value and value != "linear"}
    plain = stated <= {"inputs", "outputs", "outputs_required"}
    if not plain or not isinstance(source, (str, os.PathLike)) or not os.path.isfile(source):
        return None
    with open(source, "rb") as file:
        if not file.read(14).startswith(b"# checksum = "):
            return None
    plainly = read_options(options.inputs, options.outputs, options.outputs_required)
    return _tokid.load_ensemble([os.fspath(source)], plainly)


def _wanted(options: Options) -> list[str]:
    """The names of columns that the caller states. They tell the header, and the series of a log."""
    condition = CONDITION.fullmatch(options.trigger)
    names = [options.time, options.experiment_column, condition[1] if condition else ""]
    return [*options.inputs, *options.outputs, *filter(None, names)]


def _core(samples: grid.Grid, columns: channels.Columns, experiments: Sequence[Experiment]) -> _tokid.Ensemble:
    inputs = len(columns.inputs)
    core, _ = core_of(samples.samples[:, :, :inputs], samples.samples[:, :, inputs:], samples.dt)
    core.dt_stated = samples.dt_stated
    if samples.length is not None and len(set(samples.length)) > 1:
        core.length = samples.length
    names = {"input_names": columns.inputs, "output_names": columns.outputs}
    units = {"input_units": columns.units[:inputs], "output_units": columns.units[inputs:]}
    names = {name: own for name, own in names.items() if list(own) != channel_texts(core, name)}
    of = [one.name for one in experiments]
    describe(
        core,
        **names,
        **{name: own for name, own in units.items() if any(own)},
        experiment_names=of if all(of) else None,
    )
    return core


def _keep_notes(
    core: _tokid.Ensemble, recordings: Sequence[Recording], experiments: Sequence[Experiment], options: Options
) -> None:
    """Use the notes beside the tables, where they still hold."""
    states = list(dict.fromkeys(own.notes["initial_state"] for own in recordings if own.notes.get("initial_state")))
    if len(states) > 1:
        raise recordings[0].error(f"initial_state: {states[0]!r} and {states[1]!r} found in the notes of the tables, "
                                  "one value needed")
    if states and not options.trigger:
        describe(core, initial_state=states[0])
    units = {name: unit for own in recordings for name, unit in (own.notes.get("units") or {}).items()}
    for side in ("input", "output"):
        names = channel_texts(core, f"{side}_names")
        if not getattr(core, f"{side}_units") and any(units.get(name) for name in names):
            setattr(core, f"{side}_units", [units.get(name, "") for name in names])
    begin, several = min(one.begin for one in experiments), len(recordings) > 1
    if options.trigger or options.resample is not None or (several and begin != 0):
        return
    names = experiment_names(core)
    lengths = dict(zip(names, list(core.length) or [core.steps] * core.experiments))
    found = dict(lengths)
    for own in recordings:
        noted = own.notes.get("length") or {}
        for name, length in noted.items() if isinstance(noted, dict) else zip(names, noted):
            lengths[own.name if several and own.name in lengths else f"{own.name}/{name}" if several else name] = length
    if lengths != found:
        _dataframe.keep_lengths(core, lengths, names, 0 if several else round(float(begin) / core.dt))
