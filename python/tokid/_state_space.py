# SPDX-License-Identifier: BSD-3-Clause
"""The matrices and the other values of a model."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Optional, overload

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from . import _arrays, _options, _tokid
from ._channels import Channels
from ._held import Held, read_only
from ._typing import Array, ArrayLike, ComplexArray, IndexArray


class MatrixSequence(NDArrayOperatorsMixin, Sequence[Array]):
    """The matrices of all steps. Entry s = 0 … S-1 belongs to the step k = k_begin + s.

    An entry is a read-only view of the matrix in the model, and keeps the model alive. A slice of steps is a sequence
    of such views. The shapes vary with the state dimensions. `stack` and ``numpy.asarray`` pad the matrices with zeros
    and return one array. All other indices, operators and NumPy functions act on this array. `shape`, `ndim` and
    `dtype` are those of this array too.

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
        """Shape (S, rows, columns) of `stack`."""
        rows, columns = self._core.stacked_size(self._name)
        return len(self), rows, columns

    @property
    def ndim(self) -> int:
        """Number of dimensions of `stack`."""
        return 3

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """Type of the numbers."""
        return np.dtype(np.float64)

    def __contains__(self, matrix: object) -> bool:
        return any(np.array_equal(entry, np.asarray(matrix)) for entry in self)

    def index(self, matrix: Any, start: int = 0, stop: Optional[int] = None) -> int:
        """Return the number of the first entry that equals a matrix."""
        for s in range(*slice(start, stop).indices(len(self))):
            if np.array_equal(self[s], np.asarray(matrix)):
                return s
        raise ValueError(f"{self._name}: the matrix found is none of the entries")

    def count(self, matrix: Any) -> int:
        """Number of entries that equal a matrix."""
        return sum(np.array_equal(entry, np.asarray(matrix)) for entry in self)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **others: Any) -> Any:
        arrays = [x.stack() if isinstance(x, MatrixSequence) else x for x in inputs]
        if any(isinstance(x, MatrixSequence) for x in others.get("out", ())):
            raise ValueError(
                f"{self._name}: the matrices of a model can't be changed. Use Model.from_matrices to make another model"
            )
        return getattr(ufunc, method)(*arrays, **others)

    def __reduce__(self) -> tuple[Any, ...]:
        return _sequence, (self._name, self._range, *state_of(self._core, (self._name,)))

    def __iter__(self) -> Iterator[Array]:
        return (self._core.matrix(self._name, s) for s in self._range)

    def stack(self) -> Array:
        """Return one array (S, rows, columns), padded with zeros to the largest state dimension, as in the files."""
        whole = self._core.stack(self._name)
        if self._range == range(len(whole)):
            return whole
        return whole[list(self._range)]

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray[Any, Any]:
        if copy is False:
            raise ValueError(f"{self._name}: copy=False found, but the array is a copy. Use entries, which are views")
        return self.stack() if dtype is None else self.stack().astype(dtype, copy=False)

    def __repr__(self) -> str:
        shapes = {a.shape for a in self}
        shape = f" {min(shapes)}" if len(shapes) == 1 else f", up to {self.stack().shape[1:]}" if shapes else ""
        return f"<{self._name}: {len(self)} {'matrix' if len(self) == 1 else 'matrices'}{shape}>"


@dataclass(frozen=True, eq=False)
class Step:
    """The model of one step, as views of the matrices in the model. None for a matrix that the model does not have.

    Attributes
    ----------
    k : int
        The step.
    A, B, C, D : ndarray, shapes (n', n), (n', r), (m, n), (m, r)
        x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], with n states at k and n' states at k+1.
    G : ndarray, shape (n', m), or None
        Observer gain. A + G C is the closed loop.
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
        """The closed loop A + G C of the observer."""
        if self.G is None:
            raise ValueError("the model has no observer gains G")
        closed_loop: Array = read_only(self.A + self.G @ self.C)
        return closed_loop


LISTS = ("A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K")
_PLAIN = (  # keep this order: state_dim makes the steps and needs inputs and outputs before
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


def _numbers(core: _tokid.Model, name: str) -> Array:
    return np.asarray(getattr(core, name), dtype=np.float64)


def _integers(core: _tokid.Model, name: str) -> IndexArray:
    return np.asarray(getattr(core, name), dtype=np.int64)


def _array_or_none(core: _tokid.Model, name: str) -> Optional[Array]:
    array: Array = getattr(core, name)
    return array if array.size else None


def _singular_values(core: _tokid.Model, _: str) -> Sequence[Array]:
    return [core.singular_values(s) for s in range(core.singular_values_count())]


def _options_of(core: _tokid.Model, _: str) -> dict[str, Any]:
    try:
        options = json.loads(core.options or "{}")
    except json.JSONDecodeError:
        return {}
    return options if isinstance(options, dict) else {}


class StateSpace(Channels):
    """The matrices of every step k = k_begin … k_end-1, the other values of a model, and what follows from them."""

    __slots__ = ("_core",)
    _core: _tokid.Model

    A = Held("State matrices (S) of shape (n', n).", MatrixSequence)
    B = Held("Input matrices (S) of shape (n', r).", MatrixSequence)
    C = Held("Output matrices (S) of shape (m, n).", MatrixSequence)
    D = Held("Feedthrough matrices (S) of shape (m, r).", MatrixSequence)
    G = Held("Observer gains (S) of shape (n', m). A + G C is the closed loop.", MatrixSequence)
    innovation_cov = Held("Covariances (S) of the innovations (m, m); empty if not known.", MatrixSequence)
    Q = Held("Covariances (S) of the process noise (n', n'); empty if not known.", MatrixSequence)
    R = Held("Covariances (S) of the measurement noise (m, m); empty if not known.", MatrixSequence)
    K = Held("Kalman gains (S) of shape (n, m); empty if not known.", MatrixSequence)

    steps = Held[int]("Number of steps S.")
    states = Held[int]("Largest state dimension n.")
    k_begin = Held[int]("First step with a model.")
    k_end = Held[int]("Step after the last one.", lambda core, _: core.k_begin + core.steps)
    full_begin = Held[int]("First step with all n states.")
    full_end = Held[int]("Step after the run of steps with all n states that starts at `full_begin`.")
    state_dim = Held("State dimensions (S+1) before each step and after the last one.", _integers)
    dt = Held[float]("Sample time [s].")
    period = Held[int]("P: the steps k and k + P have the same matrices. 1: time-invariant. 0: no period.")
    frame_name = Held[str]('Frame of the states: "raw", "reference" or "smooth".', lambda core, _: core.frame)
    method = Held[str]('Origin of the model: "tvera", "subspace", "regression", "em", "known".')
    initial_state = Held[str](
        'Initial states of the training data: "zero" or "unknown".', lambda core, _: core.initial_state.name
    )
    u_nominal = Held("Nominal inputs (T, r) that were removed before the identification, or None.", _array_or_none)
    y_nominal = Held("Nominal outputs (T, m) that were removed before the identification, or None.", _array_or_none)
    x0_mean = Held("Mean (n,) of the state at `k_begin`, or None.", _array_or_none)
    x0_cov = Held("Covariance (n, n) of the state at `k_begin`, or None.", _array_or_none)
    singular_values = Held(
        "Singular values (S) of the Hankel matrix or weighted predictor of each step; empty if not known.",
        _singular_values,
    )
    condition = Held("Condition number (S,) of the scaled regression of each step; empty if not known.", _numbers)
    rank = Held("Rank (S,) of the regression of each step; empty if not known.", _integers)
    lags = Held("Lag order (S,) of each step; empty if not known.", _integers)
    options = Held("Options and choices of the identification, as in the files; {} if not known.", _options_of)
    version = Held[str]("Version of the program that made the model.")

    time = Held[Array](
        "Times (S,) of the steps of the model [s].",
        lambda core, _: np.arange(core.k_begin, core.k_begin + core.steps, dtype=np.float64) * core.dt,
    )

    def at(self, k: int) -> Step:
        """Return the model of step k. A model with a period continues after its last step.

        Raises
        ------
        ValueError
            If the model has no such step.
        """
        core = self._core
        s = _options.integer("k", k, self.k_begin, None if core.period else self.k_end - 1) - core.k_begin
        if s >= core.steps:
            s -= -((core.steps - 1 - s) // core.period) * core.period
        matrices: dict[str, Any] = {name: core.matrix(name, s) for name in LISTS if core.count(name)}
        return Step(k, **matrices)

    def markov(self, band: int) -> Array:
        """Return the Markov parameters. They do not depend on the coordinates of the states.

        Parameters
        ----------
        band : int
            Largest number of steps between input and output.

        Returns
        -------
        h : ndarray, shape (S, band, m, r)
            Entry [s, g-1] is h(k, k-g) with k = k_begin + s: the response of the output at step k to a unit pulse at
            step k - g. NaN if the model has no step k - g.
        """
        return self._core.markov(_options.integer("band", band, 1))

    def pulse_response(self, k: int, i: int) -> Array:
        """Return h(k, i), shape (m, r): the response of the output at step k to a unit pulse at step i < k."""
        step = _options.integer("k", k, self.k_begin, self.k_end - 1)
        return self._core.pulse_response(step, _options.integer("i", i, self.k_begin, step - 1))

    def deadbeat_products(self, p: Optional[int] = None) -> Array:
        """Return the norms of the products of p successive closed loops, from `k_begin` on.

        They are zero for a deadbeat observer. p is by default the largest lag order.
        """
        return self._core.deadbeat_products(max(1, *self.lags, 1) if p is None else _options.integer("p", p, 1))

    def closed_loop_spectrum(self, *, reference_step: Optional[int] = None) -> tuple[int, ComplexArray]:
        """Return the eigenvalues of A + G C in a reference frame. They are the same for every model of a system.

        Parameters
        ----------
        reference_step : int, optional
            Step of the frame; by default the first one with all states.

        Returns
        -------
        begin : int
            Step of the first entry.
        eigenvalues : ndarray of complex, shape (steps, n)
            NaN if A + G C is not finite.
        """
        step = _options.step("reference_step", reference_step)
        begin, values = _tokid.closed_loop_spectrum(self._core, step)
        return begin, values

    def observability(self, k: int, rows: int) -> Array:
        """Return [C[k]; C[k+1] A[k]; …] with the given number of block rows, or fewer near the end of the model."""
        step = _options.integer("k", k, self.k_begin, self.k_end - 1)
        return self._core.observability(step, _options.integer("rows", rows, 1, 1_000_000))


def state_of(core: _tokid.Model, lists: Iterable[str]) -> tuple[Any, ...]:
    """The values of a model for `core_from`, with the named matrices, stacked because there may be many steps."""
    state: dict[str, Any] = {name: getattr(core, name) for name in _PLAIN}
    state["initial_state"] = str(core.initial_state.name)
    arrays = {name: np.asarray(getattr(core, name)) for name in _ARRAYS}
    return state, arrays, {name: core.stack(name) for name in lists}, core.singular_values_joined()


def core_from(
    state: dict[str, Any], arrays: dict[str, Array], stacks: dict[str, Array], singular_values: tuple[Array, list[int]]
) -> _tokid.Model:
    """The model from the values of `state_of`."""
    core = _tokid.Model()
    for name, value in state.items():
        setattr(core, name, _tokid.InitialState[value] if name == "initial_state" else value)
    for name, array in arrays.items():
        setattr(core, name, array)
    for name, stack in stacks.items():
        core.set_stack(name, np.ascontiguousarray(stack))
    values, sizes = singular_values
    core.set_singular_values(np.ascontiguousarray(values), sizes)
    core.check()
    return core


def _sequence(name: str, steps: range, *state: Any) -> MatrixSequence:
    return MatrixSequence(core_from(*state), name, steps)


def matrices_of(name: str, values: Sequence[ArrayLike]) -> list[Any]:
    """The matrices of all steps, checked, from those of a user."""
    if isinstance(values, MatrixSequence):
        return list(values)
    if not isinstance(values, Iterable) or isinstance(values, (str, bytes, Mapping)):
        raise ValueError(f"{name}: {values!r} found, a matrix for each step needed: (S, rows, columns)")
    if isinstance(values, np.ndarray) and values.ndim != 3:
        raise ValueError(f"{name}: shape {values.shape} found, a matrix for each step needed: (S, rows, columns)")
    return [_arrays.shaped(f"{name}[{s}]", value, (None, None), "rows, columns") for s, value in enumerate(values)]
