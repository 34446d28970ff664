# SPDX-License-Identifier: BSD-3-Clause
"""Identification of linear time-varying systems from repeated experiments.

From N experiments of T steps, with inputs ``u`` (N, T, r) and outputs ``y`` (N, T, m), tokid identifies a model of
every step::

    x[k+1] = A[k] x[k] + B[k] u[k]
    y[k]   = C[k] x[k] + D[k] u[k]

The model includes an observer, and the evidence for every choice of the identification.

>>> import tokid
>>> data = tokid.example("oscillator", experiments=60, steps=40)
>>> model = tokid.identify(data, hold_out=0.2)
>>> model.states
4
"""

from typing import TYPE_CHECKING, Any

from . import stages as stages
from ._controller import Controller
from ._ensemble import Ensemble
from ._errors import IoError, TokidWarning
from ._example import example, example_system, paper
from ._files import load
from ._identify import cross_validate, identify, identify_file
from ._learning import LiftedMap
from ._lock import FileLock
from ._model import Model, UpdateState
from ._observer import Observer
from ._plan import plan
from ._read import read
from ._state_space import MatrixSequence, Step
from ._tokid import version as __version__
from ._typing import ProgressShare
from ._update import update
from .results import (
    ClosedLoop,
    Confidence,
    CrossValidation,
    ExpectedCost,
    ExportedCode,
    Finding,
    Fit,
    FunctionBounds,
    Identification,
    Interval,
    LearnedRun,
    Modes,
    Observation,
    Plan,
    Refinement,
    Validation,
    Verdict,
)

if TYPE_CHECKING:
    from . import interop as interop
    from . import plot as plot

__all__ = [
    "ClosedLoop",
    "Confidence",
    "Controller",
    "CrossValidation",
    "Ensemble",
    "ExpectedCost",
    "ExportedCode",
    "FileLock",
    "Finding",
    "Fit",
    "FunctionBounds",
    "Identification",
    "Interval",
    "IoError",
    "LearnedRun",
    "LiftedMap",
    "MatrixSequence",
    "Model",
    "Modes",
    "Observation",
    "Observer",
    "Plan",
    "ProgressShare",
    "Refinement",
    "Step",
    "TokidWarning",
    "UpdateState",
    "Validation",
    "Verdict",
    "__version__",
    "cross_validate",
    "example",
    "example_system",
    "identify",
    "identify_file",
    "load",
    "paper",
    "plan",
    "read",
    "stages",
    "update",
]

_LATER = ("interop", "plot")  # imported on first access, because these modules need other packages


def __getattr__(name: str) -> Any:
    if name in _LATER:
        from importlib import import_module

        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
