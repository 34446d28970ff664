# SPDX-License-Identifier: BSD-3-Clause
"""The options of an identification."""

from __future__ import annotations

from typing import Any, Optional, Sequence, TypedDict, Union, cast

from . import _tokid
from .results import NoisyChoices


class IdentifyOptions(TypedDict, total=False):
    """The options of the identification in `tokid.identify`, for calls that identify more than once."""

    states: Union[int, str]
    lags: Union[int, str]
    method: str
    smoothing: Union[float, str]
    feedthrough: Union[bool, str, None]
    period: Union[int, str]
    jumps: Union[int, str, Sequence[int]]
    delays: Union[int, str, Sequence[int]]
    weighting: str
    output_weights: Union[str, Sequence[float]]
    horizons: Union[int, str, Sequence[int]]
    refine: Union[bool, str, None]
    initial_state: str
    nominal: str
    frame: str
    reference_step: Optional[int]
    hold_out: float
    outliers: str
    rows: Union[int, str]
    cols: Union[int, str]
    choices: Optional[NoisyChoices]


def among(arguments: dict[str, Any]) -> IdentifyOptions:
    """Select the options of an identification among the arguments of a call."""
    return cast(IdentifyOptions, {key: arguments[key] for key in IdentifyOptions.__annotations__})


def checked(options: IdentifyOptions) -> _tokid.IdentifyOptions:
    """Check the options of an identification."""
    unknown = set(options) - set(IdentifyOptions.__annotations__)
    if unknown:
        raise TypeError(f"{sorted(unknown)[0]!r} is no option of an identification")
    get = options.get
    if get("reference_step") is not None and get("frame", "raw") != "reference":
        raise ValueError("reference_step: needs frame 'reference'")
    result = _tokid.IdentifyOptions()
    for key, value in options.items():
        if key != "choices":
            result.set(key, value)
    choices = get("choices")
    if choices is not None:
        if not isinstance(choices, NoisyChoices):
            raise ValueError(f"choices: {type(choices).__name__} found, the choices of an identification needed")
        result.follow(choices)
    return result
