# SPDX-License-Identifier: BSD-3-Clause
"""Experiments → model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Callable, Optional, TypeVar, Union

from . import _experiments, _identify_options, _options, _tokid
from ._channels import channel_texts
from ._ensemble import Ensemble
from ._errors import reading, warn, writing
from ._identify_options import IdentifyOptions
from ._model import Model, Origin, UpdateState
from ._progress import listener
from ._samples import description, with_remark
from ._typing import ArrayLike, PathLike, Progress
from .results import CrossValidation, NoisyChoices, Streamed, Validation

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]
    from typing_extensions import Unpack

Named = TypeVar("Named", Validation, CrossValidation)


def identify(
    u: Union[ArrayLike, Ensemble, pandas.DataFrame, xarray.Dataset],
    y: Optional[ArrayLike] = None,
    *,
    dt: Optional[float] = None,
    states: Union[int, str] = "auto",
    lags: Union[int, str] = "auto",
    method: str = "auto",
    smoothing: Union[float, str] = "auto",
    feedthrough: Union[bool, str, None] = None,
    period: Union[int, str] = 0,
    jumps: Union[int, str, Sequence[int]] = "auto",
    delays: Union[int, str, Sequence[int]] = "auto",
    weighting: str = "auto",
    output_weights: Union[str, Sequence[float]] = "equal",
    horizons: Union[int, str, Sequence[int]] = (1, 5, 20),
    refine: Union[bool, str, None] = None,
    initial_state: str = "auto",
    nominal: str = "auto",
    frame: str = "raw",
    reference_step: Optional[int] = None,
    hold_out: float = 0.0,
    outliers: str = "keep",
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
    on_model: Optional[Callable[[Model], Any]] = None,
) -> Model:
    """Identify a model of every step from repeated experiments.

    Parameters
    ----------
    u : array_like, shape (N, T, r) or (T, r), or list of N arrays, or Ensemble, DataFrame or Dataset
        Inputs of N experiments; or an ensemble; or a table as in `Ensemble.from_dataframe`; or a dataset as in
        `Ensemble.from_xarray`. The arrays of a list, (T_n, r) and (T_n, m), may have different lengths T_n.
    y : array_like, shape (N, T, m) or (T, m), or list of N arrays
        Outputs. NaN marks a missing sample, in `u` and in `y`.
    dt : float, optional
        Sample time [s] of arrays. Without it, dt is 1, and a `TokidWarning` reports this.
    states : int or "auto"
        State dimension n. "auto": the rank of the Hankel matrices without noise, else the order with the smallest
        errors.
    lags : int or "auto"
        Lag order p. "auto": the order with the smallest cross-validation error.
    method : {"auto", "tvera", "subspace", "regression"}
        Realisation. "auto": TVERA for data without noise from zero initial states, else the subspace realisation, or
        the regression itself, with a state for each lag of each output, where that predicts far better.
    smoothing : float or "auto"
        λ of the penalty on variation over time. 0: no penalty. "infinity": one model for all steps. "auto": by
        cross-validation if the data are noisy or too few for a regression at each step.
    feedthrough : bool, "auto" or None
        False: the outputs are known not to respond to the inputs of the same step, D = 0. State this where the inputs
        respond to the outputs of the same step: the data cannot distinguish such feedback from feedthrough. "auto" or
        None: true for data without noise, else by a test.
    period : int or "invariant", default 0
        P: the steps k, k + P, … share one model. "invariant" or 1: all steps do, and one record is enough. 0: each step
        has its own model.
    jumps : list of int, int, "none" or "auto"
        Ascending steps from which on the matrices are others, such as the step of a gear shift: the penalty of EM does
        not couple a step K with the step before. "auto": the steps that cross-validation finds, if the data are noisy.
    delays : list of r int, "none" or "auto"
        Dead time of each input in steps: as many states hold the inputs on their way. "auto": by cross-validation,
        unless `states` or `lags` is given.
    weighting : {"auto", "one-step", "many-steps", "projection"}
        The outputs that the states explain best: one step ahead, many steps ahead, or by projection (PO-MOESP). "auto":
        by cross-validation if steps share a model, else "one-step".
    output_weights : sequence of m floats or "equal"
        Weights of the outputs, from 0 on and not all 0; only their ratios matter. They act on the errors by which lags,
        smoothing, states, weighting and the use of EM are chosen, and on which states are kept if there are more than
        n. EM itself maximises the likelihood, whatever the weights are. "equal": all outputs count alike.
    horizons : sequence of int
        Steps ahead, ascending from 1 on, of the predictions whose errors choose states, EM and regressions. Those
        beyond half of the scored steps do not count. Others than the default ones must be at most half of the steps.
    refine : bool, "auto" or None
        Maximum likelihood by EM, as far as it lowers the cross-validation error. "auto" or None: for noisy data with the
        subspace realisation.
    initial_state : {"auto", "zero", "unknown"}
        States at step 0. "auto": as the data state them, else by a test.
    nominal : {"auto", "none", "mean"}
        Mean motion to remove. "auto": if it is significant.
    frame : {"raw", "reference", "smooth"}
        Coordinates of the states.
    reference_step : int, optional
        Step of the reference frame; by default the first one of full dimension.
    hold_out : float, default 0.0
        Share of the experiments to hold out for validation, 0 ≤ share < 1.
    outliers : {"keep", "drop", "downweight"}
        What to do about experiments and single samples that do not fit. "keep": name them, and use them. "drop": leave
        the experiments out, count the samples as missing, and identify again. "downweight": let the experiments count
        less, move the samples towards their predictions, and identify again.
    rows, cols : int or "auto"
        Blocks of the Hankel matrices of TVERA.
    choices : NoisyChoices, optional
        `Identification.choices` of an earlier identification of the same kind, to use again with its `lags`,
        `states` and `feedthrough.present`.
    keep_state : bool, default False
        Keep the factors of all regressions in `Model.state`. `tokid.update` adds later experiments to them.
    report : path, optional
        Page (.html) to write about whether the model can be trusted.
    length, free_y, input_names, output_names, input_units, output_units, experiment_names
        As in `Ensemble`, for arrays. For a DataFrame, the names choose the columns that are inputs and outputs.
    threads : int, default 1
        Number of threads; 0: all of the machine. The result has the same bits for any number.
    progress : bool or callable, default False
        True: show a bar, of tqdm if it is installed. A callable gets the finished share of the work, from 0 to 1, as
        a `ProgressShare`: a float with the attribute `stage`.
    on_model : callable, optional
        Gets the first model, if the data are noisy and EM may refine it. It is called once, within the call.

    Returns
    -------
    Model
        Its `identification` has the verdict, and the evidence for every choice. Its `warnings` are also issued as
        `TokidWarning`.

    Raises
    ------
    ValueError
        If the data lack experiments, steps or excitation, or if an option is wrong. The message names what is missing.

    Notes
    -----
    The call releases the GIL. Ctrl-C stops it.

    Examples
    --------
    >>> data = tokid.example("oscillator", experiments=60, steps=40)
    >>> model = tokid.identify(data.u, data.y, dt=data.dt)
    >>> model
    <tokid.Model: n = 4 states, r = 2 inputs, m = 2 outputs, steps 0 to 39, dt = 0.05 s>
    """
    options = _identify_options.checked(_identify_options.among(locals()))
    if on_model is not None and not callable(on_model):
        raise ValueError(f"on_model: {on_model!r} found, a function needed")
    described = {**description(locals()), "initial_state": None}  # the option of the identification is another one
    core, remark = _experiments.to_identify(u, y, dt, described)
    reported = core.remarks() if isinstance(u, Ensemble) else []
    with listener(progress, "identify") as listening:
        model, evidence, verdict, state = _remarked(
            remark,
            _tokid.identify,
            core,
            options,
            _options.threads(threads),
            listening,
            _options.switch("keep_state", keep_state),
            report,
            None if on_model is None else lambda first: on_model(Model._of(first)),
        )
    evidence = replace(evidence, validation=_named(evidence.validation, core), verdict=verdict)
    warn(text for text in with_remark(evidence.warnings, core, remark) if text not in reported)
    kept = None if state is None else UpdateState._of(state)
    return Model._of(model, Origin(evidence.findings, evidence, state=kept))


def cross_validate(
    u: Union[ArrayLike, Ensemble],
    y: Optional[ArrayLike] = None,
    *,
    folds: int = 5,
    horizon: int = 1,
    seed: Optional[int] = None,
    first_step: int = 0,
    dt: Optional[float] = None,
    length: Optional[ArrayLike] = None,
    free_y: Optional[ArrayLike] = None,
    threads: int = 1,
    progress: Progress = False,
    **options: Unpack[IdentifyOptions],
) -> CrossValidation:
    """Cross-validate an identification: each fold is held out once, and a model of the other folds predicts it.

    Each identification makes all choices that the options leave open.

    Parameters
    ----------
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
        Experiments.
    folds : int, default 5
        Number of folds, from 2 to N.
    horizon : int, default 1
        Steps ahead of the predictions for `CrossValidation.horizon`.
    seed : int, optional
        Seed of a random order of the experiments. By default, experiment n is in fold n mod `folds`.
    first_step : int, default 0
        First step of the fits.
    dt, length, free_y
        As in `Ensemble`, for arrays.
    threads, progress
        As in `identify`.
    **options
        Options of the identification, as in `identify`.

    Returns
    -------
    CrossValidation

    See Also
    --------
    Model.cross_validate : uses the options of the identification of a model.
    """
    checked = _identify_options.checked(options)
    core, remark = _experiments.to_identify(u, y, dt, {"length": length, "free_y": free_y})
    with listener(progress, "cross-validate") as listening:
        result: CrossValidation = _remarked(
            remark,
            _tokid.cross_validate,
            core,
            checked,
            **_options.cross_validation(folds, horizon, seed, first_step, threads),
            listener=listening,
        )
    warn(result.warnings)
    return replace(_named(result, core), steps_ahead=int(horizon))


def identify_file(
    data: PathLike,
    model: PathLike,
    *,
    block: Union[int, str] = "auto",
    memory_per_thread: float = 100e6,
    threads: int = 1,
    progress: Progress = False,
    **options: Unpack[IdentifyOptions],
) -> Streamed:
    """Identify an .h5 file that is larger than memory, in blocks of steps, and write the model block by block.

    The memory depends on N, r + m, the lag order and the length of the blocks, but not on T.

    Parameters
    ----------
    data : path
        File of the ensemble (.h5).
    model : path
        File of the model (.h5). It appears as a whole or not at all.
    block : int or "auto"
        Steps of a block. "auto": the number that fits `memory_per_thread`.
    memory_per_thread : float, default 100e6
        Memory of each thread [bytes].
    threads, progress
        As in `identify`.
    **options
        Options of the identification, as in `identify`. Open choices are made from the first steps.

    Returns
    -------
    Streamed
        `Model.load` reads the model.

    Raises
    ------
    ValueError
        As in `identify`, and for options that need all steps at once: a period, one model for all steps, the reference
        frame.
    IoError
        If a file can't be read in blocks or can't be written. It is an OSError.
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
            threads=_options.threads(threads),
            listener=listening,
        )
    warn(result.identification.warnings)
    return result


def _named(result: Named, core: _tokid.Ensemble) -> Named:
    """The result with the names of the outputs of the data."""
    return replace(result, output_names=channel_texts(core, "output_names"))


def _remarked(remark: str, call: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Call the extension, and add a remark to its errors."""
    try:
        return call(*arguments, **options)
    except ValueError as error:
        # An error with more frames comes from the listener that the user passed, not from the extension.
        if not remark or remark in str(error) or error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise
        raise ValueError(f"{error}; {remark}") from None
