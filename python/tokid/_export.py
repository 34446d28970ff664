# SPDX-License-Identifier: BSD-3-Clause
"""Models and controllers as C99 source."""

from __future__ import annotations

from typing import Optional

from . import _options, _tokid
from ._controller import Controller
from ._errors import writing
from ._state_space import StateSpace
from ._typing import PathLike
from .results import ExportedCode, Operations


def export_c(
    model: StateSpace,
    path: PathLike,
    controller: Optional[Controller],
    name: Optional[str],
    single_precision: bool,
    start_from_zero: bool,
) -> ExportedCode:
    if controller is not None and not isinstance(controller, Controller):
        raise ValueError(f"controller: {type(controller).__name__} found, a tokid.Controller needed")
    if name is not None and not (isinstance(name, str) and name):
        raise ValueError(f"name: {name!r} found, a text needed")
    core = None if controller is None else controller._core
    with writing(path) as file:
        found = _tokid.export_c(
            model._core,
            file,
            core,
            _options.text("name", name),
            _options.switch("single_precision", single_precision),
            _options.switch("start_from_zero", start_from_zero),
        )
    prefix, tables, state, steps, step, missing, control = found
    return ExportedCode(prefix, tables, state, steps, Operations(*step), Operations(*missing), Operations(*control))
