# SPDX-License-Identifier: BSD-3-Clause
"""Bridges to python-control, SciPy, xarray and pandas.

The conversions are also methods of models and ensembles: `Model.to_control`, `Model.to_scipy`, `Model.to_xarray`,
`Model.to_dataframe`, `Ensemble.to_xarray`, `Ensemble.from_xarray`, `Ensemble.to_dataframe` and
`Ensemble.from_dataframe`. Each function imports its package when it is called.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Optional, Union, overload

import numpy as np

from . import _arrays, _dataframe, _options
from ._ensemble import Ensemble
from ._model import Model
from ._typing import Array, ArrayLike

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]

__all__ = [
    "dataframe_of",
    "ensemble_from_dataframe",
    "ensemble_from_xarray",
    "ensemble_to_dataframe",
    "ensemble_to_xarray",
    "model_to_dataframe",
    "model_to_xarray",
    "simulate_ltv",
    "to_control",
    "to_scipy",
]


def _contiguous(array: Any) -> Array:
    return np.ascontiguousarray(array, dtype=np.float64)


# ---- state-space objects of one step ----


def to_control(model: Model, k: Optional[int] = None, *, pad: bool = False) -> Any:
    """Return step k of a model as a `control.StateSpace`.

    Parameters
    ----------
    model : Model
        The model.
    k : int, optional
        The step. A time-invariant model needs none.
    pad : bool, default False
        Pad with zeros to the largest state dimension, as in the files. Then all steps have the same size, including
        those at which the state dimension changes. The added states have no effect.

    Returns
    -------
    control.StateSpace
        A system with the sample time and the channel names of the model. If the model has a nominal trajectory, the
        system describes departures from it.

    Raises
    ------
    ImportError
        If python-control is not installed.
    ValueError
        If the model has no step k, or if the state dimension changes at this step and `pad` is False.

    Examples
    --------
    >>> model = tokid.example_system("oscillator", steps=40)
    >>> model.to_control(3).dt
    0.05
    """
    return model.to_control(k, pad=pad)


def to_scipy(model: Model, k: Optional[int] = None, *, pad: bool = False) -> Any:
    """Return step k of a model as a `scipy.signal.StateSpace` with its sample time (a `dlti`).

    Parameters, result and errors are as in `to_control`.

    Examples
    --------
    >>> model = tokid.example_system("oscillator", steps=40)
    >>> model.to_scipy(3).A.shape
    (4, 4)
    """
    return model.to_scipy(k, pad=pad)


# ---- simulation of any sequence of systems ----


def _is_continuous(system: Any) -> bool:
    signal = sys.modules.get("scipy.signal")
    if signal is not None and isinstance(system, signal.lti):
        return True
    dt = getattr(system, "dt", None)
    return dt is not None and dt is not True and dt == 0


def _matrices_of(system: Any, name: str) -> tuple[Array, Array, Array, Array]:
    if isinstance(system, (tuple, list)):
        if len(system) != 4:
            raise ValueError(f"{name}: {len(system)} matrices found, (A, B, C, D) needed")
        found = system
    elif all(hasattr(system, letter) for letter in "ABCD"):
        found = tuple(getattr(system, letter) for letter in "ABCD")
    else:
        raise ValueError(f"{name}: {type(system).__name__} found, a state-space object or matrices (A, B, C, D) needed")
    if _is_continuous(system):
        raise ValueError(f"{name}: a system in continuous time found, one in discrete time needed")
    a, b, c, d = (
        _contiguous(_arrays.shaped(f"{name}.{letter}", np.asarray(value), (None, None), "rows, columns"))
        for letter, value in zip("ABCD", found)
    )
    for letter, matrix, shape in (
        ("B", b, (a.shape[0], b.shape[1])),
        ("C", c, (c.shape[0], a.shape[1])),
        ("D", d, (c.shape[0], b.shape[1])),
    ):
        if matrix.shape != shape:
            raise ValueError(f"{name}.{letter}: shape {matrix.shape} found, {shape} needed")
    return a, b, c, d


def _sample_time(system: Any) -> Optional[float]:
    dt = getattr(system, "dt", None)
    return None if dt is None or dt is True else _options.number("dt", dt)


@overload
def simulate_ltv(
    systems: Any, u: ArrayLike, x0: Optional[ArrayLike] = None, *, return_states: Literal[False] = False
) -> Array: ...
@overload
def simulate_ltv(
    systems: Any, u: ArrayLike, x0: Optional[ArrayLike] = None, *, return_states: Literal[True]
) -> tuple[Array, Array]: ...
def simulate_ltv(
    systems: Any,
    u: ArrayLike,
    x0: Optional[ArrayLike] = None,
    *,
    return_states: bool = False,
) -> Union[Array, tuple[Array, Array]]:
    """Simulate a sequence of systems. The system of step k gives the state at step k+1 from the state at step k.

    The result is that of `control.forced_response` and `scipy.signal.dlsim` for a constant system, and that of
    `Model.simulate` for the steps of a `Model`.

    Parameters
    ----------
    systems : sequence, or a single system for all steps
        One system in discrete time for each step. Systems are objects of python-control or SciPy, steps of a model
        (`Model.at`), or tuples (A, B, C, D) of shapes (n', n), (n', r), (m, n), (m, r). The state dimension may vary:
        n of each system must be n' of the previous one.
    u : array_like, shape (N, T, r) or (T, r)
        Inputs of N experiments or of one, from the first system on. There must be a system for each step.
    x0 : array_like, shape (N, n) or (n,), optional
        States before the first step; by default zero.
    return_states : bool, default False
        Also return the states.

    Returns
    -------
    y : ndarray, shape (N, T, m) or (T, m)
        Outputs. NaN after a missing input.
    x : ndarray, shape (N, T+1, n) or (T+1, n)
        With `return_states`: states before each step and after the last one, padded with NaN to the largest dimension.

    Raises
    ------
    ValueError
        If systems are in continuous time, have different sample times, or have sizes that do not match. The message
        names the system.

    Examples
    --------
    >>> model = tokid.example_system("oscillator", steps=40)
    >>> u = np.ones((40, 2))
    >>> y = tokid.interop.simulate_ltv([model.to_control(k) for k in range(40)], u)
    >>> bool(np.allclose(y, model.simulate(u)))
    True
    """
    if isinstance(systems, Model):
        raise ValueError("systems: a Model found, its steps [model.at(k), …] needed. Use Model.simulate for a model")
    inputs, single = _arrays.samples("u", u, "r")
    inputs = _contiguous(inputs)
    experiments, steps, r = inputs.shape
    constant = all(hasattr(systems, letter) for letter in "ABCD") or (
        isinstance(systems, tuple) and len(systems) == 4 and isinstance(systems[0], np.ndarray) and systems[0].ndim == 2
    )
    if constant:
        first = _matrices_of(systems, "systems")
        matrices = [first] * max(steps, 1)
    else:
        if len(systems) < max(steps, 1):
            raise ValueError(f"u: {steps} steps found, at most {len(systems)} needed, as many as systems")
        used = systems[: max(steps, 1)]
        matrices = [_matrices_of(system, f"systems[{i}]") for i, system in enumerate(used)]
        times = {dt for dt in map(_sample_time, used) if dt is not None}
        if len(times) > 1:
            raise ValueError(f"systems: sample times {min(times):g} to {max(times):g} s found, one needed")
    n, m = matrices[0][0].shape[1], matrices[0][2].shape[0]
    states = n
    for i, (a, b, c, _) in enumerate(matrices):
        for what, found, needed in (
            ("inputs", b.shape[1], r),
            ("outputs", c.shape[0], m),
            ("states", a.shape[1], states),
        ):
            if found != needed:
                raise ValueError(f"systems[{i}]: {found} {what} found, {needed} needed")
        states = a.shape[0]

    x = np.zeros((experiments, n))
    if x0 is not None:
        start = _arrays.numbers("x0", x0)
        x = x + _contiguous(_arrays.shaped("x0", start, (n,) if start.ndim == 1 else (experiments, n)))
    y = np.empty((experiments, steps, m))
    path = [x]
    for k, (a, b, c, d) in enumerate(matrices[:steps]):
        y[:, k] = x @ c.T + inputs[:, k] @ d.T
        x = x @ a.T + inputs[:, k] @ b.T
        if return_states:
            path.append(x)
    if not return_states:
        return y[0] if single else y
    all_states = np.full((experiments, steps + 1, max(state.shape[1] for state in path)), np.nan)
    for k, state in enumerate(path):
        all_states[:, k, : state.shape[1]] = state
    return (y[0], all_states[0]) if single else (y, all_states)


# ---- xarray ----


def model_to_xarray(model: Model) -> xarray.Dataset:
    """Return a model as an `xarray.Dataset`.

    Parameters
    ----------
    model : Model
        The model.

    Returns
    -------
    xarray.Dataset
        ``A`` (k, state_next, state), ``B`` (k, state_next, input), ``C`` (k, output, state), ``D`` (k, output, input),
        ``G`` (k, state_next, output) and, where the model has them, ``innovation_cov`` (k, output, output_2), ``Q``
        (k, state_next, state_next_2), ``R`` (k, output, output_2), ``K`` (k, state, output), ``singular_value`` (k,
        number), ``condition``, ``rank`` and ``lags`` (k), ``u_nominal`` (step, input), ``y_nominal`` (step, output),
        ``x0_mean`` (state), ``x0_cov`` (state, state_2). ``state_dim`` (k) and ``state_dim_next`` (k) are the state
        dimensions before and after each step.

        Coordinates: ``k``, ``time`` [s], ``step`` (of the nominal trajectory, from 0), ``state`` and ``number``
        (from 1), ``input`` and ``output`` (names), ``input_unit`` and ``output_unit`` if known. The attributes are dt,
        period, frame, method, initial_state, version and options (JSON).

    Notes
    -----
    Entries are NaN where a step has fewer states than others, so that means and plots leave them out.
    ``dataset.fillna(0.0)`` has zeros instead, as `MatrixSequence.stack` and the files.

    Examples
    --------
    >>> data = tokid.example_system("oscillator", steps=40).to_xarray()
    >>> data.A.sel(k=3).dims
    ('state_next', 'state')
    """
    return model.to_xarray()


def ensemble_to_xarray(ensemble: Ensemble) -> xarray.Dataset:
    """Return an ensemble as an `xarray.Dataset`.

    Parameters
    ----------
    ensemble : Ensemble
        The ensemble.

    Returns
    -------
    xarray.Dataset
        ``u`` (experiment, k, input) and ``y`` (experiment, k, output), which are views of the samples of the ensemble;
        ``length`` (experiment) if lengths are given; ``free_y`` (free_experiment, free_k, output) if there are free
        responses. Coordinates: ``experiment`` (names of the experiments or their rows), ``k``, ``time`` [s] if dt is
        stated, ``input`` and ``output`` (names), ``input_unit`` and ``output_unit`` if known. The attributes are dt and
        initial_state, if stated.
    """
    return ensemble.to_xarray()


def ensemble_from_xarray(data: xarray.Dataset, **options: Any) -> Ensemble:
    """Call `Ensemble.from_xarray`."""
    return Ensemble.from_xarray(data, **options)


# ---- pandas ----


def ensemble_from_dataframe(data: pandas.DataFrame, **options: Any) -> Ensemble:
    """Call `Ensemble.from_dataframe`."""
    return Ensemble.from_dataframe(data, **options)


def ensemble_to_dataframe(ensemble: Ensemble) -> pandas.DataFrame:
    """Call `Ensemble.to_dataframe`."""
    return ensemble.to_dataframe()


def model_to_dataframe(
    model: Model,
    u: Any,
    y: Optional[ArrayLike] = None,
    *,
    horizon: int = 1,
    x0: Optional[ArrayLike] = None,
    initial_state: str = "auto",
) -> pandas.DataFrame:
    """Call `Model.to_dataframe`."""
    return model.to_dataframe(u, y, horizon=horizon, x0=x0, initial_state=initial_state)


def dataframe_of(samples: ArrayLike, names: Sequence[str], *, dt: float = 1.0) -> pandas.DataFrame:
    """Return samples, such as those of `Model.predict` or `Model.innovations`, as a tidy table.

    Parameters
    ----------
    samples : array_like, shape (N, T, channels) or (T, channels)
        Samples of N experiments or of one.
    names : sequence of str
        Names of the channels.
    dt : float, default 1.0
        Sample time [s].

    Returns
    -------
    pandas.DataFrame
        A row for each experiment and step, with the columns ``experiment``, ``time`` [s] and one for each channel.

    Examples
    --------
    >>> table = tokid.interop.dataframe_of(model.innovations(data), ["e1", "e2"], dt=data.dt)
    """
    _dataframe.pandas()
    array, _ = _arrays.samples("samples", samples, "channels")
    if isinstance(names, str) or len(names) != array.shape[2]:
        raise ValueError(f"names: {names!r} found, a list of {array.shape[2]} texts needed")
    columns = [([str(name) for name in names], _contiguous(array))]
    table: pandas.DataFrame = _dataframe.tidy(_options.number("dt", dt), np.arange(array.shape[0]), columns)
    return table
