# SPDX-License-Identifier: BSD-3-Clause
"""Names of columns → inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional

from .. import _dataframe
from .recording import Options, Recording, Remark, quoted

if TYPE_CHECKING:
    from .clock import Clock


@dataclass(frozen=True)
class Channels:
    """The names of channels that the caller or notes beside the tables state, and the column of experiments."""

    inputs: Sequence[str]
    outputs: Sequence[str]
    experiment_column: str

    def stated(self, recording: Recording) -> list[int]:
        found = [recording.find(name) for name in (*self.inputs, *self.outputs)]
        return [column for column in found if column is not None]

    def experiments(self, recording: Recording) -> Optional[int]:
        """The column that names the experiments: the stated one, or that with the name "experiment"."""
        if self.experiment_column:
            return recording.need(self.experiment_column)
        return next((c for c, name in enumerate(recording.names) if name.lower() == "experiment"), None)


@dataclass(frozen=True)
class Columns:
    """The channels of an ensemble, and for each recording the numbers of their columns."""

    inputs: Sequence[str]
    outputs: Sequence[str]
    units: Sequence[str]
    of: Sequence[Sequence[int]]
    remarks: Sequence[Remark]


def stated(recordings: Sequence[Recording], options: Options) -> Channels:
    """The channels that the options state, or the notes of all recordings."""
    sides = {"input": list(options.inputs), "output": list(options.outputs)}
    for side, names in sides.items():
        noted = [_dataframe.noted_names(recordings[0].notes, recording.names, side) for recording in recordings]
        sides[side] = names or (noted[0] if all(noted) else [])
    both = [name for name in sides["input"] if name in sides["output"]]
    if both:
        raise ValueError(f"column '{both[0]}' is listed both as an input and as an output. List it only once")
    return Channels(sides["input"], sides["output"], options.experiment_column)


def columns(recordings: Sequence[Recording], clocks: Sequence[Clock], channels: Channels, options: Options) -> Columns:
    """The columns of the channels in each recording: the stated ones, or those whose names begin with u and y."""
    first = recordings[0]
    inputs = [first.names[first.need(name)] for name in channels.inputs]
    outputs = [first.names[first.need(name)] for name in channels.outputs]
    inputs = inputs or _beginning(first, clocks[0], channels, "u", outputs)
    outputs = outputs or _beginning(first, clocks[0], channels, "y", inputs)
    missing = "inputs" if not inputs else "outputs" if options.outputs_required and not outputs else ""
    if missing:
        header = f" (line {first.table.index[0] - 1} was taken for the header)" if first.counted == "line" else ""
        raise first.error(f"no column whose name begins with {'u' if missing == 'inputs' else 'y'} found among "
                          f"{first.labels()}{header}; name the {missing}")
    wanted = [first.label(first.need(name)) for name in (*inputs, *outputs)]
    of, remarks = [], []
    for recording, clock in zip(recordings, clocks):
        used, experiments = [recording.need(name) for name in wanted], channels.experiments(recording)
        of.append(used)
        odd = next((c for c, name in zip(used, wanted) if recording.label(c) != name), None)
        if odd is not None:
            raise recording.error(f"column '{recording.label(odd)}' found, {quoted(wanted)} needed: the units differ")
        if experiments in used:
            raise recording.error(f"column '{recording.names[experiments or 0]}' is stated as names of experiments and "
                                  "as a channel")
        more = [name for letter in "uy" for name in _beginning(recording, clock, channels, letter, (*inputs, *outputs))]
        if more and recording is not first and not channels.inputs and not channels.outputs:
            raise recording.error(f"column '{more[0]}' found, which {first.place} does not have. Name the inputs and "
                                  "outputs")
        filled = [c for c in range(len(recording.names)) if recording.names[c] or recording.table[c].notna().any()]
        unused = [recording.label(c) for c in filled if c not in (*used, experiments, *clock.columns)]
        if unused:
            verb = f"columns {quoted(unused)} are" if len(unused) > 1 else f"column {quoted(unused)} is"
            remarks.append(Remark(f"{verb} not used. To use a column, list it among the inputs or "
                                  "outputs", recording.place))
    return Columns(inputs, outputs, [first.units[column] for column in of[0]], of, remarks)


def _beginning(recording: Recording, clock: Clock, channels: Channels, letter: str, taken: Sequence[str]) -> list[str]:
    beside = {*clock.columns, channels.experiments(recording)}
    named = [
        name
        for c, name in enumerate(recording.names)
        if name.startswith(letter) and c not in beside and name not in taken
    ]
    return list(dict.fromkeys(named))
