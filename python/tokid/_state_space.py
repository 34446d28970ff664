# SPDX-License-Identifier: BSD-3-Clause
"""The matrices of every step, and what goes with them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Optional, overload

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from . import _arrays, _options, _tokid
from ._channels import Channels
from ._typing import Array, ArrayLike, ComplexArray


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
        return _sequence, (self._name, self._range, *state_of(self._core, (self._name,)))

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


LISTS = ("A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K")
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


class StateSpace(Channels):
    """What a model holds: the matrices of every step k = k_begin … k_end-1, and what follows from them alone."""

    __slots__ = ("_core",)
    _core: _tokid.Model

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
        matrices: dict[str, Any] = {name: core.matrix(name, s) for name in LISTS if core.count(name)}
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

    # Of its identification

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

    # Parameters

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


def state_of(core: _tokid.Model, lists: Iterable[str]) -> tuple[Any, ...]:
    """All that a model holds, of the matrices those that are named; stacked, for there may be very many steps."""
    state: dict[str, Any] = {name: getattr(core, name) for name in _PLAIN}
    state["initial_state"] = str(core.initial_state.name)
    arrays = {name: np.asarray(getattr(core, name)) for name in _ARRAYS}
    return state, arrays, {name: core.stack(name) for name in lists}, core.singular_values_joined()


def core_from(
    state: dict[str, Any], arrays: dict[str, Array], stacks: dict[str, Array], singular_values: tuple[Array, list[int]]
) -> _tokid.Model:
    """The model of what `state_of` returns."""
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


def _sequence(name: str, steps: range, *state: Any) -> MatrixSequence:
    return MatrixSequence(core_from(*state), name, steps)


def matrices_of(name: str, values: Sequence[ArrayLike]) -> list[Any]:
    """A matrix for each step, as users give them."""
    if isinstance(values, MatrixSequence):
        return list(values)
    if not isinstance(values, Iterable) or isinstance(values, (str, bytes, Mapping)):
        raise ValueError(f"{name}: {values!r} found, a matrix for each step needed: (S, rows, columns)")
    if isinstance(values, np.ndarray) and values.ndim != 3:
        raise ValueError(f"{name}: shape {values.shape} found, a matrix for each step needed: (S, rows, columns)")
    return [_arrays.shaped(f"{name}[{s}]", value, (None, None), "rows, columns") for s, value in enumerate(values)]
