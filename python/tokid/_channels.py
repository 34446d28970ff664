# SPDX-License-Identifier: BSD-3-Clause
"""Inputs and outputs, with their names and units."""

from __future__ import annotations

from typing import Union

from . import _tokid


class Channels:
    """What ensembles and models say of their inputs and outputs."""

    _core: Union[_tokid.Ensemble, _tokid.Model]
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
        return self._core.input_names or [f"u{i + 1}" for i in range(self.inputs)]

    @property
    def output_names(self) -> list[str]:
        """Names (m) of the outputs, y1 … ym where none were given."""
        return self._core.output_names or [f"y{j + 1}" for j in range(self.outputs)]

    @property
    def input_units(self) -> list[str]:
        """Units (r) of the inputs, "" where they are not known."""
        return self._core.input_units or [""] * self.inputs

    @property
    def output_units(self) -> list[str]:
        """Units (m) of the outputs, "" where they are not known."""
        return self._core.output_units or [""] * self.outputs
