# SPDX-License-Identifier: BSD-3-Clause
"""Models: a matrix sequence with its observer."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Optional, Union, overload

import numpy as np

from . import _arrays, _dataframe, _options, _tokid
from ._ensemble import Ensemble, core_of, plural
from ._errors import warn
from ._typing import Array, ArrayLike, PathLike
from .results import Identification, Validation

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]


class MatrixSequence(Sequence[Array]):
    """The matrices of all steps, entry s = 0 … S-1 for the step k = k_begin + s.

    An entry is a read-only view of the model's own matrix, which it keeps alive. State dimensions may vary from step
    to step, and with them the shapes; `stack` and ``numpy.asarray`` pad them with zeros to one array.

    Examples
    --------
    >>> model = tokid.example_system("oscillator", steps=40)
    >>> model.A
    <A: 40 matrices (4, 4)>
    >>> model.A[3].shape, np.asarray(model.A).shape
    ((4, 4), (40, 4, 4))
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
    def __getitem__(self, s: Union[int, slice]) -> Union[Array, MatrixSequence]:
        if isinstance(s, slice):
            return MatrixSequence(self._core, self._name, self._range[s])
        try:
            step = self._range[s]
        except IndexError:
            raise IndexError(f"{self._name}: entry {s} found, one of {len(self)} needed") from None
        return self._core.matrix(self._name, step)

    def __iter__(self) -> Iterator[Array]:
        return (self._core.matrix(self._name, s) for s in self._range)

    def stack(self) -> Array:
        """One array (S, rows, columns), as in the files: padded with zeros to the largest state dimension."""
        whole = self._core.stack(self._name)
        if self._range == range(len(whole)):
            return whole
        return whole[self._range.start : self._range.stop : self._range.step] if self._range else whole[:0]

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
_PLAIN = (
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


class Model:
    """A model of every step k = k_begin … k_end-1, with its observer::

        x[k+1] = A[k] x[k] + B[k] u[k]
        y[k]   = C[k] x[k] + D[k] u[k]

    Models come from `tokid.identify`, `tokid.load`, `tokid.example_system` and `Model.from_matrices`. They do not
    change: what makes another model of one returns that.

    Wherever a method takes ``u`` and ``y``, one experiment may be given as (T, r) and (T, m), and an `Ensemble` in the
    place of both. Arrays come back with as many dimensions as they went in with.
    """

    __slots__ = ("_core", "_identification", "_warnings", "__weakref__")
    _core: _tokid.Model
    _identification: Optional[Identification]
    _warnings: tuple[str, ...]

    def __init__(self) -> None:
        raise TypeError(
            "models come from tokid.identify, tokid.load, tokid.example_system or tokid.Model.from_matrices"
        )

    @classmethod
    def _of(
        cls, core: _tokid.Model, identification: Optional[Identification] = None, warnings: Sequence[str] = ()
    ) -> Model:
        self = cls.__new__(cls)
        self._core = core
        self._identification = identification
        self._warnings = tuple(warnings)
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
            if not lists[name]:
                raise ValueError(f"{name}: no matrices found, one for each step needed")
        core.inputs = lists["B"][0].shape[1]
        core.outputs = lists["C"][0].shape[0]
        if D is None:
            lists["D"] = [np.zeros((core.outputs, core.inputs))] * len(lists["A"])
        if G is None:
            lists["G"] = [np.zeros((a.shape[0], core.outputs)) for a in lists["A"]]
        for name, matrices in lists.items():
            core.set_matrices(name, matrices)
        core.state_dim = [a.shape[1] for a in lists["A"]] + [lists["A"][-1].shape[0]]
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
        for name, texts in (
            ("input_names", input_names),
            ("output_names", output_names),
            ("input_units", input_units),
            ("output_units", output_units),
        ):
            if texts is not None:
                setattr(core, name, list(texts))
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
        return cls._of(_tokid.load_model(path))

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Writes the model to .npz, .h5 or .mat, whole or not at all; the extension says the format.

        Parameters
        ----------
        path : path
            The file.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        _tokid.save_model(self._core, path, mat73)

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
        matrices = {name: core.matrix(name, s) if core.count(name) else None for name in _LISTS}
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
    def inputs(self) -> int:
        """Number of inputs r."""
        return self._core.inputs

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self._core.outputs

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
        return np.arange(self.k_begin, self.k_end) * self.dt

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
    def input_names(self) -> list[str]:
        """Names (r) of the inputs, u1 … ur where none were given."""
        return self._core.input_names or [f"u{i + 1}" for i in range(self.inputs)]

    @property
    def output_names(self) -> list[str]:
        """Names (m) of the outputs, y1 … ym where none were given."""
        return self._core.output_names or [f"y{j + 1}" for j in range(self.outputs)]

    @property
    def input_units(self) -> list[str]:
        """Units (r) of the inputs, "" where they are not known."""
        return self._core.input_units or [""] * self.inputs

    @property
    def output_units(self) -> list[str]:
        """Units (m) of the outputs, "" where they are not known."""
        return self._core.output_units or [""] * self.outputs

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
    ) -> Array:
        """Outputs for inputs alone.

        Parameters
        ----------
        u : array_like, shape (N, T, r) or (T, r), or Ensemble
            Inputs, from step 0 on.
        x0 : array_like, shape (N, n) or (n,), optional
            States of the experiments at `k_begin`. By default zero, or `x0_mean` where the initial states are unknown
            and the model has estimated them.

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            NaN where the model has no step, and behind a missing input. The nominal trajectory is added back.
        """
        data, single = self._data(u, None)
        start = None
        if x0 is not None:
            n = int(self._core.state_dim[0])
            start = _arrays.numbers("x0", x0)
            if start.ndim == 1:
                start = np.broadcast_to(start, (data.experiments, len(start)))
            start = _arrays.shaped("x0", start, (data.experiments, n)).T
        return _result(self._core.simulate(data, start), single)

    def predict(
        self,
        u: Union[ArrayLike, Ensemble],
        y: Optional[ArrayLike] = None,
        *,
        horizon: int = 1,
        initial_state: str = "auto",
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

        Returns
        -------
        y : ndarray, shape (N, T, m) or (T, m)
            NaN where there is no prediction.
        """
        data, single = self._data(u, y, outputs=True)
        initial = _options.choice("initial_state", initial_state, _options.INITIAL_STATES)
        return _result(self._core.predict(data, _options.integer("horizon", horizon, 1), initial), single)

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
        whiteness_lags: int = 5,
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
            NaN where a sample is missing that the state needs.
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
            return u._core, False
        if _dataframe.is_dataframe(u):
            if y is not None:
                raise ValueError("y: found beside a DataFrame, which has the outputs already")
            return _dataframe.core_for(self, u, outputs), False
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
        return core, single

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
        return self._core.pulse_response(k, i)

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
            return self._same(core.smooth_frame(rows))
        step = core.full_begin if reference_step is None else _options.integer("reference_step", reference_step, 0)
        return self._same(core.reference_frame(step, rows))

    def transform(self, S: Sequence[ArrayLike]) -> Model:
        """The model with the states S[k] x[k], which changes no output.

        Parameters
        ----------
        S : sequence of array_like, S+1 matrices (n, n)
            A regular matrix for each step, and one for the state behind the last one.
        """
        return self._same(self._core.transform(_matrices("S", S)))

    def from_step(self, k: int) -> Model:
        """The model from step k on, with everything that belongs to those steps."""
        return self._same(self._core.from_step(k))

    def _same(self, core: _tokid.Model) -> Model:
        return Model._of(core, self._identification, self._warnings)

    # In the forms of other packages (interop.py)

    def to_control(self, k: Optional[int] = None) -> Any:
        """The step k as a `control.StateSpace`; without k for a time-invariant model. See `interop.to_control`."""
        from . import interop

        return interop.to_control(self, k)

    def to_scipy(self, k: Optional[int] = None) -> Any:
        """The step k as a `scipy.signal.StateSpace` in discrete time; without k for a time-invariant model."""
        from . import interop

        return interop.to_scipy(self, k)

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

    # Copies, also in other processes

    def __reduce__(self) -> tuple[Any, ...]:
        core = self._core
        state: dict[str, Any] = {name: getattr(core, name) for name in _PLAIN}
        state["initial_state"] = self.initial_state
        arrays = {name: np.asarray(getattr(core, name)) for name in _ARRAYS}
        lists = {name: list(MatrixSequence(core, name)) for name in _LISTS}
        return _restored, (state, arrays, lists, self.singular_values, self._identification, self._warnings)


def _restored(
    state: dict[str, Any],
    arrays: dict[str, Array],
    lists: dict[str, list[Array]],
    singular_values: list[Array],
    identification: Optional[Identification],
    warnings: Sequence[str],
) -> Model:
    core = _tokid.Model()
    for name, value in state.items():
        setattr(core, name, _tokid.InitialState[value] if name == "initial_state" else value)
    for name, array in arrays.items():
        setattr(core, name, array)
    for name, matrices in lists.items():
        core.set_matrices(name, matrices)
    core.set_singular_values(singular_values)
    return Model._of(core, identification, warnings)


def _matrices(name: str, values: Sequence[ArrayLike]) -> list[Any]:
    if isinstance(values, np.ndarray) and values.ndim != 3:
        raise ValueError(f"{name}: shape {values.shape} found, a matrix for each step needed: (S, rows, columns)")
    return [_arrays.shaped(f"{name}[{s}]", value, (None, None), "rows, columns") for s, value in enumerate(values)]


def _result(computed: _tokid.Ensemble, single: bool) -> Array:
    y = computed.outputs_copied()
    return y[0] if single else y
