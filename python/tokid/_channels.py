# SPDX-License-Identifier: BSD-3-Clause
"""Inputs and outputs, with their names and units."""

from __future__ import annotations

from typing import Union

from . import _tokid
from ._held import Held

_DEFAULTS = {"input_names": "u{}", "output_names": "y{}", "input_units": "", "output_units": ""}


def channel_texts(core: Union[_tokid.Ensemble, _tokid.Model], which: str) -> list[str]:
    """The names or units of all inputs or outputs. `which` is "input_names", "output_units", …

    Without names in the data, they are u1 … ur and y1 … ym. Unknown units are "".
    """
    count: int = core.inputs if which.startswith("input") else core.outputs
    given: list[str] = getattr(core, which)
    return given or [_DEFAULTS[which].format(i + 1) for i in range(count)]


class Channels:
    """The inputs and outputs of an ensemble or a model."""

    _core: Union[_tokid.Ensemble, _tokid.Model]
    __slots__ = ()

    inputs = Held[int]("Number of inputs r.")
    outputs = Held[int]("Number of outputs m.")
    input_names = Held("Names (r) of the inputs; u1 … ur if none were given.", channel_texts)
    output_names = Held("Names (m) of the outputs; y1 … ym if none were given.", channel_texts)
    input_units = Held('Units (r) of the inputs; "" if not known.', channel_texts)
    output_units = Held('Units (m) of the outputs; "" if not known.', channel_texts)
