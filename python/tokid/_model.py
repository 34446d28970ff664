# SPDX-License-Identifier: BSD-3-Clause
"""Models: a matrix sequence with its observer."""

from __future__ import annotations

import copy
import html
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Optional, Union, overload

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from . import _arrays, _dataframe, _dataset, _options, _tokid
from ._channels import Channels
from ._ensemble import Ensemble, core_of, name_channels, plural
from ._errors import reading, warn, writing
from ._progress import listener
from ._typing import Array, ArrayLike, ComplexArray, PathLike, Progress
from .results import Confidence, CrossValidation, Identification, Refinement, Updated, Validation, Verdict

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]

    from ._update import UpdateState


class MatrixSequence(NDArrayOperatorsMixin, Sequence[Array]):
    """The matrices of all steps, entry s = 0 … S-1 for the step k = k_begin + s.

    An entry is a read-only view of the model's own matrix, which it keeps alive, and so are those of a slice of steps.
    State dimensions may vary from step to step, and with them the shapes; `stack` and ``numpy.asarray`` pad them with
    zeros to one array. Any other index, operators and NumPy's functions are those of that array, as are `shape`, `ndim`
    and `dtype`.

    Examples
    --------
    >>> model = tokid.example_system("oscillator", steps=40)
    >>> model.A
    <A: 40 matrices (4, 4)>
    >>> model.A[3].shape, np.asarray(model.A).shape
    ((4, 4), (40, 4, 4))
    >>> model.A[:, 0, 1].shape, np.array_equal(model.A, model.A.stack())
    ((40,), True)
    """

    __slots__ = ("_core", "_name", "_range")

    def __init__(self, core: _tokid.Model, name: str, steps: Optional[range] = None) -> None:
        self._core = core
        self._name = name
        self._range = range(core.count(name)) if steps is None else steps

    def __len__(self) -> int:
        return len(self._range)

    @overload
    def __getitem__(self, s: int) -> Array: ...
    @overload
    def __getitem__(self, s: slice) -> MatrixSequence: ...
    @overload
    def __getitem__(self, s: Any) -> Any: ...
    def __getitem__(self, s: Any) -> Any:
        if isinstance(s, slice):
            return MatrixSequence(self._core, self._name, self._range[s])
        if isinstance(s, (bool, np.bool_)) or not hasattr(s, "__index__") or np.ndim(s) > 0:
            return self.stack()[s]
        try:
            step = self._range[s]
        except IndexError:
            raise IndexError(f"{self._name}: entry {s} found, one of {len(self)} needed") from None
        return self._core.matrix(self._name, step)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(S, rows, columns) of `stack`."""
        rows, columns = self._core.stacked_size(self._name)
        return len(self), rows, columns

    @property
    def ndim(self) -> int:
        """Dimensions of `stack`."""
        return 3

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """Type of the numbers."""
        return np.dtype(np.float64)

    def __contains__(self, matrix: object) -> bool:
        return any(np.array_equal(entry, np.asarray(matrix)) for entry in self)

    def index(self, matrix: Any, start: int = 0, stop: Optional[int] = None) -> int:
        """The first entry that equals a matrix."""
        for s in range(*slice(start, stop).indices(len(self))):
            if np.array_equal(self[s], np.asarray(matrix)):
                return s
        raise ValueError(f"{self._name}: no entry is that matrix")

    def count(self, matrix: Any) -> int:
        """Number of entries that equal a matrix."""
        return sum(np.array_equal(entry, np.asarray(matrix)) for entry in self)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **others: Any) -> Any:
        arrays = [x.stack() if isinstance(x, MatrixSequence) else x for x in inputs]
        if any(isinstance(x, MatrixSequence) for x in others.get("out", ())):
            raise ValueError(f"{self._name}: the matrices of a model do not change; see Model.from_matrices")
        return getattr(ufunc, method)(*arrays, **others)

    def __reduce__(self) -> tuple[Any, ...]:
        return _sequence, (self._name, self._range, *_state_of(self._core, (self._name,)))

    def __iter__(self) -> Iterator[Array]:
        return (self._core.matrix(self._name, s) for s in self._range)

    def stack(self) -> Array:
        """One array (S, rows, columns), as in the files: padded with zeros to the largest state dimension."""
        whole = self._core.stack(self._name)
        if self._range == range(len(whole)):
            return whole
        return whole[list(self._range)]

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray[Any, Any]:
        if copy is False:
            raise ValueError(f"{self._name}: one array of all steps is a copy; entries are views")
        return self.stack() if dtype is None else self.stack().astype(dtype, copy=False)

    def __repr__(self) -> str:
        shapes = {a.shape for a in self}
        shape = f" {min(shapes)}" if len(shapes) == 1 else f", up to {self.stack().shape[1:]}" if shapes else ""
        return f"<{self._name}: {len(self)} {'matrix' if len(self) == 1 else 'matrices'}{shape}>"


@dataclass(frozen=True, eq=False)
class Step:
    """The model of one step: views of what the model holds; None for what it does not have.

    Attributes
    ----------
    k : int
        The step.
    A, B, C, D : ndarray, shapes (n', n), (n', r), (m, n), (m, r)
        x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], for n states at k and n' at k+1.
    G : ndarray, shape (n', m), or None
        Observer gain; A + G C is the closed loop.
    innovation_cov : ndarray, shape (m, m), or None
        Covariance of the innovations.
    Q, R : ndarray, shapes (n', n'), (m, m), or None
        Covariances of process and measurement noise.
    K : ndarray, shape (n, m), or None
        Kalman gain.
    """

    k: int
    A: Array
    B: Array
    C: Array
    D: Array
    G: Optional[Array] = None
    innovation_cov: Optional[Array] = None
    Q: Optional[Array] = None
    R: Optional[Array] = None
    K: Optional[Array] = None

    @property
    def closed_loop(self) -> Array:
        """A + G C, the closed loop of the observer."""
        if self.G is None:
            raise ValueError("the model has no observer gains G")
        return self.A + self.G @ self.C


_LISTS = ("A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K")
_PLAIN = (  # in this order: state_dim makes the steps, for so many inputs and outputs
    "inputs",
    "outputs",
    "k_begin",
    "dt",
    "state_dim",
    "period",
    "frame",
    "method",
    "condition",
    "rank",
    "lags",
    "options",
    "version",
    "input_names",
    "output_names",
    "input_units",
    "output_units",
)
_ARRAYS = ("u_nominal", "y_nominal", "x0_mean", "x0_cov")


class Model(Channels):
    """A model of every step k = k_begin … k_end-1, with its observer::

        x[k+1] = A[k] x[k] + B[k] u[k]
        y[k]   = C[k] x[k] + D[k] u[k]

    Models come from `tokid.identify`, `tokid.load`, `tokid.example_system` and `Model.from_matrices`. They do not
    change: what makes another model of one returns that.

    Wherever a method takes ``u`` and ``y``, one experiment may be given as (T, r) and (T, m), and an `Ensemble` in the
    place of both. Arrays come back with as many dimensions as they went in with.
    """

    __slots__ = ("_core", "_identification", "_refinement", "_state", "_updated", "_warnings", "__weakref__")
    _core: _tokid.Model
    _identification: Optional[Identification]
    _refinement: Optional[Refinement]
    _state: Optional[UpdateState]
    _updated: Optional[Updated]
    _warnings: tuple[str, ...]

    def __init__(self) -> None:
        raise TypeError(
            "models come from tokid.identify, tokid.load, tokid.example_system or tokid.Model.from_matrices"
        )

    @classmethod
    def _of(
        cls,
        core: _tokid.Model,
        warnings: Sequence[str] = (),
        *,
        identification: Optional[Identification] = None,
        refinement: Optional[Refinement] = None,
        updated: Optional[Updated] = None,
        state: Optional[UpdateState] = None,
    ) -> Model:
        self = cls.__new__(cls)
        self._core = core
        self._warnings = tuple(warnings)
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
        lists = {name: _matrices(name, value) for name, value in given.items() if value is not None}
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

    # The matrices

    @property
    def A(self) -> MatrixSequence:
        """State matrices (S) of (n', n)."""
        return MatrixSequence(self._core, "A")

    @property
    def B(self) -> MatrixSequence:
        """Input matrices (S) of (n', r)."""
        return MatrixSequence(self._core, "B")

    @property
    def C(self) -> MatrixSequence:
        """Output matrices (S) of (m, n)."""
        return MatrixSequence(self._core, "C")

    @property
    def D(self) -> MatrixSequence:
        """Feedthrough matrices (S) of (m, r)."""
        return MatrixSequence(self._core, "D")

    @property
    def G(self) -> MatrixSequence:
        """Observer gains (S) of (n', m); A + G C is the closed loop."""
        return MatrixSequence(self._core, "G")

    @property
    def innovation_cov(self) -> MatrixSequence:
        """Covariances (S) of the innovations (m, m); empty where they are not known."""
        return MatrixSequence(self._core, "innovation_cov")

    @property
    def Q(self) -> MatrixSequence:
        """Covariances (S) of the process noise (n', n'); empty where they are not known."""
        return MatrixSequence(self._core, "Q")

    @property
    def R(self) -> MatrixSequence:
        """Covariances (S) of the measurement noise (m, m); empty where they are not known."""
        return MatrixSequence(self._core, "R")

    @property
    def K(self) -> MatrixSequence:
        """Kalman gains (S) of (n, m); empty where they are not known."""
        return MatrixSequence(self._core, "K")

    def at(self, k: int) -> Step:
        """The model of step k; one with a period goes on behind its last step.

        Raises
        ------
        ValueError
            Where the model has no such step.
        """
        core = self._core
        s = _options.integer("k", k, self.k_begin, None if core.period else self.k_end - 1) - core.k_begin
        if s >= core.steps:
            s -= -((core.steps - 1 - s) // core.period) * core.period
        matrices: dict[str, Any] = {name: core.matrix(name, s) for name in _LISTS if core.count(name)}
        return Step(k, **matrices)

    # What it is

    @property
    def steps(self) -> int:
        """Number of steps S."""
        return self._core.steps

    @property
    def states(self) -> int:
        """Largest state dimension n."""
        return self._core.states

    @property
    def k_begin(self) -> int:
        """First step with a model."""
        return self._core.k_begin

    @property
    def k_end(self) -> int:
        """One past the last step."""
        return self._core.k_begin + self._core.steps

    @property
    def full_begin(self) -> int:
        """First step with all n states."""
        return self._core.full_begin

    @property
    def full_end(self) -> int:
        """One past the last step with all n states, counted from `full_begin` without a gap."""
        return self._core.full_end

    @property
    def state_dim(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """State dimensions (S+1) before each step and after the last one."""
        return np.asarray(self._core.state_dim, dtype=np.int64)

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self._core.dt

    @property
    def time(self) -> Array:
        """Times (S,) of the steps of the model [s]."""
        return np.arange(self.k_begin, self.k_end, dtype=np.float64) * self.dt

    @property
    def period(self) -> int:
        """P: the steps k and k + P have the same matrices; 1: time-invariant; 0: the model ends with its last step."""
        return self._core.period

    @property
    def frame_name(self) -> str:
        """Coordinates of the states: "raw", "reference" or "smooth"."""
        return self._core.frame

    @property
    def method(self) -> str:
        """How the model was made: "tvera", "subspace", "em", "known"."""
        return self._core.method

    @property
    def initial_state(self) -> str:
        """Initial states that the model was identified from: "zero" or "unknown"."""
        return str(self._core.initial_state.name)

    @property
    def u_nominal(self) -> Optional[Array]:
        """Nominal inputs (T, r) that were removed before identification, or None."""
        return self._array("u_nominal")

    @property
    def y_nominal(self) -> Optional[Array]:
        """Nominal outputs (T, m) that were removed before identification, or None."""
        return self._array("y_nominal")

    @property
    def x0_mean(self) -> Optional[Array]:
        """Mean state (n,) at `k_begin`, or None."""
        return self._array("x0_mean")

    @property
    def x0_cov(self) -> Optional[Array]:
        """Covariance (n, n) of the state at `k_begin`, or None."""
        return self._array("x0_cov")

    def _array(self, name: str) -> Optional[Array]:
        array: Array = getattr(self._core, name)
        return array if array.size else None

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
        """What the call that made the model had to say."""
        return self._warnings

    @property
    def singular_values(self) -> list[Array]:
        """Singular values (S) of the Hankel matrix or the weighted predictor of each step; empty where not known."""
        core = self._core
        return [core.singular_values(s) for s in range(core.singular_values_count())]

    @property
    def condition(self) -> Array:
        """Condition number (S,) of the scaled regression of each step; empty where not known."""
        return np.asarray(self._core.condition, dtype=np.float64)

    @property
    def rank(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Rank (S,) of the regression of each step; empty where not known."""
        return np.asarray(self._core.rank, dtype=np.int64)

    @property
    def lags(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Lag order (S,) of each step; empty where not known."""
        return np.asarray(self._core.lags, dtype=np.int64)

    @property
    def options(self) -> dict[str, Any]:
        """The options of the identification, and what it noted down, as the files hold them; {} where not known."""
        try:
            options = json.loads(self._core.options or "{}")
        except json.JSONDecodeError:
            return {}
        return options if isinstance(options, dict) else {}

    @property
    def version(self) -> str:
        """Version of the program that made the model."""
        return self._core.version

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
        return Model._of(core, evidence.warnings, refinement=evidence)

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
                result.warnings.append(f"{name} has no effect on bounds from the factors")
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
        options = _tokid.ReportOptions()
        options.model_name = model_name
        options.data_name = data_name
        options.horizon = _options.integer("horizon", horizon, 1, 1_000_000)
        options.experiments = _options.integer("experiments", experiments, 1, 1000)
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
        if isinstance(u, Ensemble):
            if y is not None:
                raise ValueError("y: found beside an Ensemble, which has the outputs already")
            return self._by_name(u._ready()), False
        if _dataframe.is_dataframe(u):
            if y is not None:
                raise ValueError("y: found beside a DataFrame, which has the outputs already")
            return _dataframe.core_for(self, u, outputs), False
        if _dataset.is_dataset(u):
            if y is not None:
                raise ValueError("y: found beside a Dataset, which has the outputs already")
            found = _dataset.from_xarray(u, dt=None if "dt" in u.attrs else self.dt, outputs_required=outputs)
            return self._by_name(found), False
        if outputs and y is None:
            raise ValueError(f"y: none found, outputs (N, T, {self.outputs}) needed")
        core, single = core_of(u, y, self.dt)
        for name in ("input_names", "input_units"):
            if core.inputs == self.inputs:
                setattr(core, name, getattr(self._core, name))
        for name in ("output_names", "output_units"):
            if core.outputs == self.outputs:
                setattr(core, name, getattr(self._core, name))
        core.check(False)
        if outputs and (remark := core.swapped_axes()) is not None:
            warn([remark])
        return core, single

    def _by_name(self, data: _tokid.Ensemble) -> _tokid.Ensemble:
        """The data with the channels of the model in its order, where they have its names."""
        ordered = self._core.in_order(data)
        if ordered is None:
            return data
        order = ", ".join(self.output_names)
        warn([f"the data's channels were taken by name; results have the model's order: {order}"])
        return ordered

    # Coordinates and parameters

    def markov(self, band: int) -> Array:
        """Markov parameters, which no coordinates change.

        Parameters
        ----------
        band : int
            Largest number of steps between input and output.

        Returns
        -------
        h : ndarray, shape (S, band, m, r)
            Entry [s, g-1] is h(k, k-g), k = k_begin + s: what an input at k - g adds to the output at k. NaN where
            the model has no step k - g.
        """
        return self._core.markov(_options.integer("band", band, 1))

    def pulse_response(self, k: int, i: int) -> Array:
        """h(k, i), shape (m, r): what an input at step i < k adds to the output at step k."""
        step = _options.integer("k", k, self.k_begin, self.k_end - 1)
        return self._core.pulse_response(step, _options.integer("i", i, self.k_begin, step - 1))

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

    def deadbeat_products(self, p: Optional[int] = None) -> Array:
        """Norms of p successive closed loops, from `k_begin` on: zero for a deadbeat observer; p: the lag order."""
        return self._core.deadbeat_products(max(1, *self.lags, 1) if p is None else _options.integer("p", p, 1))

    def closed_loop_spectrum(
        self, *, reference_step: Optional[int] = None, threads: int = 1
    ) -> tuple[int, ComplexArray]:
        """Eigenvalues of A + G C in a reference frame, which are the same for every model of a system.

        Parameters
        ----------
        reference_step : int, optional
            Step of the frame, by default the first one with all states.
        threads : int, default 1

        Returns
        -------
        begin : int
            Step of the first entry.
        eigenvalues : ndarray of complex, shape (steps, n)
            NaN where A + G C is not finite.
        """
        step = _options.step("reference_step", reference_step)
        begin, values = _tokid.closed_loop_spectrum(self._core, step, _options.threads(threads))
        return begin, values

    def observability(self, k: int, rows: int) -> Array:
        """[C[k]; C[k+1] A[k]; …] with the given number of block rows, fewer at the end of the model."""
        step = _options.integer("k", k, self.k_begin, self.k_end - 1)
        return self._core.observability(step, _options.integer("rows", rows, 1, 1_000_000))

    def transform(self, S: Sequence[ArrayLike]) -> Model:
        """The model with the states S[k] x[k], which changes no output.

        Parameters
        ----------
        S : sequence of array_like, S+1 matrices (n, n)
            A regular matrix for each step, and one for the state behind the last one.
        """
        return self._same(self._core.transform(_matrices("S", S)), self._state)

    def from_step(self, k: int) -> Model:
        """The model from step k on, with everything that belongs to those steps."""
        return self._same(self._core.from_step(_options.integer("k", k, self.k_begin, self.k_end)))

    def _same(self, core: _tokid.Model, state: Optional[UpdateState] = None) -> Model:
        return Model._of(
            core,
            self._warnings,
            identification=self._identification,
            refinement=self._refinement,
            updated=self._updated,
            state=state,
        )

    # In the forms of other packages (interop.py)

    def to_control(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """The step k as a `control.StateSpace`; without k for a time-invariant model.

        A step at which the number of states changes needs ``pad=True``, which fills up with zeros. See
        `interop.to_control`.
        """
        from . import interop

        return interop.to_control(self, k, pad=pad)

    def to_scipy(self, k: Optional[int] = None, *, pad: bool = False) -> Any:
        """The step k as a `scipy.signal.StateSpace` in discrete time; else as `to_control`."""
        from . import interop

        return interop.to_scipy(self, k, pad=pad)

    def to_xarray(self) -> xarray.Dataset:
        """All matrices as an `xarray.Dataset` with the coordinates k, time, state, input and output.

        Entries that a step of fewer states does not have are NaN. See `interop.model_to_xarray`.
        """
        from . import interop

        return interop.model_to_xarray(self)

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
        from . import interop

        return interop.model_to_dataframe(self, u, y, horizon=horizon, x0=x0, initial_state=initial_state)

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
        return Model._of(self._core.copy(), self._warnings, **self._found())

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        return Model._of(self._core.copy(), self._warnings, **copy.deepcopy(self._found(), memo))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (*_state_of(self._core, _LISTS), self._warnings, self._found())

    def _found(self) -> dict[str, Any]:
        return {
            "identification": self._identification,
            "refinement": self._refinement,
            "updated": self._updated,
            "state": self._state,
        }


def _state_of(core: _tokid.Model, lists: Iterable[str]) -> tuple[Any, ...]:
    """All that a model holds, of the matrices those that are named; stacked, for there may be very many steps."""
    state: dict[str, Any] = {name: getattr(core, name) for name in _PLAIN}
    state["initial_state"] = str(core.initial_state.name)
    arrays = {name: np.asarray(getattr(core, name)) for name in _ARRAYS}
    return state, arrays, {name: core.stack(name) for name in lists}, core.singular_values_joined()


def _core_from(
    state: dict[str, Any], arrays: dict[str, Array], stacks: dict[str, Array], singular_values: tuple[Array, list[int]]
) -> _tokid.Model:
    core = _tokid.Model()
    for name, value in state.items():
        setattr(core, name, _tokid.InitialState[value] if name == "initial_state" else value)
    for name, array in arrays.items():
        setattr(core, name, array)
    for name, stack in stacks.items():
        core.set_stack(name, np.ascontiguousarray(stack))
    values, sizes = singular_values
    core.set_singular_values(np.ascontiguousarray(values), sizes)
    return core


def _restored(
    state: dict[str, Any],
    arrays: dict[str, Array],
    stacks: dict[str, Array],
    singular_values: tuple[Array, list[int]],
    warnings: Sequence[str],
    found: dict[str, Any],
) -> Model:
    return Model._of(_core_from(state, arrays, stacks, singular_values), warnings, **found)


def _sequence(name: str, steps: range, *state: Any) -> MatrixSequence:
    return MatrixSequence(_core_from(*state), name, steps)


def _matrices(name: str, values: Sequence[ArrayLike]) -> list[Any]:
    if isinstance(values, MatrixSequence):
        return list(values)
    if not isinstance(values, Iterable) or isinstance(values, (str, bytes, Mapping)):
        raise ValueError(f"{name}: {values!r} found, a matrix for each step needed: (S, rows, columns)")
    if isinstance(values, np.ndarray) and values.ndim != 3:
        raise ValueError(f"{name}: shape {values.shape} found, a matrix for each step needed: (S, rows, columns)")
    return [_arrays.shaped(f"{name}[{s}]", value, (None, None), "rows, columns") for s, value in enumerate(values)]


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
