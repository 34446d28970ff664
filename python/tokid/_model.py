# SPDX-License-Identifier: BSD-3-Clause
"""Models with what was found out about them, and the states that later experiments are added to."""

from __future__ import annotations

import copy
import html
import os
import tempfile
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _arrays, _control, _dataframe, _dataset, _experiments, _options, _tokid
from ._ensemble import Ensemble
from ._errors import reading, warn, writing
from ._lock import FileLock
from ._progress import listener
from ._samples import labels_of, name_channels, plural
from ._state_space import LISTS, StateSpace, core_from, matrices_of, state_of
from ._typing import Array, ArrayLike, PathLike, Progress
from .results import (
    Additions,
    Confidence,
    CrossValidation,
    Finding,
    Identification,
    Refinement,
    Updated,
    Validation,
    Verdict,
)

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]


class Model(StateSpace):
    """A model of every step k = k_begin … k_end-1, with its observer::

        x[k+1] = A[k] x[k] + B[k] u[k]
        y[k]   = C[k] x[k] + D[k] u[k]

    Models come from `tokid.identify`, `tokid.load`, `tokid.example_system` and `Model.from_matrices`. They do not
    change: what makes another model of one returns that.

    Wherever a method takes ``u`` and ``y``, one experiment may be given as (T, r) and (T, m), and an `Ensemble` in the
    place of both. Arrays come back with as many dimensions as they went in with.
    """

    __slots__ = ("_findings", "_identification", "_refinement", "_state", "_updated", "__weakref__")
    _identification: Optional[Identification]
    _refinement: Optional[Refinement]
    _state: Optional[UpdateState]
    _updated: Optional[Updated]
    _findings: tuple[Finding, ...]

    def __init__(self) -> None:
        raise TypeError(
            "models come from tokid.identify, tokid.load, tokid.example_system or tokid.Model.from_matrices"
        )

    @classmethod
    def _of(
        cls,
        core: _tokid.Model,
        findings: Sequence[Finding] = (),
        *,
        identification: Optional[Identification] = None,
        refinement: Optional[Refinement] = None,
        updated: Optional[Updated] = None,
        state: Optional[UpdateState] = None,
    ) -> Model:
        self = cls.__new__(cls)
        self._core = core
        self._findings = tuple(findings)
        self._identification = identification
        self._refinement = refinement
        self._updated = updated
        self._state = state
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
        """A model of known matrices.

        Parameters
        ----------
        A, B, C, D : sequences of array_like, shapes (S, n, n), (S, n, r), (S, m, n), (S, m, r)
            The matrices of all steps: arrays of three dimensions, or lists of matrices whose state dimensions may
            vary. Without `D` that is zero.
        G : sequence of array_like, shape (S, n, m), optional
            Observer gains; without them there are no predictions.
        dt : float, default 1.0
            Sample time [s].
        k_begin : int, default 0
            First step of the model.
        period : int or "invariant", default 0
            P: the steps go on with those P before behind the last one; 0: the model ends there.
        innovation_cov, Q, R, K : sequences of array_like, optional
            Noise: shapes (S, m, m), (S, n, n), (S, m, m) and (S, n, m).
        x0_mean, x0_cov : array_like, shapes (n,), (n, n), optional
            The state at `k_begin`.
        u_nominal, y_nominal : array_like, shapes (T, r), (T, m), optional
            Motion that the model describes departures from.
        initial_state : {"zero", "unknown"}, default "zero"
            States at step 0.
        input_names, output_names, input_units, output_units : sequences of str, optional
            Of the channels.

        Raises
        ------
        ValueError
            Names the matrices whose number or shape disagrees with the others.
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
        core.dt = float(dt)
        core.k_begin = _options.integer("k_begin", k_begin, 0)
        core.period = _options.period(period)
        core.method = "known"
        core.version = _tokid.version
        state = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        core.initial_state = _tokid.InitialState.zero if state is None else state
        for name, value, shape in (
            ("x0_mean", x0_mean, (None,)),
            ("x0_cov", x0_cov, (None, None)),
            ("u_nominal", u_nominal, (None, core.inputs)),
            ("y_nominal", y_nominal, (None, core.outputs)),
        ):
            if value is not None:
                setattr(core, name, _arrays.shaped(name, value, shape, "n, n" if name[0] == "x" else "T, m"))
        name_channels(core, input_names, output_names, input_units, output_units)
        core.check()
        return cls._of(core)

    @classmethod
    def load(cls, path: PathLike) -> Model:
        """Reads a model from .npz, .h5 or .mat.

        Raises
        ------
        IoError
            For a file that can't be read or holds something else; an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_model(file))

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Writes the model to .npz, .h5 or .mat, whole or not at all; the extension says the format.

        Parameters
        ----------
        path : path
            The file.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        with writing(path) as file:
            _tokid.save_model(self._core, file, bool(mat73))

    # How it was found

    @property
    def identification(self) -> Optional[Identification]:
        """The evidence for every choice; None for a model that was not just identified."""
        return self._identification

    @property
    def refinement(self) -> Optional[Refinement]:
        """What `refine` has done; None for a model that it did not make."""
        return self._refinement

    @property
    def updated(self) -> Optional[Updated]:
        """What `tokid.update` and `UpdateState.identify` found out; None for a model that they did not make."""
        return self._updated

    @property
    def state(self) -> Optional[UpdateState]:
        """What later experiments can be added to; None unless `tokid.identify` was asked to keep it.

        The model in other coordinates (`frame`, `align`, `transform`) keeps it, and what it then identifies is in the
        coordinates of the identification. A model of other steps or with another observer has none.
        """
        return self._state

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the call that made the model had to say: its findings in words."""
        return tuple(finding.text for finding in self._findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What that call found in the data and in the model, for programs to look at."""
        return self._findings

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
        """Outputs for inputs alone.

        Parameters
        ----------
        u : array_like, shape (N, T, r) or (T, r), or Ensemble
            Inputs, from step 0 on. Those of an ensemble come with what it says of the initial states.
        x0 : array_like, shape (N, n), or (n,) or (1, n) for all, optional
            States of the experiments at `k_begin`. By default zero, or `x0_mean` where the initial states are unknown
            and the model has estimated them.
        y : array_like, shape (N, T, m) or (T, m), optional
            Measured outputs, of which `estimate_state` uses the first ones.
        estimate_state : bool, default False
            Unknown initial states by the outputs of the first steps.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0. "auto": as the data say, else as the model was identified.

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            NaN where the model has no step, and behind a missing input. The nominal trajectory is added back.

        Warns
        -----
        TokidWarning
            Where initial states are unknown and not told, or no step has outputs.
        """
        if y is not None and not estimate_state:
            raise ValueError("y: found, but used with estimate_state=True alone")
        data, single = self._data(u, y, outputs=estimate_state)
        initial = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        if initial is not None and not estimate_state:
            if isinstance(u, Ensemble):
                raise ValueError("initial_state: found beside an Ensemble, which says it itself")
            data.initial_state = initial_state
        if estimate_state:
            if x0 is not None:
                raise ValueError("x0: found beside estimate_state=True, which finds it")
            simulated = self._core.simulate_data(data, initial)
        else:
            start = None
            if x0 is not None:
                start = _arrays.numbers("x0", x0)
                if start.ndim == 1 or (start.ndim == 2 and len(start) == 1):
                    start = np.broadcast_to(start, (data.experiments, start.shape[-1]))
                start = _arrays.shaped("x0", start, (data.experiments, int(self._core.state_dim[0]))).T
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
        """Outputs some steps ahead, with the observer in the loop.

        Parameters
        ----------
        u : array_like, shape (N, T, r) or (T, r), or Ensemble
            Inputs, from step 0 on.
        y : array_like, shape (N, T, m) or (T, m)
            Measured outputs; those up to k - horizon serve for the prediction of step k. A missing one (NaN) corrects
            nothing.
        horizon : int, default 1
            Steps ahead.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0; "auto": as the data say, else as the model was identified.
        initial_estimate : bool, default True
            Unknown initial states are distributed as `x0_mean` and `x0_cov` have it, where the model has them; False:
            they come from elsewhere, and must be estimated.

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            NaN where there is no prediction.
        """
        data, single = self._data(u, y, outputs=True)
        initial = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        ahead = _options.integer("horizon", horizon, 1, 1_000_000)
        predicted = self._core.predict(data, ahead, initial, initial_estimate)
        warn(self._core.prediction_remarks(data, predicted))
        return _result(predicted, single)

    def innovations(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, initial_state: str = "auto"
    ) -> Array:
        """What the model holds to be white noise of covariance `innovation_cov`: y less its one-step predictions.

        Returns
        -------
        e : ndarray, shape (N, T, m) or (T, m)
            NaN where there is none.
        """
        data, single = self._data(u, y, outputs=True)
        initial = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        e = self._core.innovations(data, initial)
        return e[0] if single else e

    def validate(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        horizon: int = 1,
        whiteness_lags: int = _tokid.test_lags,
        initial_state: str = "auto",
    ) -> Validation:
        """How good the model is on data: fits of simulation and prediction, tests of the innovations.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments, best those that the model has not seen.
        horizon : int, default 1
            Steps ahead of `Validation.horizon`.
        whiteness_lags : int, default 5
            Lags of the tests of the innovations; 0: none of them.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.

        Returns
        -------
        Validation
        """
        data, _ = self._data(u, y, outputs=True)
        result = _tokid.validate(
            self._core,
            data,
            _options.integer("horizon", horizon, 1),
            _options.integer("whiteness_lags", whiteness_lags, 0),
            _options.choice("initial_state", initial_state, _options.INITIAL_STATES),
        )
        validation: Validation = result
        warn(validation.warnings)
        return validation

    def refine(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        smoothing: Union[float, str] = "auto",
        period: Union[int, str, None] = None,
        iterations: int = 60,
        tolerance: float = 1e-6,
        initial_state: str = "auto",
        accelerate: bool = True,
        warm_up: bool = True,
        threads: int = 1,
        progress: Progress = False,
    ) -> Model:
        """The maximum-likelihood model, by expectation and maximisation (EM) from this one on.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments.
        smoothing : float or "auto"
            Penalty λ on variation over time. "auto": as the model was identified, else by cross-validation.
        period : int or "invariant", optional
            Steps k and k + P share their matrices; by default as the model has it.
        iterations : int, default 60
            At most so many.
        tolerance : float, default 1e-6
            Converged: two gains in a row below this, of the log-likelihood per output sample.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0; "auto": as the data say, else as the model was identified.
        accelerate : bool, default True
            Anderson's acceleration, where it raises the likelihood.
        warm_up : bool, default True
            Approach a strong penalty by way of weaker ones.
        threads, progress
            As of `tokid.identify`.

        Returns
        -------
        Model
            Its `refinement` tells what happened.
        """
        data, _ = self._data(u, y, outputs=True)
        with listener(progress, "refine") as listening:
            core, evidence = _tokid.refine(
                self._core,
                data,
                smoothing=_options.smoothing(smoothing),
                period=None if period is None else _options.period(period),
                iterations=_options.integer("iterations", iterations, 1, 1_000_000),
                tolerance=_options.real("tolerance", tolerance, 0.0),
                initial_state=_options.choice("initial_state", initial_state, _options.INITIAL_STATES),
                accelerate=bool(accelerate),
                warm_up=bool(warm_up),
                threads=_options.threads(threads),
                listener=listening,
            )
        warn(evidence.warnings)
        return Model._of(core, evidence.findings, refinement=evidence)

    def log_likelihood(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, threads: int = 1
    ) -> Array:
        """Log-likelihood (N,) of each experiment: the density of its outputs given its inputs.

        Raises
        ------
        ValueError
            Where the model has no `Q` and `R`, or no `x0_mean` and `x0_cov` for an unknown first state.
        """
        data, _ = self._data(u, y, outputs=True)
        return _tokid.log_likelihoods(self._core, data, threads=_options.threads(threads), listener=None)

    def confidence(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        level: float = 0.95,
        method: str = "auto",
        replicates: Optional[int] = None,
        band: Union[int, str] = "auto",
        reference_step: Optional[int] = None,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> Confidence:
        """How far parameters, outputs and eigenvalues may lie from the truth.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            The experiments of the identification, whole.
        level : float, default 0.95
            Probability that an interval holds the truth.
        method : {"auto", "factors", "bootstrap"}
            From the factors of the regressions, or by identifying anew. "auto": the latter where steps share a model.
        replicates : int, optional
            Of the bootstrap, by default 200.
        band : int or "auto"
            Markov parameters up to so many steps apart. "auto": twice as many as tell a state.
        reference_step : int, optional
            Step of the frame of the eigenvalues, by default the first with all states.
        seed : int, optional
            Of the bootstrap, by default 1.
        threads, progress
            As of `tokid.identify`.

        Returns
        -------
        Confidence
        """
        data, _ = self._data(u, y, outputs=True)
        methods = {"auto": None, "factors": _tokid.BoundsMethod.factors, "bootstrap": _tokid.BoundsMethod.bootstrap}
        with listener(progress, "confidence") as listening:
            result: Confidence = _tokid.confidence(
                self._core,
                data,
                level=_options.real("level", level, 1e-6, 1 - 1e-9),
                method=_options.choice("method", method, methods),
                replicates=200 if replicates is None else _options.integer("replicates", replicates, 2, 1_000_000),
                seed=1 if seed is None else _options.integer("seed", seed, 1, 2**64 - 1),
                band=_options.count_or_auto("band", band),
                reference_step=_options.step("reference_step", reference_step),
                threads=_options.threads(threads),
                listener=listening,
            )
        for name, value in (("replicates", replicates), ("seed", seed)):
            if value is not None and result.method == "factors":
                text = f"{name} has no effect on bounds from the factors"
                finding = Finding(
                    kind="option_without_effect",
                    severity="note",
                    scope="all",
                    channels=[],
                    experiments=[],
                    steps=[],
                    numbers={},
                    text=text,
                    detail=name,
                )
                result.findings.append(finding)
                break
        warn(result.warnings)
        return result

    def cross_validate(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        folds: int = 5,
        horizon: int = 1,
        seed: Optional[int] = None,
        threads: int = 1,
        progress: Progress = False,
    ) -> CrossValidation:
        """Identifies anew, with the options of this model, from all but one part of the experiments at a time.

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
        threads, progress
            As of `tokid.identify`.

        Returns
        -------
        CrossValidation
        """
        data, _ = self._data(u, y, outputs=True)
        with listener(progress, "cross-validate") as listening:
            result: CrossValidation = _tokid.cross_validate(
                data,
                self._core.identify_options(),
                **_options.cross_validation(folds, horizon, seed, threads),
                listener=listening,
            )
        warn(result.warnings)
        return result

    def report(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Union[ArrayLike, PathLike, None] = None,
        path: Optional[PathLike] = None,
        *,
        horizon: int = 10,
        experiments: int = 24,
        initial_state: str = "auto",
        model_name: str = "model",
        data_name: str = "data",
    ) -> Verdict:
        """Whether the model can be trusted, on a page (HTML) that loads nothing.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments; whether the model has seen them is found out.
        path : path, optional
            Page to write; without one there is the verdict alone. Beside an Ensemble it may take the place of `y`.
        horizon : int, default 10
            Steps ahead of the multi-step fit.
        experiments : int, default 24
            In the plots, at most.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.
        model_name, data_name : str
            Shown on the page.

        Returns
        -------
        Verdict
        """
        if path is None and isinstance(y, (str, os.PathLike)):
            y, path = None, y
        data, _ = self._data(u, y, outputs=True)
        options = _options.page(model_name, data_name, horizon, experiments)
        options.initial_state = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        if path is None:
            return _verdict(self._core, data, None, options)
        with writing(path) as file:
            return _verdict(self._core, data, file, options)

    def estimate_state(
        self, u: Union[ArrayLike, Ensemble], y: Optional[ArrayLike] = None, *, k: int, window: Optional[int] = None
    ) -> Array:
        """States at step k by least squares over the samples of the steps k … k+window-1.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble
            Experiments from step 0 on.
        k : int
            The step.
        window : int, optional
            Steps whose samples are used, by default as many as tell a state.

        Returns
        -------
        x : ndarray, shape (N, n) or (n,)
            NaN where a sample is missing that the state needs. n is the state dimension of step k, ``state_dim[k -
            k_begin]``: fewer than `states`, or none at all, before `full_begin`, the first step with all of them.
        """
        data, single = self._data(u, y, outputs=True)
        steps = self._core.estimation_window() if window is None else _options.integer("window", window, 1)
        x = self._core.estimate_state(data, _options.integer("k", k, 0), steps).T
        return x[0] if single else x

    def _data(self, u: Any, y: Any, outputs: bool = False) -> tuple[_tokid.Ensemble, bool]:
        """Data for this model; arrays have its sample time and names."""
        return _experiments.for_model(self._core, u, y, outputs)

    # Coordinates

    def frame(self, name: str, *, reference_step: Optional[int] = None, rows: Optional[int] = None) -> Model:
        """The same model in other coordinates.

        Parameters
        ----------
        name : {"smooth", "reference"}
            "smooth": matrices that vary as slowly as the system does; "reference": those of the paper's figures, in
            which the model can be compared with others of the same system.
        reference_step : int, optional
            Step of the reference frame; by default the first one with all states.
        rows : int, optional
            Block rows of the observability matrices that are aligned; by default as many as tell a state.

        Returns
        -------
        Model
        """
        core = self._core
        rows = core.estimation_window() if rows is None else _options.integer("rows", rows, 1)
        which = _options.choice("name", name, {"smooth": "smooth", "reference": "reference"})
        if which == "smooth":
            if reference_step is not None:
                raise ValueError("reference_step: needs name 'reference'")
            return self._same(core.smooth_frame(rows), self._state)
        step = core.full_begin if reference_step is None else _options.integer("reference_step", reference_step, 0)
        return self._same(core.reference_frame(step, rows), self._state)

    def align(self, reference: Model, *, rows: Optional[int] = None) -> Model:
        """The model in the coordinates of another one of the same system, with which it can then be compared.

        Parameters
        ----------
        reference : Model
            The other one.
        rows : int, optional
            Block rows of the observability matrices; by default as many as tell a state.
        """
        count = self._core.estimation_window() if rows is None else _options.integer("rows", rows, 1)
        return self._same(self._core.align(_core_of("reference", reference), count), self._state)

    def difference(self, other: Model, *, band: Optional[int] = None) -> float:
        """Largest difference of the Markov parameters of two models, over the largest of both at the same step.

        Parameters
        ----------
        other : Model
            Of the same inputs and outputs.
        band : int, optional
            Steps between input and output, at most; by default twice the states.
        """
        return self._core.difference(_core_of("other", other), 0 if band is None else _options.integer("band", band, 1))

    def kalman_observer(self) -> Model:
        """The model with the Kalman filter of its `Q`, `R` and `x0_cov` as observer: `K`, `G`, `innovation_cov`."""
        return self._same(self._core.kalman_observer())

    def deadbeat_observer(self, *, tolerance: float = 1e-10) -> tuple[Model, int]:
        """The model with a deadbeat observer, and the steps after which that has forgotten every error.

        Parameters
        ----------
        tolerance : float, default 1e-10
            Directions below this share of C[k] count as unseen, of A[k] as gone.
        """
        core, steps = self._core.deadbeat_observer(_options.real("tolerance", tolerance, 0.0))
        return self._same(core), steps

    def transform(self, S: Sequence[ArrayLike]) -> Model:
        """The model with the states S[k] x[k], which changes no output.

        Parameters
        ----------
        S : sequence of array_like, S+1 matrices (n, n)
            A regular matrix for each step, and one for the state behind the last one.
        """
        return self._same(self._core.transform(matrices_of("S", S)), self._state)

    def from_step(self, k: int) -> Model:
        """The model from step k on, with everything that belongs to those steps."""
        return self._same(self._core.from_step(_options.integer("k", k, self.k_begin, self.k_end)))

    def _same(self, core: _tokid.Model, state: Optional[UpdateState] = None) -> Model:
        return Model._of(
            core,
            self._findings,
            identification=self._identification,
            refinement=self._refinement,
            updated=self._updated,
            state=state,
        )

    # In the forms of other packages

    def to_control(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """The step k as a `control.StateSpace`; without k for a time-invariant model.

        A step at which the number of states changes needs ``pad=True``, which fills up with zeros. See
        `interop.to_control`.
        """
        return _control.to_control(self, k, pad)

    def to_scipy(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """The step k as a `scipy.signal.StateSpace` in discrete time; else as `to_control`."""
        return _control.to_scipy(self, k, pad)

    def to_xarray(self) -> xarray.Dataset:
        """All matrices as an `xarray.Dataset` with the coordinates k, time, state, input and output.

        Entries that a step of fewer states does not have are NaN. See `interop.model_to_xarray`.
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
        """Measured, simulated and predicted outputs in a tidy `pandas.DataFrame`.

        Parameters
        ----------
        u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
            Experiments; without outputs there are no predictions.
        horizon : int, default 1
            Steps ahead of the predictions.
        x0 : array_like, shape (N, n) or (n,), optional
            States of the simulations at `k_begin`. By default as the initial states are known to be; where they are
            unknown, those that the first outputs tell.
        initial_state : {"auto", "zero", "unknown"}, default "auto"
            States at step 0.

        Returns
        -------
        pandas.DataFrame
            A row for each experiment and step: ``experiment``, ``time`` [s], the inputs, the outputs, and for each
            output ``simulated_`` and ``predicted_`` with its name.
        """
        _dataframe.pandas()
        data, _ = self._data(u, y)
        ensemble = Ensemble._of(data)
        names = self.output_names if not data.output_names else ensemble.output_names
        inputs = self.input_names if not data.input_names else ensemble.input_names
        columns = [(inputs, np.asarray(ensemble.u))]
        if data.outputs:
            columns.append((names, np.asarray(ensemble.y)))
        if data.outputs and x0 is None:  # initial states that are unknown are those that the first outputs tell
            initial = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
            simulated = self._core.simulate_data(data, initial).outputs_copied()
        else:
            simulated = self.simulate(ensemble, x0)
        columns.append(([f"simulated_{name}" for name in names], simulated))
        if data.outputs:
            predicted = self.predict(ensemble, horizon=horizon, initial_state=initial_state)
            columns.append(([f"predicted_{name}" for name in names], predicted))
        table: pandas.DataFrame = _dataframe.tidy(data.dt, labels_of(data), columns)
        return table

    # How it looks

    def __repr__(self) -> str:
        return (
            f"<tokid.Model: n = {plural(self.states, 'state')}, r = {plural(self.inputs, 'input')}, "
            f"m = {plural(self.outputs, 'output')}, steps {self.k_begin} to {self.k_end - 1}, dt = {self.dt:g} s>"
        )

    def _repr_html_(self) -> str:
        rows = [
            ("states", f"n = {self.states}" + ("" if self.steps == 0 else f", all at steps {self.full_begin} to {self.full_end - 1}")),
            ("inputs", _labels(self.input_names, self.input_units)),
            ("outputs", _labels(self.output_names, self.output_units)),
            ("steps", f"{self.k_begin} to {self.k_end - 1}, dt = {self.dt:g} s"),
            ("method", f"{self.method or 'unknown'}, {self.frame_name} frame"),
        ]
        found = self._identification
        if found is not None:
            where = "held out" if found.held_out else "training data"
            for name, fit in (("simulation fit", found.validation.simulation), ("one-step fit", found.validation.one_step)):
                rows.append((name, ", ".join(f"{x:.2f} %" for x in fit.fit) + f" ({where})"))
        cells = "".join(f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td></tr>" for a, b in rows)
        return f"<table><caption>tokid.Model</caption>{cells}</table>"

    # Copies, also in other processes

    def __copy__(self) -> Model:
        return Model._of(self._core.copy(), self._findings, **self._found())

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        return Model._of(self._core.copy(), self._findings, **copy.deepcopy(self._found(), memo))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (*state_of(self._core, LISTS), self._findings, self._found())

    def _found(self) -> dict[str, Any]:
        return {
            "identification": self._identification,
            "refinement": self._refinement,
            "updated": self._updated,
            "state": self._state,
        }


def _restored(
    state: dict[str, Any],
    arrays: dict[str, Array],
    stacks: dict[str, Array],
    singular_values: tuple[Array, list[int]],
    findings: Sequence[Finding],
    found: dict[str, Any],
) -> Model:
    return Model._of(core_from(state, arrays, stacks, singular_values), findings, **found)


def _core_of(name: str, model: Any) -> _tokid.Model:
    if not isinstance(model, Model):
        raise ValueError(f"{name}: {type(model).__name__} found, a tokid.Model needed")
    return model._core


def _verdict(model: _tokid.Model, data: _tokid.Ensemble, path: Any, options: _tokid.ReportOptions) -> Verdict:
    verdict: Verdict = _tokid.report(model, data, path, options)
    return verdict


def _labels(names: Sequence[str], units: Sequence[str]) -> str:
    return ", ".join(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units))


def _result(computed: _tokid.Ensemble, single: bool) -> Array:
    y = computed.outputs_copied()
    return y[0] if single else y


class UpdateState:
    """What is kept of all experiments so far: the factors of the regressions, and the choices made from the first ones.

    `tokid.identify` with ``keep_state=True`` makes one, `Model.state`. Beside 16 bytes for each
    experiment, by which it is known again, its size does not depend on their number.
    """

    __slots__ = ("_core", "__weakref__")
    _core: _tokid.UpdateState

    def __init__(self) -> None:
        raise TypeError("states come from tokid.identify(..., keep_state=True) or tokid.UpdateState.load")

    @classmethod
    def _of(cls, core: _tokid.UpdateState) -> UpdateState:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def load(cls, path: PathLike) -> UpdateState:
        """Reads a state from .h5, .npz or .mat.

        Raises
        ------
        IoError
            For a file that can't be read or holds something else; an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_update_state(file))

    def save(self, path: PathLike) -> None:
        """Writes the state to .h5, .npz or .mat, whole or not at all.

        Parameters
        ----------
        path : path or FileLock
            With the lock of a file that was read under it, the file is refused where a program without the lock has
            replaced it meanwhile.
        """
        with writing(path) as file:
            if isinstance(path, FileLock):
                self._core.save_held(path._held())
            else:
                self._core.save(file)

    @property
    def experiments(self) -> int:
        """Number of experiments N so far."""
        return self._core.experiments

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return self._core.steps

    @property
    def inputs(self) -> int:
        """Number of inputs r."""
        return self._core.inputs

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self._core.outputs

    @property
    def lags(self) -> int:
        """Lag order p."""
        return self._core.lags

    def identify(self, *, threads: int = 1, progress: Progress = False) -> Model:
        """The model of all experiments so far, with the choices made from the first ones and without EM.

        Parameters
        ----------
        threads, progress
            As of `tokid.identify`.

        Returns
        -------
        Model
            Its `updated` tells what was found out.
        """
        with listener(progress, "identify") as listening:
            return identified(self._core, None, _options.threads(threads), listening)

    # Copies, also in other processes; nothing changes a state, so that a copy is the state itself

    def __copy__(self) -> UpdateState:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> UpdateState:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as directory:
            file = os.path.join(directory, "state.npz")
            self._core.save(file)
            with open(file, "rb") as stream:
                return _restored_state, (stream.read(),)

    def __repr__(self) -> str:
        core = self._core
        return (
            f"<tokid.UpdateState: {plural(core.experiments, 'experiment')} of {plural(core.steps, 'step')}, "
            f"r = {plural(core.inputs, 'input')}, m = {plural(core.outputs, 'output')}, lag order {core.lags}>"
        )


def _restored_state(content: bytes) -> UpdateState:
    with tempfile.TemporaryDirectory() as directory:
        file = os.path.join(directory, "state.npz")
        with open(file, "wb") as stream:
            stream.write(content)
        return UpdateState._of(_tokid.load_update_state(file))


def identified(core: _tokid.UpdateState, added: Optional[Additions], threads: int, listening: Any) -> Model:
    """The model of all experiments of a state, to which some may just have been added."""
    model, experiments, condition, deficient, findings = core.identify(threads=threads, listener=listening)
    if added is not None:
        findings = added.findings + findings
    found = Updated(experiments, condition, deficient, added, findings)
    warn(found.warnings)
    return Model._of(model, findings, updated=found, state=UpdateState._of(core))
