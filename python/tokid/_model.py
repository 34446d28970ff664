# SPDX-License-Identifier: BSD-3-Clause
"""Models with the evidence of the calls that made them, and update states."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Optional, Union, overload

import numpy as np

from . import (
    _arrays,
    _control,
    _dataframe,
    _dataset,
    _display,
    _experiments,
    _learning,
    _options,
    _tokid,
)
from ._bytes import bytes_of, from_bytes
from ._controller import Controller
from ._ensemble import Ensemble
from ._errors import reading, warn, writing
from ._held import Held
from ._learning import LiftedMap
from ._lock import FileLock
from ._observer import Observer
from ._progress import listener
from ._samples import labels_of, name_channels, named, plural
from ._state_space import LISTS, StateSpace, core_from, matrices_of, state_of
from ._typing import Array, ArrayLike, ComplexArray, PathLike, Progress
from .results import (
    Additions,
    Confidence,
    CrossValidation,
    ExperimentFits,
    ExportedCode,
    Finding,
    FunctionBounds,
    Identification,
    Interval,
    LearnedRun,
    ModelDifference,
    Modes,
    Refinement,
    Updated,
    Validation,
    Verdict,
)

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]


_INTERVAL = ("estimate", "deviation", "lower", "upper")


def _bootstrap_options(level: float, replicates: Optional[int], seed: Optional[int], threads: int) -> dict[str, Any]:
    return {
        "level": _options.real("level", level, 1e-6, 1 - 1e-9),
        "replicates": 200 if replicates is None else _options.integer("replicates", replicates, 2, 1_000_000),
        "seed": 1 if seed is None else _options.integer("seed", seed, 1, 2**64 - 1),
        "threads": _options.threads(threads),
    }


def _values_of(function: Callable[[Model], ArrayLike], model: Model) -> Array:
    """The values of a user's function as an array of real numbers."""
    found = np.asarray(function(model))
    if found.dtype.kind not in "biuf":
        kind = {"O": "objects such as None", "c": "complex numbers"}.get(found.dtype.kind, f"values of {found.dtype}")
        raise ValueError(f"function: {kind} found, real numbers needed, with NaN for a missing value")
    if found.size == 0:
        raise ValueError("function: no values found, at least one needed")
    return found.astype(float)


@dataclass(frozen=True)
class Origin:
    """The evidence of the call that made a model."""

    findings: Sequence[Finding] = ()
    identification: Optional[Identification] = None
    refinement: Optional[Refinement] = None
    updated: Optional[Updated] = None
    state: Optional[UpdateState] = None


class Model(StateSpace):
    """A model of every step k = k_begin … k_end-1, with its observer::

        x[k+1] = A[k] x[k] + B[k] u[k]
        y[k]   = C[k] x[k] + D[k] u[k]

    `tokid.identify`, `tokid.load`, `tokid.example_system` and `Model.from_matrices` make models. A model does not
    change: a method that makes another model returns it.

    Methods with the arguments ``u`` and ``y`` accept one experiment as (T, r) and (T, m), or an `Ensemble` instead of
    both. They return arrays with as many dimensions as their arguments. Experiments of different lengths are lists of N
    arrays (T_n, r) and (T_n, m). Methods then return arrays (N, T, m), with NaN after the end of an experiment.
    """

    __slots__ = ("_origin", "__weakref__")
    _origin: Origin

    def __init__(self) -> None:
        raise TypeError(
            "models come from tokid.identify, tokid.load, tokid.example_system or tokid.Model.from_matrices"
        )

    @classmethod
    def _of(cls, core: _tokid.Model, origin: Origin = Origin()) -> Model:
        self = cls.__new__(cls)
        self._core = core
        self._origin = origin
        return self

    @classmethod
    def from_matrices(
        cls,
        A: Sequence[ArrayLike],
        B: Sequence[ArrayLike],
        C: Sequence[ArrayLike],
        D: Optional[Sequence[ArrayLike]] = None,
        G: Optional[Sequence[ArrayLike]] = None,
        *,
        dt: float = 1.0,
        k_begin: int = 0,
        period: Union[int, str] = 0,
        innovation_cov: Optional[Sequence[ArrayLike]] = None,
        Q: Optional[Sequence[ArrayLike]] = None,
        R: Optional[Sequence[ArrayLike]] = None,
        K: Optional[Sequence[ArrayLike]] = None,
        x0_mean: Optional[ArrayLike] = None,
        x0_cov: Optional[ArrayLike] = None,
        u_nominal: Optional[ArrayLike] = None,
        y_nominal: Optional[ArrayLike] = None,
        initial_state: str = "zero",
        input_names: Optional[Sequence[str]] = None,
        output_names: Optional[Sequence[str]] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
    ) -> Model:
        """Make a model of known matrices.

        Parameters
        ----------
        A, B, C, D : sequences of array_like, shapes (S, n, n), (S, n, r), (S, m, n), (S, m, r)
            The matrices of all steps: arrays of three dimensions, or lists of matrices whose state dimensions may
            vary. Without `D`, it is zero.
        G : sequence of array_like, shape (S, n, m), optional
            Observer gains. Without them, they are zero: predictions then do not use measured outputs.
        dt : float, default 1.0
            Sample time [s].
        k_begin : int, default 0
            First step of the model.
        period : int or "invariant", default 0
            P: the last P steps repeat after the end. 0: the model ends with its last step.
        innovation_cov, Q, R, K : sequences of array_like, optional
            Covariances of innovations, process and measurement noise, and Kalman gains: shapes (S, m, m), (S, n, n),
            (S, m, m) and (S, n, m).
        x0_mean, x0_cov : array_like, shapes (n,), (n, n), optional
            Mean and covariance of the state at `k_begin`.
        u_nominal, y_nominal : array_like, shapes (T, r), (T, m), optional
            Nominal trajectory. The model describes departures from it.
        initial_state : {"zero", "unknown"}, default "zero"
            States at step 0.
        input_names, output_names, input_units, output_units : sequences of str, optional
            Names and units of the channels.

        Raises
        ------
        ValueError
            If the number or the shape of matrices disagrees with the others. The message names them.
        """
        core = _tokid.Model()
        given = {"A": A, "B": B, "C": C, "D": D, "G": G, "innovation_cov": innovation_cov, "Q": Q, "R": R, "K": K}
        lists = {name: matrices_of(name, value) for name, value in given.items() if value is not None}
        for name in "ABC":
            if not lists.get(name):
                raise ValueError(f"{name}: no matrices found, one for each step needed")
        core.inputs = lists["B"][0].shape[1]
        core.outputs = lists["C"][0].shape[0]
        if D is None:
            lists["D"] = [np.zeros((core.outputs, core.inputs))] * len(lists["A"])
        if G is None:
            lists["G"] = [np.zeros((a.shape[0], core.outputs)) for a in lists["A"]]
        core.state_dim = [a.shape[1] for a in lists["A"]] + [lists["A"][-1].shape[0]]
        for name, matrices in lists.items():
            core.set_matrices(name, matrices)
        core.dt = _options.number("dt", dt)
        core.k_begin = _options.integer("k_begin", k_begin, 0)
        core.period = _options.period(period)
        core.method = "known"
        core.version = _tokid.version
        core.initial_state = _options.initial_state(initial_state) or _tokid.InitialState.zero
        for name, value, shape in (
            ("x0_mean", x0_mean, (None,)),
            ("x0_cov", x0_cov, (None, None)),
            ("u_nominal", u_nominal, (None, core.inputs)),
            ("y_nominal", y_nominal, (None, core.outputs)),
        ):
            if value is not None:
                setattr(core, name, _arrays.shaped(name, value, shape, "n, n" if name[0] == "x" else "T, m"))
        name_channels(core, locals())
        core.check()
        return cls._of(core)

    @classmethod
    def load(cls, path: PathLike) -> Model:
        """Read a model from .npz, .h5 or .mat.

        Raises
        ------
        IoError
            If the file can't be read or contains something else. It is an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_model(file))

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Write the model to .npz, .h5 or .mat. The file appears as a whole or not at all.

        Parameters
        ----------
        path : path
            The file; its extension determines the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        with writing(path) as file:
            _tokid.save_model(self._core, file, _options.switch("mat73", mat73))

    # Evidence

    @property
    def identification(self) -> Optional[Identification]:
        """The choices of the identification, and the evidence for them. None unless `tokid.identify` made the model.

        Files of models do not contain this evidence. For a loaded model, call `validate` or `report`.
        """
        return self._origin.identification

    @property
    def refinement(self) -> Optional[Refinement]:
        """The course of the refinement. None unless `refine` made the model."""
        return self._origin.refinement

    @property
    def updated(self) -> Optional[Updated]:
        """The results of `tokid.update` or `UpdateState.identify`. None unless one of them made the model."""
        return self._origin.updated

    @property
    def state(self) -> Optional[UpdateState]:
        """The update state, to which later experiments can be added. None unless `tokid.identify` was asked to keep it.

        The model in other coordinates (`frame`, `align`, `transform`) keeps the state. Models from this state are in
        the coordinates of the identification. A model of other steps, or with another observer, has no state.
        """
        return self._origin.state

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings of the call that made the model, on the data and on the model."""
        return tuple(self._origin.findings)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings as sentences."""
        return tuple(finding.text for finding in self._origin.findings)

    # Outputs

    def simulate(
        self,
        u: Union[ArrayLike, Ensemble],
        x0: Optional[ArrayLike] = None,
        *,
        y: Optional[ArrayLike] = None,
        estimate_state: bool = False,
        initial_state: str = "auto",
    ) -> Array:
        """Simulate the outputs from the inputs alone.

        Parameters
        ----------
        u : array_like, shape (N, T, r) or (T, r), or Ensemble
            Inputs, from step 0 on. An ensemble also states how its initial states are known.
        x0 : array_like, shape (N, n), or (n,) or (1, n) for all, optional
            States of the experiments at `k_begin`. By default zero, or `x0_mean` if the initial states are unknown and
            the model has estimated them.
        y : array_like, shape (N, T, m) or (T, m), optional
            Measured outputs. Only `estimate_state` uses them.
        estimate_state : bool, default False
            Estimate unknown initial states from the outputs of the first steps.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0. "auto": as the data state them, else as the model was identified.

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            Outputs, with the nominal trajectory added. NaN where the model has no step, and after a missing input.

        Warns
        -----
        TokidWarning
            If the initial states are unknown and not given, or if no step has outputs.
        """
        _options.switch("estimate_state", estimate_state)
        if y is not None and not estimate_state:
            raise ValueError("y: found, but only estimate_state=True uses measured outputs")
        data, single = self._data(u, y, outputs=estimate_state)
        initial = _options.initial_state(initial_state)
        if initial is not None and not estimate_state:
            if isinstance(u, Ensemble):
                raise ValueError("initial_state: found beside an Ensemble, which states it already")
            data.initial_state = initial_state
        if estimate_state:
            if x0 is not None:
                raise ValueError("x0: found beside estimate_state=True, which estimates it")
            simulated = self._core.simulate_data(data, initial)
        else:
            start = None
            if x0 is not None:
                start = _arrays.states("x0", x0, data.experiments, self._core.state_dim[0])
            simulated = self._core.simulate(data, start)
        if x0 is None:
            warn(self._core.simulation_remarks(data, simulated, estimate_state))
        return _result(simulated, single)

    def predict(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        horizon: int = 1,
        initial_state: str = "auto",
        initial_estimate: bool = True,
    ) -> Array:
        """Predict the outputs some steps ahead with the observer.

        Parameters
        ----------
        u : array_like, shape (N, T, r) or (T, r), or Ensemble
            Inputs, from step 0 on.
        y : array_like, shape (N, T, m) or (T, m)
            Measured outputs. The prediction of step k uses those up to k - horizon. NaN marks a missing sample.
        horizon : int, default 1
            Steps ahead.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0. "auto": as the data state them, else as the model was identified.
        initial_estimate : bool, default True
            True: unknown initial states have the distribution `x0_mean`, `x0_cov`, if the model has them. False: their
            distribution is different, and they must be estimated.

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            Predictions. NaN where there is none.
        """
        data, single = self._data(u, y, outputs=True)
        ahead = _options.integer("horizon", horizon, 1, 1_000_000)
        predicted = self._core.predict(data, ahead, _options.initial_state(initial_state), initial_estimate)
        warn(self._core.prediction_remarks(data, predicted))
        return _result(predicted, single)

    def innovations(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, initial_state: str = "auto"
    ) -> Array:
        """Return the innovations: the outputs minus their one-step predictions.

        If the model is right, they are white and have the covariance `innovation_cov`.

        Returns
        -------
        e : ndarray, shape (N, T, m) or (T, m)
            Innovations. NaN where there is none.
        """
        data, single = self._data(u, y, outputs=True)
        e = self._core.innovations(data, _options.initial_state(initial_state))
        return e[0] if single else e

    def validate(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        horizon: int = 1,
        whiteness_lags: int = _tokid.test_lags,
        initial_state: str = "auto",
        first_step: int = 0,
    ) -> Validation:
        """Validate the model on data: fits of simulation and prediction, and tests of the innovations.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments, preferably not the training data.
        horizon : int, default 1
            Steps ahead of the predictions for `Validation.horizon`.
        whiteness_lags : int, default 5
            Lags of the tests of the innovations. 0: no tests.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.
        first_step : int, default 0
            First step of the fits, to compare models that begin at different steps. The tests take all steps.

        Returns
        -------
        Validation
        """
        data, _ = self._data(u, y, outputs=True)
        validation: Validation = _tokid.validate(
            self._core,
            data,
            _options.integer("horizon", horizon, 1),
            _options.integer("whiteness_lags", whiteness_lags, 0),
            _options.initial_state(initial_state),
            _options.integer("first_step", first_step, 0),
        )
        warn(validation.warnings)
        return replace(validation, output_names=self.output_names, steps_ahead=int(horizon))

    def experiment_fits(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        initial_state: str = "auto",
        first_step: int = 0,
    ) -> ExperimentFits:
        """Return the fits of each experiment alone, and the order of the experiments from the worst to the best.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments, preferably not the training data.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.
        first_step : int, default 0
            First step of the fits.

        Returns
        -------
        ExperimentFits
        """
        data, _ = self._data(u, y, outputs=True)
        fits: ExperimentFits = _tokid.experiment_fits(
            self._core, data, _options.initial_state(initial_state), _options.integer("first_step", first_step, 0)
        )
        return fits

    def refine(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        smoothing: Union[float, str] = "auto",
        period: Union[int, str, None] = None,
        feedthrough: Union[bool, str, None] = None,
        iterations: int = 60,
        tolerance: float = 1e-6,
        initial_state: str = "auto",
        accelerate: bool = True,
        warm_up: bool = True,
        threads: int = 1,
        progress: Progress = False,
    ) -> Model:
        """Refine the model by expectation-maximisation (EM), which increases its likelihood.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments.
        smoothing : float or "auto"
            λ of the penalty on variation over time. "auto": that of the identification, else by cross-validation.
        period : int or "invariant", optional
            P: the steps k and k + P share their matrices. By default, the period of the model.
        feedthrough : bool, "auto" or None
            False: D = 0 is known. True: D is estimated, also if the model was identified without it. "auto" or None: as
            the model was identified.
        iterations : int, default 60
            Largest number of iterations.
        tolerance : float, default 1e-6
            EM has converged if an iteration without momentum gains less log-likelihood per output sample.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0. "auto": as the data state them, else as the model was identified.
        accelerate : bool, default True
            Use Nesterov's momentum where it raises the likelihood.
        warm_up : bool, default True
            Reach a strong penalty through weaker ones.
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        Model
            Its `refinement` describes the course of EM.
        """
        data, _ = self._data(u, y, outputs=True)
        with listener(progress, "refine") as listening:
            core, evidence = _tokid.refine(
                self._core,
                data,
                smoothing=_options.smoothing(smoothing),
                period=None if period is None else _options.period(period),
                feedthrough=_options.feedthrough(feedthrough),
                iterations=_options.integer("iterations", iterations, 1, 1_000_000),
                tolerance=_options.real("tolerance", tolerance, 0.0),
                initial_state=_options.initial_state(initial_state),
                accelerate=_options.switch("accelerate", accelerate),
                warm_up=_options.switch("warm_up", warm_up),
                threads=_options.threads(threads),
                listener=listening,
            )
        warn(evidence.warnings)
        return Model._of(core, Origin(evidence.findings, refinement=evidence))

    def log_likelihood(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, threads: int = 1
    ) -> Array:
        """Return the log-likelihood (N,) of each experiment: the density of its outputs given its inputs.

        Raises
        ------
        ValueError
            If the model has no `Q` and `R`, or no `x0_mean` and `x0_cov` for an unknown first state.
        """
        data, _ = self._data(u, y, outputs=True)
        return _tokid.log_likelihoods(self._core, data, threads=_options.threads(threads), listener=None)

    @overload
    def confidence(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        function: None = None,
        level: float = 0.95,
        replicates: Optional[int] = None,
        band: Union[int, str] = "auto",
        reference_step: Optional[int] = None,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> Confidence: ...

    @overload
    def confidence(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        function: Callable[[Model], ArrayLike],
        level: float = 0.95,
        replicates: Optional[int] = None,
        band: Union[int, str] = "auto",
        reference_step: Optional[int] = None,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> FunctionBounds: ...

    def confidence(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        function: Optional[Callable[[Model], ArrayLike]] = None,
        level: float = 0.95,
        replicates: Optional[int] = None,
        band: Union[int, str] = "auto",
        reference_step: Optional[int] = None,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> Union[Confidence, FunctionBounds]:
        """Compute confidence bounds of the parameters, outputs and eigenvalues, or of a function of the model.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            All experiments of the identification, including held-out ones.
        function : callable, optional
            Maps a model to an array of real numbers, always of the same shape, with NaN for a missing value. It must
            not depend on the coordinates of the states, because replicates have other coordinates: entries of A, B or
            C have no bounds. Poles (`modes`), frequency responses, pulse responses (`markov`) and simulated outputs
            do not depend on coordinates. The bounds are those of the values; `band` and `reference_step` have no
            effect.
        level : float, default 0.95
            Probability that an interval contains the true value.
        replicates : int, optional
            Number of bootstrap replicates, by default 200.
        band : int or "auto"
            Largest number of steps between input and output of the Markov parameters. "auto": twice the number of steps
            that determine a state.
        reference_step : int, optional
            Step of the frame of the eigenvalues; by default the first one with all states.
        seed : int, optional
            Seed of the bootstrap, by default 1.
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        Confidence, or FunctionBounds with `function`
        """
        data, _ = self._data(u, y, outputs=True)
        options = _bootstrap_options(level, replicates, seed, threads)
        with listener(progress, "confidence") as listening:
            if function is not None:
                return self._function_bounds(data, function, {**options, "listener": listening})
            result: Confidence = _tokid.confidence(
                self._core,
                data,
                **options,
                band=_options.count_or_auto("band", band),
                reference_step=_options.step("reference_step", reference_step),
                listener=listening,
            )
        warn(result.warnings)
        return result

    def _function_bounds(
        self, data: _tokid.Ensemble, function: Callable[[Model], ArrayLike], options: dict[str, Any]
    ) -> FunctionBounds:
        shape = _values_of(function, self).shape

        def values(core: _tokid.Model) -> Array:
            found = _values_of(function, Model._of(core))
            if found.shape != shape:
                raise ValueError(f"function: values of shape {found.shape} found, {shape} needed as for the model itself")
            return found.ravel()

        result: FunctionBounds = _tokid.function_bounds(self._core, data, values, **options)
        warn(result.warnings)
        arrays = {name: getattr(result.interval, name).reshape(shape) for name in _INTERVAL}
        return replace(result, interval=Interval(**arrays))

    def modes(
        self,
        u: Union[ArrayLike, Ensemble, None] = None,
        y: Optional[ArrayLike] = None,
        *,
        window: Union[int, str] = "auto",
        slow: float = 0.1,
        level: Optional[float] = None,
        replicates: Optional[int] = None,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> Modes:
        """Compute natural frequencies and damping ratios over time, with the time frozen at each step.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, optional
            All experiments of the identification. With them, the modes have intervals, by the bootstrap.
        window : int or "auto"
            Even number of steps whose outputs define the states. "auto": the steps that determine a state.
        slow : float, default 0.1
            A mode is valid if it varies by at most this share while it turns by one radian.
        level : float, optional
            Probability that an interval contains the true value, by default 0.95. Only with data.
        replicates : int, optional
            Number of bootstrap replicates, by default 200. Only with data.
        seed : int, optional
            Seed of the bootstrap, by default 1. Only with data.
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        Modes
        """
        if u is None and y is not None:
            raise ValueError("u: none found, the inputs beside y needed")
        data = None if u is None else self._data(u, y, outputs=True)[0]
        for name, value in (("level", level), ("replicates", replicates), ("seed", seed)):
            if data is None and value is not None:
                raise ValueError(f"{name}: {value!r} found without data, which intervals need")
        with listener(progress, "modes") as listening:
            result: Modes = _tokid.modes(
                self._core,
                data,
                window=_options.count_or_auto("window", window),
                slow=_options.real("slow", slow, 0.0),
                **_bootstrap_options(0.95 if level is None else level, replicates, seed, threads),
                listener=listening,
            )
        warn(result.warnings)
        return result

    def frozen(self, step: int, *, window: Union[int, str] = "auto") -> Model:
        """Return the time-invariant model that this model resembles around a step, in coordinates of `modes`.

        Parameters
        ----------
        step : int
            The step.
        window : int or "auto"
            As in `modes`.
        """
        return self.frozen_models([step], window=window)[0]

    def frozen_models(self, steps: Iterable[int], *, window: Union[int, str] = "auto") -> list[Model]:
        """Return the models of `frozen` at several steps. What they have in common is computed once.

        Parameters
        ----------
        steps : iterable of int
            The steps.
        window : int or "auto"
            As in `modes`.
        """
        wanted = [_options.integer("step", step, 0) for step in steps]
        found = _tokid.frozen_systems(self._core, wanted, window=_options.count_or_auto("window", window))
        return [Model._of(core) for core in found]

    def frequency_response(
        self, frequencies: ArrayLike, step: int, *, window: Union[int, str] = "auto"
    ) -> ComplexArray:
        """Return the frequency responses (F, m, r) with the time frozen at a step.

        Parameters
        ----------
        frequencies : array_like, shape (F,)
            Frequencies [rad/s].
        step : int
            The step.
        window : int or "auto"
            As in `modes`.
        """
        wanted = np.atleast_1d(_arrays.numbers("frequencies", frequencies)).ravel().astype(np.float64)
        if not np.isfinite(wanted).all():
            raise ValueError("frequencies: NaN or infinity found, finite numbers needed")
        frozen = self.frozen(step, window=window)
        response: ComplexArray = _tokid.frequency_response(frozen._core, 0, wanted)
        return response

    def cross_validate(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        folds: int = 5,
        horizon: int = 1,
        seed: Optional[int] = None,
        first_step: int = 0,
        threads: int = 1,
        progress: Progress = False,
    ) -> CrossValidation:
        """Cross-validate the options of this model: each fold is held out once, and a model of the others predicts it.

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
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        CrossValidation
        """
        data, _ = self._data(u, y, outputs=True)
        with listener(progress, "cross-validate") as listening:
            result: CrossValidation = _tokid.cross_validate(
                data,
                self._core.identify_options(),
                **_options.cross_validation(folds, horizon, seed, first_step, threads),
                listener=listening,
            )
        warn(result.warnings)
        return replace(result, output_names=self.output_names, steps_ahead=int(horizon))

    def report(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Union[ArrayLike, PathLike, None] = None,
        path: Optional[PathLike] = None,
        *,
        horizon: int = 10,
        experiments: int = 24,
        initial_state: str = "auto",
        first_step: int = 0,
        model_name: str = "model",
        data_name: str = "data",
        compare: Optional[Mapping[str, Model]] = None,
        bands: Union[tuple[ArrayLike, ArrayLike], Ensemble, None] = None,
        at: Optional[Sequence[int]] = None,
        threads: int = 1,
    ) -> Verdict:
        """Judge whether the model can be trusted, and write a self-contained HTML page about it.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments. The report finds out whether they are the training data.
        path : path, optional
            Page to write. Without a path, only the verdict is returned. With an Ensemble, it may take the place of `y`.
        horizon : int, default 10
            Steps ahead of the multi-step fit.
        experiments : int, default 24
            Largest number of experiments in the plots.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.
        first_step : int, default 0
            First step of the fits, for example after a start that no model can know.
        model_name, data_name : str
            Names on the page.
        compare : mapping from str to Model, optional
            Other models of the same channels, with their names on the page: it has their fits over the same samples,
            and their curves.
        bands : Ensemble or tuple (u, y), optional
            The experiments of the identification. With them, the pulse, step and frozen frequency responses on the page
            have 95 % confidence bands by a bootstrap, as in `confidence`, which takes time.
        at : sequence of int, optional
            Steps of the pulse, step and frozen frequency responses. By default they are evenly spaced. A frozen
            response is shown at those steps at which all modes are valid.
        threads : int, default 1
            Threads of the bootstrap. 0: all of the machine.

        Returns
        -------
        Verdict
        """
        if path is None and isinstance(y, (str, os.PathLike)):
            y, path = None, y
        data, _ = self._data(u, y, outputs=True)
        options = _tokid.ReportOptions()
        options.model_name = model_name
        options.data_name = data_name
        options.horizon = _options.integer("horizon", horizon, 1, 1_000_000)
        options.experiments = _options.integer("experiments", experiments, 1, 1000)
        options.initial_state = _options.initial_state(initial_state)
        options.first_step = _options.integer("first_step", first_step, 0)
        options.compare = [_tokid.NamedModel(str(name), other._core) for name, other in (compare or {}).items()]
        options.at = [_options.integer("at", step, 0) for step in (() if at is None else at)]
        identified = None
        if bands is not None:
            training_u, training_y = (bands, None) if isinstance(bands, Ensemble) else bands
            identified, _ = self._data(training_u, training_y, outputs=True)
        with nullcontext() if path is None else writing(path) as file:
            verdict: Verdict = _tokid.report(self._core, data, file, options, identified, _options.threads(threads))
        return verdict

    def estimate_state(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, k: int, window: Optional[int] = None
    ) -> Array:
        """Estimate the states at step k by least squares over the samples of the steps k … k+window-1.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments from step 0 on.
        k : int
            The step.
        window : int, optional
            Number of steps whose samples are used; by default the number that determines a state.

        Returns
        -------
        x : ndarray, shape (N, n) or (n,)
            States. NaN if a necessary sample is missing. n is ``state_dim[k - k_begin]``, the state dimension of step
            k. Before `full_begin` it is smaller than `states`, and may be zero.
        """
        data, single = self._data(u, y, outputs=True)
        x = self._core.estimate_state(data, _options.integer("k", k, 0), self._window("window", window)).T
        return x[0] if single else x

    def _data(self, u: Any, y: Any, outputs: bool = False) -> tuple[_tokid.Ensemble, bool]:
        """Data for this model, and whether they are one experiment. See `_experiments.for_model`."""
        return _experiments.for_model(self._core, u, y, outputs)

    def _window(self, name: str, value: Optional[int]) -> int:
        """A given number of steps, or the number that determines a state."""
        return self._core.estimation_window() if value is None else _options.integer(name, value, 1)

    # Coordinates

    def frame(self, name: str, *, reference_step: Optional[int] = None, rows: Optional[int] = None) -> Model:
        """Return the same model in other coordinates.

        Parameters
        ----------
        name : {"smooth", "reference"}
            "smooth": neighbouring steps are aligned, so that the matrices vary as slowly as the system. "reference":
            the outputs and one reference step define the frame, so that models of the same system can be compared.
        reference_step : int, optional
            Step of the reference frame; by default the first one with all states.
        rows : int, optional
            Block rows of the observability matrices; by default the number of steps that determines a state.

        Returns
        -------
        Model
        """
        core, rows = self._core, self._window("rows", rows)
        which = _options.choice("name", name, {"smooth": "smooth", "reference": "reference"})
        if which == "smooth":
            if reference_step is not None:
                raise ValueError("reference_step: needs name 'reference'")
            return self._same(core.smooth_frame(rows))
        step = core.full_begin if reference_step is None else _options.integer("reference_step", reference_step, 0)
        return self._same(core.reference_frame(step, rows))

    def align(self, reference: Model, *, rows: Optional[int] = None) -> Model:
        """Return the model in the coordinates of another model of the same system, so that both can be compared.

        Parameters
        ----------
        reference : Model
            The other model.
        rows : int, optional
            Block rows of the observability matrices; by default the number of steps that determines a state.
        """
        return self._same(self._core.align(_core_of("reference", reference), self._window("rows", rows)))

    def difference(self, other: Model, *, band: Optional[int] = None) -> ModelDifference:
        """Compare the pulse responses (Markov parameters) of two models. They do not depend on the coordinates.

        Parameters
        ----------
        other : Model
            A model with the same inputs and outputs.
        band : int, optional
            Largest number of steps between input and output; by default twice the state dimension.

        Returns
        -------
        ModelDifference
        """
        steps = 0 if band is None else _options.integer("band", band, 1)
        found: ModelDifference = _tokid.difference(self._core, _core_of("other", other), steps)
        return found

    def kalman_observer(self) -> Model:
        """Return the model with its Kalman filter as observer: `K`, `G`, `innovation_cov` from `Q`, `R`, `x0_cov`."""
        return self._same(self._core.kalman_observer(), state=None)

    def deadbeat_observer(self, *, tolerance: float = 1e-10) -> tuple[Model, int]:
        """Return the model with a deadbeat observer, and the number of steps after which every state error is zero.

        Parameters
        ----------
        tolerance : float, default 1e-10
            Directions below this share of the norm of C[k] count as unobserved, below this share of A[k] as zero.
        """
        core, steps = self._core.deadbeat_observer(_options.real("tolerance", tolerance, 0.0))
        return self._same(core, state=None), steps

    def transform(self, S: Sequence[ArrayLike]) -> Model:
        """Return the model with the states S[k] x[k]. The outputs do not change.

        Parameters
        ----------
        S : sequence of array_like, S+1 matrices (n, n)
            A regular matrix for the state of each step and for the state after the last step.
        """
        return self._same(self._core.transform(matrices_of("S", S)))

    def from_step(self, k: int) -> Model:
        """Return the model from step k on, with all values of these steps."""
        return self._same(self._core.from_step(_options.integer("k", k, self.k_begin, self.k_end)), state=None)

    def cut(self, begin: Optional[int] = None, end: Optional[int] = None) -> Model:
        """Return the steps begin … end-1 of the model, with all values of these steps.

        A periodic model is continued where needed, and stays periodic if its last step is not cut off.

        Parameters
        ----------
        begin, end : int, optional
            First step, and the step after the last one; by default those of the model.
        """
        first = self.k_begin if begin is None else _options.integer("begin", begin, 0)
        after = self.k_end if end is None else _options.integer("end", end, 0)
        return self._same(self._core.cut(first, after), state=None)

    def join(self, later: Model, *, step: Optional[int] = None, rows: Optional[int] = None) -> tuple[Model, float]:
        """Return this model continued by a later one, and a misfit of both at their common steps.

        The misfit is the larger one of two relative differences at these steps: of the outputs that a state causes, and
        of the pulse responses. It is 0 if both are the same system; observer gains do not count.

        Parameters
        ----------
        later : Model
            Another model of the same system. Both models need the steps from `step` to `step + rows - 1`, because the
            outputs of these steps give the state of one model from that of the other.
        step : int, optional
            First step that is taken from `later`; by default the last possible one.
        rows : int, optional
            Number of common steps; by default the number that determines a state.
        """
        core, other = self._core, _core_of("later", later)
        common = max(core.estimation_window(), other.estimation_window()) if rows is None else self._window("rows", rows)
        k = self.k_end - common if step is None else _options.integer("step", step, 0)
        joined, misfit = core.join(other, k, common)
        return Model._of(joined), misfit

    def _same(self, core: _tokid.Model, **changed: Any) -> Model:
        return Model._of(core, replace(self._origin, **changed))

    # Use: observer, control, learning

    def observer(
        self,
        *,
        initial_state: str = "auto",
        initial_estimate: bool = True,
        samples_missing: bool = False,
        input_square: Optional[ArrayLike] = None,
    ) -> Observer:
        """Return the observer for samples that arrive step by step.

        Parameters
        ----------
        initial_state, initial_estimate
            As in `predict`.
        samples_missing : bool, default False
            True: samples may be missing. If the model has `Q`, `R` and a known or estimated initial state, a Kalman
            filter for the available samples then replaces the observer, as in `predict` for data with missing samples.
        input_square : array_like, shape (r,), optional
            Mean squares of the inputs as departures from the nominal trajectory: the variances of missing inputs in the
            Kalman filter.

        Returns
        -------
        Observer
        """
        return Observer._of(self, initial_state, initial_estimate, samples_missing, input_square)

    def lqr(
        self,
        output_weight: ArrayLike,
        input_weight: Optional[ArrayLike] = None,
        *,
        input_rate_weight: Optional[ArrayLike] = None,
        terminal_weight: Optional[ArrayLike] = None,
        begin: Optional[int] = None,
        end: Optional[int] = None,
        y_reference: Optional[ArrayLike] = None,
        u_reference: Optional[ArrayLike] = None,
    ) -> Controller:
        """Design a finite-horizon LQR.

        With the observer of the model it is the LQG controller, if the observer gains are those of the Kalman filter:
        after EM, or by `kalman_observer`.

        The cost is the sum of weighted squares of outputs and inputs, as departures from the nominal trajectory or from
        the references, and of the changes of the input from step to step.

        Parameters
        ----------
        output_weight, input_weight, input_rate_weight : array_like, optional
            A number, a diagonal (m,) or (r,), a matrix, or a matrix for each step (S, m, m). The sum of the two weights
            on inputs must be positive definite.
        terminal_weight : array_like, optional
            Weight that is added to `output_weight` at the last step.
        begin, end : int, optional
            Steps begin ... end-1; by default those of the model. A periodic model goes on beyond its end.
        y_reference, u_reference : array_like, shapes (S, m), (S, r), optional
            Departures from the nominal trajectory that outputs and inputs shall have; by default zero.

        Returns
        -------
        Controller

        Examples
        --------
        >>> system = tokid.example_system("oscillator", steps=40)
        >>> controller = system.lqr(1.0, 0.1, terminal_weight=[10.0, 10.0])
        >>> len(controller.K), controller.K[0].shape, controller.cost_to_go[0].shape
        (40, (2, 4), (4, 4))
        """
        terminal = _arrays.weights("terminal_weight", terminal_weight, self.outputs)
        if len(terminal) > 1:
            raise ValueError(f"terminal_weight: {len(terminal)} matrices found, one needed")
        references = [
            None if value is None else _arrays.shaped(name, value, (None, size), "S, channels")
            for name, value, size in (
                ("y_reference", y_reference, self.outputs),
                ("u_reference", u_reference, self.inputs),
            )
        ]
        core = _tokid.lqr(
            self._core,
            _arrays.weights("output_weight", output_weight, self.outputs),
            _arrays.weights("input_weight", input_weight, self.inputs),
            _arrays.weights("input_rate_weight", input_rate_weight, self.inputs),
            terminal[0] if terminal else None,
            _options.step("begin", begin),
            _options.step("end", end),
            *references,
        )
        return Controller._of(core, self)

    def export_c(
        self,
        path: PathLike,
        controller: Optional[Controller] = None,
        *,
        name: Optional[str] = None,
        single_precision: bool = False,
        start_from_zero: bool = False,
    ) -> ExportedCode:
        """Write the observer as C99 source, and a controller, for machines without this package.

        docs/how-to/deploy.md explains the code. The file and its header appear together or not at all.

        Parameters
        ----------
        path : path
            The source to write, with the extension .c. The header, .h, is written beside it.
        controller : Controller, optional
            A controller of this model.
        name : str, optional
            The beginning of all names in C, by default the name of the file.
        single_precision : bool, default False
            True: numbers are float, else double.
        start_from_zero : bool, default False
            Start from the zero state if the initial state is unknown. Without it, such a model is refused unless it has
            `x0_mean`.

        Returns
        -------
        ExportedCode
            Bytes of the tables and of the state, and the operations of a step.
        """
        if controller is not None and not isinstance(controller, Controller):
            raise ValueError(f"controller: {type(controller).__name__} found, a tokid.Controller needed")
        with writing(path) as file:
            code: ExportedCode = _tokid.export_c(
                self._core,
                file,
                None if controller is None else controller._core,
                _options.text("name", name),
                _options.switch("single_precision", single_precision),
                _options.switch("start_from_zero", start_from_zero),
            )
        return code

    def lifted_map(self, begin: Optional[int] = None, end: Optional[int] = None) -> LiftedMap:
        """Return the map from the inputs of all steps to their outputs, from rest, as an operator.

        Parameters
        ----------
        begin, end : int, optional
            Steps begin ... end-1; by default those of the model. A periodic model goes on beyond its end.
        """
        return LiftedMap._of(self, begin, end)

    def learn(
        self,
        reference: ArrayLike,
        u: ArrayLike,
        y: ArrayLike,
        *,
        error_weight: ArrayLike = 1.0,
        input_weight: Optional[ArrayLike] = None,
        input_change_weight: Optional[ArrayLike] = None,
        input_rate_weight: Optional[ArrayLike] = None,
        u_min: Optional[ArrayLike] = None,
        u_max: Optional[ArrayLike] = None,
    ) -> LearnedRun:
        """Compute the inputs of the next run from those of the last one: norm-optimal iterative learning.

        The next inputs minimise the weighted squares of the predicted error, of the inputs as departures from the
        nominal trajectory, of their change from the last run, and of their change from step to step. All runs begin
        from the same state.

        Parameters
        ----------
        reference : array_like, shape (T, m)
            Outputs that the runs shall have. NaN where an output is free.
        u, y : array_like, shapes (T, r), (T, m)
            Inputs and outputs of the last run. NaN marks a missing output.
        error_weight, input_weight, input_change_weight, input_rate_weight : array_like, optional
            As in `lqr`. The sum of the weights on inputs must be positive definite.
        u_min, u_max : array_like, a number, shape (r,) or (T, r), optional
            Limits of the inputs. If the inputs would exceed them, PIQP solves a quadratic program:
            ``pip install tokid[limits]``.

        Returns
        -------
        LearnedRun
        """
        costs = [
            _arrays.weights("error_weight", error_weight, self.outputs),
            _arrays.weights("input_weight", input_weight, self.inputs),
            _arrays.weights("input_change_weight", input_change_weight, self.inputs),
            _arrays.weights("input_rate_weight", input_rate_weight, self.inputs),
        ]
        return _learning.learn(self, reference, u, y, costs, u_min, u_max)

    # Objects of other packages

    def to_control(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """Return step k as a `control.StateSpace`. A time-invariant model needs no k.

        A step at which the state dimension changes needs ``pad=True``, which pads the matrices with zeros. See
        `interop.to_control`.
        """
        return _control.to_control(self, k, pad)

    def to_scipy(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """Return step k as a `scipy.signal.StateSpace` in discrete time, with the arguments of `to_control`."""
        return _control.to_scipy(self, k, pad)

    def to_xarray(self) -> xarray.Dataset:
        """Return all matrices as an `xarray.Dataset` with the coordinates k, time, state, input and output.

        Entries are NaN where a step has fewer states. See `interop.model_to_xarray`.
        """
        dataset: xarray.Dataset = _dataset.of_model(self)
        return dataset

    def to_dataframe(
        self,
        u: Union[ArrayLike, Ensemble, pandas.DataFrame],
        y: Optional[ArrayLike] = None,
        *,
        horizon: int = 1,
        x0: Optional[ArrayLike] = None,
        initial_state: str = "auto",
    ) -> pandas.DataFrame:
        """Return measured, simulated and predicted outputs in a tidy `pandas.DataFrame`.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
            Experiments. Without outputs there are no predictions.
        horizon : int, default 1
            Steps ahead of the predictions.
        x0 : array_like, shape (N, n) or (n,), optional
            States of the simulations at `k_begin`. By default, unknown initial states are estimated from the first
            outputs.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.

        Returns
        -------
        pandas.DataFrame
            A row for each experiment and step. Columns: ``experiment``, ``time`` [s], the inputs, the outputs, and for
            each output ``simulated_`` and ``predicted_`` with its name.
        """
        _dataframe.pandas()
        data, _ = self._data(u, y)
        ensemble = Ensemble._of(data)
        names = self.output_names if not data.output_names else ensemble.output_names
        inputs = self.input_names if not data.input_names else ensemble.input_names
        columns = [(inputs, np.asarray(ensemble.u))]
        if data.outputs:
            columns.append((names, np.asarray(ensemble.y)))
        if data.outputs and x0 is None:
            simulated = self._core.simulate_data(data, _options.initial_state(initial_state)).outputs_copied()
        else:
            simulated = self.simulate(ensemble, x0)
        columns.append(([f"simulated_{name}" for name in names], simulated))
        if data.outputs:
            predicted = self.predict(ensemble, horizon=horizon, initial_state=initial_state)
            columns.append(([f"predicted_{name}" for name in names], predicted))
        table: pandas.DataFrame = _dataframe.tidy(data.dt, labels_of(data), columns)
        return table

    # Display

    def __repr__(self) -> str:
        return (
            f"<tokid.Model: n = {plural(self.states, 'state')}, r = {plural(self.inputs, 'input')}, "
            f"m = {plural(self.outputs, 'output')}, steps {self.k_begin} to {self.k_end - 1}, dt = {self.dt:g} s>"
        )

    def _repr_html_(self) -> str:
        full = f", all at steps {self.full_begin} to {self.full_end - 1}" if self.steps else ""
        rows: list[_display.Row] = [
            ("states", f"n = {self.states}{full}"),
            ("inputs", ", ".join(map(named, self.input_names, self.input_units))),
            ("outputs", ", ".join(map(named, self.output_names, self.output_units))),
            ("steps", f"{self.k_begin} to {self.k_end - 1}, dt = {self.dt:g} s"),
            ("method", f"{self.method or 'unknown'}, {self.frame_name} frame"),
        ]
        found = self.identification
        if found is not None:
            rows += found._judgement()
        return _display.as_html("tokid.Model", rows)

    # Copies, also in other processes

    def __copy__(self) -> Model:
        return Model._of(self._core.copy(), self._origin)

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        return Model._of(self._core.copy(), copy.deepcopy(self._origin, memo))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._origin, *state_of(self._core, LISTS))


def _restored(origin: Origin, *state: Any) -> Model:
    return Model._of(core_from(*state), origin)


def _core_of(name: str, model: Any) -> _tokid.Model:
    if not isinstance(model, Model):
        raise ValueError(f"{name}: {type(model).__name__} found, a tokid.Model needed")
    return model._core


def _result(computed: _tokid.Ensemble, single: bool) -> Array:
    y = computed.outputs_copied()
    return y[0] if single else y


class UpdateState:
    """An update state: the factors of the regressions of all experiments so far, and the choices from the first ones.

    `tokid.identify` with ``keep_state=True`` makes it: `Model.state`. Apart from a digest of 16 bytes for each
    experiment, its size does not depend on the number of experiments.
    """

    __slots__ = ("_core", "__weakref__")
    _core: _tokid.UpdateState

    experiments = Held[int]("Number of experiments N so far.")
    steps = Held[int]("Number of steps T.")
    inputs = Held[int]("Number of inputs r.")
    outputs = Held[int]("Number of outputs m.")
    lags = Held[int]("Lag order p.")

    def __init__(self) -> None:
        raise TypeError("a tokid.UpdateState comes from tokid.identify(..., keep_state=True) or tokid.UpdateState.load")

    @classmethod
    def _of(cls, core: _tokid.UpdateState) -> UpdateState:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def load(cls, path: PathLike) -> UpdateState:
        """Read a state from .h5, .npz or .mat.

        Raises
        ------
        IoError
            If the file can't be read or contains something else. It is an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_update_state(file))

    def save(self, path: PathLike) -> None:
        """Write the state to .h5, .npz or .mat. The file appears as a whole or not at all.

        Parameters
        ----------
        path : path or FileLock
            The file, or the lock under which it was read. With a lock, the call fails if a program without the lock has
            replaced the file in the meantime.
        """
        with writing(path) as file:
            if isinstance(path, FileLock):
                self._core.save_held(path._held())
            else:
                self._core.save(file)

    def identify(self, *, threads: int = 1, progress: Progress = False) -> Model:
        """Identify a model of all experiments so far, with the choices from the first ones and without EM.

        Parameters
        ----------
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        Model
            Its `updated` contains the results.
        """
        with listener(progress, "identify") as listening:
            return identified(self._core, None, _options.threads(threads), listening)

    # Copies, also in other processes. A state does not change, so that no copy is made: the state itself is returned

    def __copy__(self) -> UpdateState:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> UpdateState:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored_state, (bytes_of(self._core.save),)

    def __repr__(self) -> str:
        core = self._core
        return (
            f"<tokid.UpdateState: {plural(core.experiments, 'experiment')} of {plural(core.steps, 'step')}, "
            f"r = {plural(core.inputs, 'input')}, m = {plural(core.outputs, 'output')}, lag order {core.lags}>"
        )


def _restored_state(content: bytes) -> UpdateState:
    return UpdateState._of(from_bytes(_tokid.load_update_state, content))


def identified(core: _tokid.UpdateState, added: Optional[Additions], threads: int, listening: Any) -> Model:
    """Identify the model of all experiments of a state. `added` describes the experiments of an update."""
    model, experiments, condition, deficient, findings = core.identify(threads=threads, listener=listening)
    if added is not None:
        findings = added.findings + findings
    found = Updated(experiments, condition, deficient, added, findings)
    warn(found.warnings)
    return Model._of(model, Origin(findings, updated=found, state=UpdateState._of(core)))
