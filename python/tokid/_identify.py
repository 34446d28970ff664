# SPDX-License-Identifier: BSD-3-Clause
"""From experiments to a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

from . import _experiments, _identify_options, _options, _tokid
from ._ensemble import Ensemble
from ._errors import reading, warn, writing
from ._identify_options import IdentifyOptions
from ._model import Model, UpdateState
from ._progress import listener
from ._samples import with_remark
from ._typing import ArrayLike, PathLike, Progress
from .results import CrossValidation, NoisyChoices, Streamed

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]
    from typing_extensions import Unpack


def identify(
    u: Union[ArrayLike, Ensemble, pandas.DataFrame, xarray.Dataset],
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
    choices: Optional[NoisyChoices] = None,
    keep_state: bool = False,
    report: Optional[PathLike] = None,
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    input_names: Optional[Sequence[str]] = None,
    output_names: Optional[Sequence[str]] = None,
    input_units: Optional[Sequence[str]] = None,
    output_units: Optional[Sequence[str]] = None,
    experiment_names: Optional[Iterable[Any]] = None,
    threads: int = 1,
    progress: Progress = False,
) -> Model:
    """Identifies a model of every step from repeated experiments.

    Parameters
    ----------
    u : array_like, shape (N, T, r) or (T, r), or Ensemble, DataFrame or Dataset
        Inputs of N experiments; or an ensemble, which holds everything that is known of the data; or a tidy table of
        pandas, as of `Ensemble.from_dataframe`, or a dataset of xarray, as of `Ensemble.from_xarray`.
    y : array_like, shape (N, T, m) or (T, m)
        Outputs. NaN marks a missing sample, in `u` as in `y`.
    dt : float, optional
        Sample time [s] of arrays. Without it 1 is taken, and a `TokidWarning` says so.
    states : int or "auto"
        State dimension n. "auto": the rank of the Hankel matrices, or by errors where the data are noisy.
    lags : int or "auto"
        Lag order p. "auto": the smallest error on experiments left out.
    method : {"auto", "tvera", "subspace"}
        Realisation. "auto": tvera without noise from zero initial states, else subspace.
    smoothing : float or "auto"
        Penalty λ on variation in time: 0 none, "infinity" one model. "auto": by errors on experiments left out.
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
    choices : NoisyChoices, optional
        `Identification.choices` of an earlier identification of the same kind, to be followed with its `lags` and
        `states`.
    keep_state : bool, default False
        Keep the factors of all regressions in `Model.state`, to which `tokid.update` adds later experiments.
    report : path, optional
        Page (.html) to write that shows whether the model can be trusted.
    length, free_y, input_names, output_names, input_units, output_units, experiment_names
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
    options = _identify_options.checked(
        {
            "states": states,
            "lags": lags,
            "method": method,
            "smoothing": smoothing,
            "period": period,
            "weighting": weighting,
            "refine": refine,
            "initial_state": initial_state,
            "nominal": nominal,
            "frame": frame,
            "reference_step": reference_step,
            "hold_out": hold_out,
            "rows": rows,
            "cols": cols,
            "choices": choices,
        }
    )
    described = {
        "length": length,
        "free_y": free_y,
        "input_names": input_names,
        "output_names": output_names,
        "input_units": input_units,
        "output_units": output_units,
        "experiment_names": experiment_names,
    }
    core, remark = _experiments.to_identify(u, y, dt, described)
    told = core.remarks() if isinstance(u, Ensemble) else []
    with listener(progress, "identify") as listening:
        model, evidence, state = _remarked(
            remark,
            _tokid.identify,
            core,
            options,
            _options.threads(threads),
            listening,
            bool(keep_state),
            report,
            _options.page("model", "data", 10, 24),
        )
    warn(text for text in with_remark(evidence.warnings, core, remark) if text not in told)
    kept = None if state is None else UpdateState._of(state)
    return Model._of(model, evidence.findings, identification=evidence, state=kept)


def cross_validate(
    u: Union[ArrayLike, Ensemble],
    y: Optional[ArrayLike] = None,
    *,
    folds: int = 5,
    horizon: int = 1,
    seed: Optional[int] = None,
    dt: Optional[float] = None,
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    threads: int = 1,
    progress: Progress = False,
    **options: Unpack[IdentifyOptions],
) -> CrossValidation:
    """Judges a way of identification: every experiment by a model that has not seen it.

    Identifies once per fold on the other experiments, leaving to each identification all choices that are left open.

    Parameters
    ----------
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
        Experiments.
    folds : int, default 5
        Parts that are left out in turn, from 2 to N.
    horizon : int, default 1
        Steps ahead of `CrossValidation.horizon`.
    seed : int, optional
        Experiments in random order; by default experiment n is in fold n mod `folds`.
    dt, length, free_y
        As of `Ensemble`, for arrays.
    threads, progress
        As of `identify`.
    **options
        How to identify, as of `identify`.

    Returns
    -------
    CrossValidation

    See Also
    --------
    Model.cross_validate : with the options that a model was identified with.
    """
    checked = _identify_options.checked(options)
    core, remark = _experiments.to_identify(u, y, dt, {"length": length, "free_y": free_y})
    with listener(progress, "cross-validate") as listening:
        result: CrossValidation = _remarked(
            remark,
            _tokid.cross_validate,
            core,
            checked,
            **_options.cross_validation(folds, horizon, seed, threads),
            listener=listening,
        )
    warn(result.warnings)
    return result


def identify_file(
    data: PathLike,
    model: PathLike,
    *,
    block: Union[int, str] = "auto",
    memory_per_thread: float = 100e6,
    resume: bool = False,
    threads: int = 1,
    progress: Progress = False,
    **options: Unpack[IdentifyOptions],
) -> Streamed:
    """Identifies an .h5 that is larger than memory, in blocks of steps, and writes the model as they finish.

    Memory depends on N, r + m, the lag order and the length of the blocks, but not on T.

    Parameters
    ----------
    data : path
        Ensemble (.h5).
    model : path
        Model to write (.h5), whole or not at all.
    block : int or "auto"
        Steps of a block; "auto": as many as `memory_per_thread` holds.
    memory_per_thread : float, default 100e6
        Bytes.
    resume : bool, default False
        Keep finished blocks in a journal, the model's path and ".resume", until the model is there; and go on from that
        of a call that was stopped, to a model of the same bits.
    threads, progress
        As of `identify`.
    **options
        How to identify, as of `identify`; what is left to be chosen is chosen from stretches at the begin, middle and
        end.

    Returns
    -------
    Streamed
        `Model.load` reads the model.

    Raises
    ------
    ValueError
        As `identify`, and for what needs all steps at once: a period, one model for all steps, the reference frame.
    IoError
        For a file that can't be read in blocks, or not be written, and for a journal of other data or options; an
        OSError.
    """
    checked = _identify_options.checked(options)
    steps = 0 if block == "auto" else _options.integer("block", block, 1, 1_000_000_000, " or 'auto'")
    with listener(progress, "identify") as listening, writing(model) as to, reading(data) as file:
        result: Streamed = _tokid.identify_stream(
            file,
            to,
            checked,
            block=steps,
            memory_per_thread=_options.real("memory_per_thread", memory_per_thread, 1.0),
            resume=bool(resume),
            threads=_options.threads(threads),
            listener=listening,
        )
    warn(result.identification.warnings)
    return result


def _remarked(remark: str, call: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """The result of a call of the extension, to whose own errors a remark is added."""
    try:
        return call(*arguments, **options)
    except ValueError as error:
        # One that a listener raised comes from frames behind this one.
        if not remark or remark in str(error) or error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise
        raise ValueError(f"{error}; {remark}") from None
