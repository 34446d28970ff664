# SPDX-License-Identifier: BSD-3-Clause
"""Inputs and outputs, with their names and units."""

from __future__ import annotations

from typing import Union

from . import _tokid


Core = Union[_tokid.Ensemble, _tokid.Model]


def input_names(core: Core) -> list[str]:
    """Names (r) of the inputs, u1 … ur where none were given."""
    return core.input_names or [f"u{i + 1}" for i in range(core.inputs)]


def output_names(core: Core) -> list[str]:
    """Names (m) of the outputs, y1 … ym where none were given."""
    return core.output_names or [f"y{j + 1}" for j in range(core.outputs)]


def input_units(core: Core) -> list[str]:
    """Units (r) of the inputs, "" where they are not known."""
    return core.input_units or [""] * core.inputs


def output_units(core: Core) -> list[str]:
    """Units (m) of the outputs, "" where they are not known."""
    return core.output_units or [""] * core.outputs


class Channels:
    """What ensembles and models say of their inputs and outputs."""

    _core: Core
    __slots__ = ()

    @property
    def inputs(self) -> int:
        """Number of inputs r."""
        return self._core.inputs

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self._core.outputs

    @property
    def input_names(self) -> list[str]:
        """Names (r) of the inputs, u1 … ur where none were given."""
        return input_names(self._core)

    @property
    def output_names(self) -> list[str]:
        """Names (m) of the outputs, y1 … ym where none were given."""
        return output_names(self._core)

    @property
    def input_units(self) -> list[str]:
        """Units (r) of the inputs, "" where they are not known."""
        return input_units(self._core)

    @property
    def output_units(self) -> list[str]:
        """Units (m) of the outputs, "" where they are not known."""
        return output_units(self._core)
