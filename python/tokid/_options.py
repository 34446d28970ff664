# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the options of a user, and their values for the library."""

from __future__ import annotations

import math
import numbers
import sys
from collections.abc import Mapping
from typing import Any, Optional, TypeVar

import numpy as np

from . import _tokid

T = TypeVar("T")


def choice(name: str, value: Any, choices: Mapping[str, T]) -> T:
    """The value of one of several words."""
    if isinstance(value, str) and value in choices:
        return choices[value]
    raise ValueError(f"{name}: {value!r} found, one of {', '.join(map(repr, choices))} needed")


def integer(name: str, value: Any, smallest: int, largest: Optional[int] = None, or_else: str = "") -> int:
    """A whole number in a range. Integers of NumPy are allowed, floats and booleans are not."""
    wanted = f"a whole number from {smallest} {'on' if largest is None else f'to {largest}'}{or_else}"
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise ValueError(f"{name}: {value!r} found, {wanted} needed")
    whole = int(value)
    if whole < smallest or (largest is not None and whole > largest):
        raise ValueError(f"{name}: {whole} found, {wanted} needed")
    return whole


def count_or_auto(name: str, value: Any) -> int:
    """A positive whole number, or 0 for "auto"."""
    return 0 if isinstance(value, str) and value == "auto" else integer(name, value, 1, None, " or 'auto'")


def number(name: str, value: Any) -> float:
    """A number. An array without axes is one, too, because files of NumPy hold numbers as such arrays."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise ValueError(f"{name}: {value!r} found, a number needed")
    return float(value)


def switch(name: str, value: Any, or_else: str = "") -> bool:
    """True or False. A text such as "no" would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}: {value!r} found, True or False{or_else} needed")
    return bool(value)


def real(name: str, value: Any, smallest: float, largest: float = sys.float_info.max, or_else: str = "") -> float:
    """A number in a range, not NaN. Infinity is no number, unless it is the largest one."""
    wanted = f"a number from {smallest:g} {'on' if largest >= sys.float_info.max else f'to {largest:g}'}{or_else}"
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not smallest <= float(value) <= largest:
        raise ValueError(f"{name}: {value!r} found, {wanted} needed")
    return float(value)


def text(name: str, value: Any) -> str:
    """A text that is not empty, or "" for None."""
    if value is not None and (not isinstance(value, str) or not value):
        raise ValueError(f"{name}: {value!r} found, a text needed")
    return value or ""


def smoothing(value: Any) -> Optional[float]:
    """λ ≥ 0, infinity included; None for "auto"."""
    if isinstance(value, str):
        if value == "auto":
            return None
        if value in ("infinity", "inf"):
            return math.inf
    return real("smoothing", value, 0.0, math.inf, ", 'infinity' or 'auto'")


def feedthrough(value: Any) -> Optional[bool]:
    """None for "auto"."""
    if value is None or (isinstance(value, str) and value == "auto"):
        return None
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"feedthrough: {value!r} found, True, False or 'auto' needed")
    return bool(value)


def period(value: Any) -> int:
    """The period P: 1 for "invariant", 0 without a period."""
    if isinstance(value, str) and value == "invariant":
        return 1
    return integer("period", value, 0, 1_000_000, " or 'invariant'")


def step(name: str, value: Any) -> int:
    """A step ≥ 0, or -1 for None."""
    return -1 if value is None else integer(name, value, 0, 1_000_000_000)


def initial_state(value: Any) -> Optional[_tokid.InitialState]:
    """The stated initial state; None for "auto"."""
    return choice("initial_state", value, {"auto": None, **_tokid.InitialState.__members__})


def known_initial_state(value: Any) -> _tokid.InitialState:
    """The stated initial state, "zero" or "unknown"."""
    return choice("initial_state", value, _tokid.InitialState.__members__)


def threads(value: Any) -> int:
    """A number of threads; 0 means all of the machine."""
    return integer("threads", value, 0, 1024)


def cross_validation(folds: Any, horizon: Any, seed: Any, first_step: Any, processors: Any) -> dict[str, Any]:
    """The options of a cross-validation, without those of its identifications."""
    return {
        "folds": integer("folds", folds, 2),
        "horizon": integer("horizon", horizon, 1, 1_000_000),
        "seed": None if seed is None else integer("seed", seed, 0, 2**64 - 1),
        "first_step": integer("first_step", first_step, 0),
        "threads": threads(processors),
    }
