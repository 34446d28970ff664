# SPDX-License-Identifier: BSD-3-Clause
"""The options of an identification."""

from __future__ import annotations

from typing import Optional, TypedDict, Union

from . import _options, _tokid
from .results import NoisyChoices

WEIGHTINGS = {
    "auto": None,
    "one-step": _tokid.Weighting.one_step,
    "many-steps": _tokid.Weighting.many_steps,
    "projection": _tokid.Weighting.projection,
}
METHODS = {"auto": _tokid.Method.auto, "tvera": _tokid.Method.tvera, "subspace": _tokid.Method.subspace}
NOMINALS = {"auto": _tokid.NominalChoice.auto, "none": _tokid.NominalChoice.none, "mean": _tokid.NominalChoice.mean}
FRAMES = {"raw": _tokid.Frame.raw, "reference": _tokid.Frame.reference, "smooth": _tokid.Frame.smooth}


class IdentifyOptions(TypedDict, total=False):
    """The options of `tokid.identify` that say how to identify, for the calls that identify more than once."""

    states: Union[int, str]
    lags: Union[int, str]
    method: str
    smoothing: Union[float, str]
    period: Union[int, str]
    weighting: str
    refine: Union[bool, str, None]
    initial_state: str
    nominal: str
    frame: str
    reference_step: Optional[int]
    hold_out: float
    rows: Union[int, str]
    cols: Union[int, str]
    choices: Optional[NoisyChoices]


def checked(options: IdentifyOptions) -> _tokid.IdentifyOptions:
    """The options of an identification, each one checked."""
    unknown = set(options) - set(IdentifyOptions.__annotations__)
    if unknown:
        raise TypeError(f"{sorted(unknown)[0]!r} is no option of an identification")
    get = options.get
    if get("reference_step") is not None and get("frame", "raw") != "reference":
        raise ValueError("reference_step: needs frame 'reference'")
    result = _tokid.IdentifyOptions()
    result.states = _options.count_or_auto("states", get("states", "auto"))
    result.lags = _options.count_or_auto("lags", get("lags", "auto"))
    result.method = _options.choice("method", get("method", "auto"), METHODS)
    penalty = _options.smoothing(get("smoothing", "auto"))
    result.smoothing = -1.0 if penalty is None else penalty
    result.period = _options.period(get("period", 0))
    result.weighting = _options.choice("weighting", get("weighting", "auto"), WEIGHTINGS)
    result.refine = _options.refinement(get("refine"))
    result.initial_state = _options.choice("initial_state", get("initial_state", "auto"), _options.INITIAL_STATES)
    result.nominal = _options.choice("nominal", get("nominal", "auto"), NOMINALS)
    result.frame = _options.choice("frame", get("frame", "raw"), FRAMES)
    result.reference_step = _options.step("reference_step", get("reference_step"))
    result.hold_out = _options.share("hold_out", get("hold_out", 0.0))
    result.rows = _options.count_or_auto("rows", get("rows", "auto"))
    result.cols = _options.count_or_auto("cols", get("cols", "auto"))
    choices = get("choices")
    if choices is not None:
        result.follow(choices)
    return result
