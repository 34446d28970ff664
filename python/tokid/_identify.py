# SPDX-License-Identifier: BSD-3-Clause
"""From experiments to a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional, Union

from . import _dataframe, _options, _tokid
from ._ensemble import Ensemble, core_of, describe
from ._errors import warn
from ._model import Model
from ._progress import listener
from ._typing import ArrayLike, Progress

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]


def identify(
    u: Union[ArrayLike, Ensemble, pandas.DataFrame],
    y: Optional[ArrayLike] = None,
    *,
    dt: Optional[float] = None,
    states: Union[int, str] = "auto",
    lags: Union[int, str] = "auto",
    method: str = "auto",
    smoothing: Union[float, str] = "auto",
    period: Union[int, str] = 0,
    weighting: str = "auto",
    refine: Union[bool, str, None] = None,
    initial_state: str = "auto",
    nominal: str = "auto",
    frame: str = "raw",
    reference_step: Optional[int] = None,
    hold_out: float = 0.0,
    rows: Union[int, str] = "auto",
    cols: Union[int, str] = "auto",
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    input_names: Optional[Sequence[str]] = None,
    output_names: Optional[Sequence[str]] = None,
    input_units: Optional[Sequence[str]] = None,
    output_units: Optional[Sequence[str]] = None,
    threads: int = 1,
    progress: Progress = False,
) -> Model:
    """Identifies a model of every step from repeated experiments.

    Parameters
    ----------
    u : array_like, shape (N, T, r) or (T, r), or Ensemble, or DataFrame
        Inputs of N experiments; or an ensemble, which holds everything that is known of the data; or a tidy table of
        pandas, as of `Ensemble.from_dataframe`.
    y : array_like, shape (N, T, m) or (T, m)
        Outputs. NaN marks a missing sample, in `u` as in `y`.
    dt : float, default 1.0
        Sample time [s].
    states : int or "auto"
        State dimension n. "auto": the rank of the Hankel matrices, or by errors where the data are noisy.
    lags : int or "auto"
        Lag order p. "auto": the smallest error on experiments left out.
    method : {"auto", "tvera", "subspace"}
        Realisation. "auto": tvera without noise from zero initial states, else subspace.
    smoothing : float or "auto"
        Penalty λ on variation in time: 0 none, infinity one model. "auto": by errors on experiments left out.
    period : int or "invariant", default 0
        P: the steps k, k + P, … share one model; "invariant" (or 1): all steps, for which a single record is enough;
        0: each has its own.
    weighting : {"auto", "one-step", "many-steps", "projection"}
        What the states must explain. "auto": by errors on experiments left out; "projection": PO-MOESP.
    refine : bool or None
        Maximum likelihood by EM, as far as it lowers errors on experiments left out. None: for noisy data.
    initial_state : {"auto", "zero", "unknown"}
        States at step 0. "auto": as the data say, else by test.
    nominal : {"auto", "none", "mean"}
        Mean motion to remove. "auto": where it is significant.
    frame : {"raw", "reference", "smooth"}
        Coordinates of the states.
    reference_step : int, optional
        Step of the reference frame; by default the first one of full dimension.
    hold_out : float, default 0.0
        Share of the experiments kept for validation, from 0 to below 1.
    rows, cols : int or "auto"
        Blocks of the Hankel matrices of tvera.
    length, free_y, input_names, output_names, input_units, output_units
        As of `Ensemble`, for arrays. Of a DataFrame the names choose the columns that are inputs and outputs.
    threads : int, default 1
        Threads, 0 for all of the machine. The result is the same to the last bit for any number.
    progress : bool or callable, default False
        True shows a bar (of tqdm, where that is installed); a callable gets the finished share of the work, 0 … 1.

    Returns
    -------
    Model
        Its `identification` holds the evidence for every choice, and its `warnings` are issued as `TokidWarning` too.

    Raises
    ------
    ValueError
        Names what the data lack: experiments (and which lag order would do), steps, excitation; or the option that is
        wrong.

    Notes
    -----
    The GIL is released; Ctrl-C stops the call.

    Examples
    --------
    >>> data = tokid.example("oscillator", experiments=60, steps=40)
    >>> model = tokid.identify(data.u, data.y, dt=data.dt)
    >>> model
    <tokid.Model: n = 4 states, r = 2 inputs, m = 2 outputs, steps 0 to 39, dt = 0.05 s>
    """
    if reference_step is not None and frame != "reference":
        raise ValueError("reference_step: needs frame 'reference'")
    options = _tokid.IdentifyOptions()
    options.states = _options.count_or_auto("states", states)
    options.lags = _options.count_or_auto("lags", lags)
    options.method = _options.choice("method", method, _options.METHODS)
    penalty = _options.smoothing(smoothing)
    options.smoothing = -1.0 if penalty is None else penalty
    options.period = _options.period(period)
    options.weighting = _options.choice("weighting", weighting, _options.WEIGHTINGS)
    options.refine = _options.refinement(refine)
    options.initial_state = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
    options.nominal = _options.choice("nominal", nominal, _options.NOMINALS)
    options.frame = _options.choice("frame", frame, _options.FRAMES)
    options.reference_step = _options.step("reference_step", reference_step)
    options.hold_out = _options.real("hold_out", hold_out, 0.0, 1.0)
    options.rows = _options.count_or_auto("rows", rows)
    options.cols = _options.count_or_auto("cols", cols)
    described = {
        "length": length,
        "free_y": free_y,
        "input_names": input_names,
        "output_names": output_names,
        "input_units": input_units,
        "output_units": output_units,
    }
    core = ensemble_core(u, y, dt, described)
    with listener(progress, "identify") as listening:
        model, evidence = _tokid.identify(core, options, _options.threads(threads), listening)
    warn(evidence.warnings)
    return Model._of(model, evidence, evidence.warnings)


def ensemble_core(u: Any, y: Any, dt: Optional[float], described: dict[str, Any]) -> _tokid.Ensemble:
    """The data of a call, an ensemble or arrays with what is said of them."""
    if _dataframe.is_dataframe(u):
        if y is not None:
            raise ValueError("y: found beside a DataFrame, which has the outputs already")
        return _dataframe.core_from(u, dt, described)
    if isinstance(u, Ensemble):
        for name, value in {"y": y, "dt": dt, **described}.items():
            if value is not None:
                raise ValueError(f"{name}: found beside an Ensemble, which has it already")
        return u._core
    if y is None:
        raise ValueError("y: none found, outputs (N, T, m) needed")
    core, _ = core_of(u, y, 1.0 if dt is None else dt)
    describe(core, initial_state=None, **described)
    return core
