# SPDX-License-Identifier: BSD-3-Clause
"""The stages of an identification, arrays in and arrays out, so that a stage of your own can replace one of them.

The chain of data without noise is `gtv_arx` -> `markov` -> `hankel_factors` -> `realise` -> `completed`. The chain of
noisy data is `smooth_arx` -> `subspace` -> `refine`. `windows` gives the regressors and outputs of a step to a
regression of your own. `tokid.identify` runs the same stages and makes their choices. It gives the same bits for the
experiments and steps that it uses, in `content_order`.

Numbers in round brackets are the equations of the paper; docs/math.md explains them. Sizes: N experiments, T steps,
r inputs, m outputs, d = r + m, lag order p, L = p d + r regressors, S steps with a model. Channels keep their units.

All functions release the GIL while they compute, and Ctrl-C stops them. `threads` changes no bit of a result; 0: all of
the machine. The data state their initial states, for example by ``Ensemble(…, initial_state="zero")``.

Examples
--------
>>> data = tokid.example("oscillator", experiments=40, steps=30)
>>> arx = gtv_arx(data, 4)
>>> h = markov(arx, band=9)
>>> model = completed(realise(h, hankel_factors(h, rows=5, cols=5), states=4), data, arx)
>>> model
<tokid.Model: n = 4 states, r = 2 inputs, m = 2 outputs, steps 0 to 29, dt = 0.05 s>
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Optional, Union

import numpy as np

from . import _arrays, _options, _tokid
from ._ensemble import Ensemble
from ._errors import warn
from ._model import Model, Origin
from ._typing import Array, ArrayLike, IndexArray
from .results import Finding

__all__ = [
    "GtvArx",
    "HankelFactors",
    "Markov",
    "Refined",
    "channel_sizes",
    "completed",
    "content_order",
    "gtv_arx",
    "hankel_factors",
    "markov",
    "realise",
    "refine",
    "smooth_arx",
    "subspace",
    "windows",
    "with_nominal",
]

_WEIGHTINGS = {
    "one-step": _tokid.Weighting.one_step,
    "many-steps": _tokid.Weighting.many_steps,
    "projection": _tokid.Weighting.projection,
}
_MOST = 1_000_000_000  # of a number of blocks or steps


# ---- Values between the stages ----


class _Value:
    """A value between stages, made of its arrays, which are read-only copies. Its repr has their shapes."""

    def __repr__(self) -> str:
        fields = ((name, getattr(self, name)) for name in self.__dataclass_fields__)  # type: ignore[attr-defined]
        return f"{type(self).__name__}({', '.join(f'{name}={_short(value)}' for name, value in fields)})"

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # the dataclasses are frozen

    def __reduce__(self) -> Any:
        # Copies are made by the constructor, since arrays that are unpickled alone could be written to.
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}  # type: ignore[attr-defined]
        return partial(type(self), **fields), ()


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array{value.shape}"
    return f"list of {len(value)}" if isinstance(value, list) else repr(value)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class GtvArx(_Value):
    """The GTV-ARX model of every step (16), (17)::

        y[k] = M[k] [v[k-p]; …; v[k-1]; u[k]] + e[k],    v[k] = [u[k]; y[k]]

    `gtv_arx` and `smooth_arx` make it. The first five arguments suffice for an ARX model of your own. A wrong shape
    raises ValueError. The arrays are read-only copies.

    Parameters
    ----------
    coefficients : array_like, shape (T, m, L)
        L = r + p (r + m), where p is the largest lag order of a step. M[k] (18), (19): the blocks of the lags p … 1, each with r columns h̄¹ for the inputs and m columns -h̄² for the
        outputs (15), and at last D[k] with r columns. Zeros for lags that a step does not have.
    inputs : int
        Number of inputs r.
    lags : int or array_like of int, shape (T,)
        Lag orders p[k]. Step k has at most k lags: samples before step 0 are zero, or unknown.
    residual_cov : array_like, shape (T, m, m)
        Covariances of the residuals e[k], in units of outputs.
    output_rms : array_like, shape (T, m)
        RMS of the outputs over the experiments used.
    noise_shape : array_like, shape (T, L, q), optional
        X[k] with X Xᵀ = (Wᵀ W)⁺, or what takes its place in another regression: the covariance of the coefficients is
        residual_cov ⊗ X Xᵀ. Without it, `markov` gives no variances. X has the rows of the columns of M[k], and zeros for
        lags that a step does not have.
    feedthrough : bool, default True
        False: D = 0 is known, and its columns are zero.
    k_begin : int, default 0
        First step with a regression. Where the initial states are unknown, it is p.
    rank, condition, rows, freedom : array_like, shape (T,), optional
        They describe the regression of each step. `rank` is its numerical rank and the number of columns of X,
        `condition` its condition number, `rows` its number of experiments, and `freedom` the degrees of freedom of its
        residuals.
    """

    coefficients: Array
    inputs: int
    lags: IndexArray
    residual_cov: Array
    output_rms: Array
    noise_shape: Optional[Array]
    feedthrough: bool
    k_begin: int
    rank: Optional[IndexArray]
    condition: Optional[Array]
    rows: Optional[IndexArray]
    freedom: Optional[IndexArray]

    def __init__(
        self,
        coefficients: ArrayLike,
        inputs: int,
        lags: Union[int, ArrayLike],
        residual_cov: ArrayLike,
        output_rms: ArrayLike,
        noise_shape: Optional[ArrayLike] = None,
        feedthrough: bool = True,
        k_begin: int = 0,
        rank: Optional[ArrayLike] = None,
        condition: Optional[ArrayLike] = None,
        rows: Optional[ArrayLike] = None,
        freedom: Optional[ArrayLike] = None,
    ) -> None:
        self._set("coefficients", _numbers("coefficients", coefficients, (None, None, None), "T, m, L"))
        steps, m, width = self.coefficients.shape
        if 0 in self.coefficients.shape:
            raise ValueError(f"coefficients: shape {self.coefficients.shape} found, (T, m, L) without a zero needed")
        self._set("inputs", _options.integer("inputs", inputs, 1, width))
        self._set("k_begin", _options.integer("k_begin", k_begin, 0, steps))
        if np.ndim(lags) == 0:
            lags = np.full(steps, _options.integer("lags", lags, 1, max(1, steps - 1)))
        own = np.minimum(_integers("lags", lags, steps), np.arange(steps))
        own[: self.k_begin] = 0
        self._set("lags", _frozen(own, np.int64))
        p = int(own.max())
        needed = self.inputs + p * (self.inputs + m)
        if width != needed:
            raise ValueError(
                f"coefficients: shape {self.coefficients.shape} found, ({steps}, {m}, {needed}) needed: "
                f"L = r + p (r + m) with r = {self.inputs} inputs, p = {p} lags and m = {m} outputs"
            )
        self._set("residual_cov", _numbers("residual_cov", residual_cov, (steps, m, m)))
        self._set("output_rms", _numbers("output_rms", output_rms, (steps, m)))
        shapes = None if noise_shape is None else _numbers("noise_shape", noise_shape, (steps, width, None), "T, L, q")
        self._set("noise_shape", shapes)
        self._set("feedthrough", _options.switch("feedthrough", feedthrough))
        self._set("condition", None if condition is None else _numbers("condition", condition, (steps,)))
        for name, counts in (("rank", rank), ("rows", rows), ("freedom", freedom)):
            self._set(name, None if counts is None else _integers(name, counts, steps))

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return len(self.coefficients)

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return int(self.coefficients.shape[1])

    @property
    def D(self) -> Array:
        """D[k] (T, m, r), the last columns of `coefficients`."""
        return self.coefficients[:, :, self.coefficients.shape[2] - self.inputs :]


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Markov(_Value):
    """Markov parameters of all steps with 1 ≤ γ = k - i ≤ band. `markov` makes them (28)-(35).

    Entries before `i_begin` (k - γ < i_begin) have no meaning.

    Parameters
    ----------
    system : array_like, shape (T, band, m, r)
        [k, γ-1] is h[k, k-γ] (7), the response of the outputs at step k to a unit pulse of an input at step k-γ. The
        layout is that of `Model.markov`.
    gain : array_like, shape (T, band, m, m)
        [k, γ-1] is h°[k, k-γ] (30), the response to a pulse at the observer gain.
    D : array_like, shape (T, m, r)
        Feedthrough.
    system_noise : array_like, shape (T, band, m, r), optional
        Variances of the entries of `system`, to first order; by default zero.
    i_begin : int, default 0
        The first step of a pulse.
    """

    system: Array
    gain: Array
    D: Array
    system_noise: Optional[Array]
    i_begin: int

    def __init__(
        self,
        system: ArrayLike,
        gain: ArrayLike,
        D: ArrayLike,
        system_noise: Optional[ArrayLike] = None,
        i_begin: int = 0,
    ) -> None:
        self._set("system", _numbers("system", system, (None, None, None, None), "T, band, m, r"))
        steps, band, m, r = shape = self.system.shape
        if 0 in shape:
            raise ValueError(f"system: shape {shape} found, (T, band, m, r) without a zero needed")
        self._set("gain", _numbers("gain", gain, (steps, band, m, m)))
        self._set("D", _numbers("D", D, (steps, m, r)))
        self._set("system_noise", None if system_noise is None else _numbers("system_noise", system_noise, shape))
        self._set("i_begin", _options.integer("i_begin", i_begin, 0, steps))

    @property
    def band(self) -> int:
        """The largest γ."""
        return int(self.system.shape[1])


@dataclass(frozen=True, eq=False, repr=False, init=False)
class HankelFactors(_Value):
    """H[k] = U Σ Vᵀ = O[k] R[k-1] with O[k] = U Σ^½, for the steps k_begin … T-1. `hankel_factors` makes them.

    Parameters
    ----------
    u : sequence of array_like, shapes (rows m, q)
        Left singular vectors of each H[k]. Near the end, H[k] has only T - k block rows.
    singular_values : sequence of array_like, shapes (q,)
        Singular values of each H[k], in decreasing order.
    scale : array_like, shape (S,)
        The largest singular value, or the norm of D[k] if that is larger.
    error : array_like, shape (S,)
        Expected Frobenius norm of the error of H[k].
    rows, cols : int
        Block rows and columns of a complete H[k].
    k_begin : int, default 0
        Step of the first factor.
    output_size, input_size : array_like, shapes (m,), (r,), optional
        Units in which H[k] was formed; by default 1.
    """

    u: list[Array]
    singular_values: list[Array]
    scale: Array
    error: Array
    rows: int
    cols: int
    k_begin: int
    output_size: Array
    input_size: Array

    def __init__(
        self,
        u: Sequence[ArrayLike],
        singular_values: Sequence[ArrayLike],
        scale: ArrayLike,
        error: ArrayLike,
        rows: int,
        cols: int,
        k_begin: int = 0,
        output_size: Optional[ArrayLike] = None,
        input_size: Optional[ArrayLike] = None,
    ) -> None:
        self._set("singular_values", [_numbers("singular_values", s, (None,), "q") for s in singular_values])
        self._set("u", [_numbers("u", matrix, (None, None), "rows m, q") for matrix in u])
        count = len(self.singular_values)
        if len(self.u) != count:
            raise ValueError(f"u: {len(self.u)} matrices found, {count} needed, as many as singular_values")
        for s, values in enumerate(self.singular_values):
            if not (np.all(values >= 0) and np.all(np.diff(values) <= 0)):
                raise ValueError(f"singular_values: others found in entry {s}, decreasing numbers from 0 on needed")
            if not np.all(np.isfinite(self.u[s])):
                raise ValueError(f"u: a number that is not finite found in entry {s}, numbers needed")
        for name, size in (("scale", scale), ("error", error)):
            self._set(name, _numbers(name, size, (count,)))
            if not np.all(getattr(self, name) >= 0):
                raise ValueError(f"{name}: another value found, numbers from 0 on needed")
        self._set("rows", _options.integer("rows", rows, 1, _MOST))
        self._set("cols", _options.integer("cols", cols, 1, _MOST))
        self._set("k_begin", _options.integer("k_begin", k_begin, 0, _MOST))
        for name, sizes in (("output_size", output_size), ("input_size", input_size)):
            self._set(name, _numbers(name, np.zeros(0) if sizes is None else sizes, (None,), "channels"))


@dataclass(frozen=True, eq=False, repr=False)
class Refined(_Value):
    """The result of `refine`.

    Attributes
    ----------
    model : Model
        With Q, R, K, G = -A K of the Kalman filter, and `innovation_cov`.
    start_log_likelihood : float
        Log-likelihood of the given model.
    log_likelihood, penalised : ndarray, shape (iterations + 1,)
        Log-likelihood before the first iteration and after each one, without and with the penalty. EM maximises the
        penalised one, which never falls.
    iterations : int
    converged : bool
    noise_segments : int
        Number of stretches of steps with their own noise size.
    findings : list of Finding
    """

    model: Model
    start_log_likelihood: float
    log_likelihood: Array
    penalised: Array
    iterations: int
    converged: bool
    noise_segments: int
    findings: list[Finding]


# ---- Checks ----


def _numbers(name: str, values: Any, shape: Sequence[Optional[int]], letters: str = "") -> Any:
    """A read-only array of floats in the order of C, which no array of the caller shares."""
    return _frozen(_arrays.shaped(name, values, shape, letters), np.float64)


def _integers(name: str, values: Any, size: int) -> Any:
    array = _arrays.shaped(name, values, (size,))
    if np.any(array != np.floor(array)) or np.any(array < 0):
        raise ValueError(f"{name}: another value found, whole numbers from 0 on needed")
    return _frozen(array, np.int64)


def _frozen(array: Any, kind: Any) -> Any:
    copy = np.array(array, dtype=kind, order="C")
    copy.setflags(write=False)
    return copy


def _is(name: str, value: Any, wanted: type, hint: str = "") -> Any:
    if not isinstance(value, wanted):
        raise ValueError(f"{name}: {type(value).__name__} found, {wanted.__name__} needed{hint}")
    return value


def _samples(data: Any) -> _tokid.Ensemble:
    core: _tokid.Ensemble = _is("data", data, Ensemble, "; tokid.Ensemble(u, y, …) makes one of arrays")._ready()
    core.check()
    return core


def _stated(data: Any) -> _tokid.Ensemble:
    """The samples of data that state their initial states."""
    core = _samples(data)
    if core.initial_state is None:
        raise ValueError(
            "data: no initial states stated, 'zero' or 'unknown' needed, for example "
            "tokid.Ensemble(…, initial_state='zero')"
        )
    return core


def _regressions(arx: Any, core: _tokid.Ensemble) -> GtvArx:
    """Regressions that agree with the initial states of the data."""
    value: GtvArx = _is("arx", arx, GtvArx)
    if core.initial_state == "unknown" and value.k_begin == 0:
        raise ValueError(
            "k_begin: 0 found, the lag order needed, because the initial states of the data are unknown, and so are the "
            "samples before step 0"
        )
    return value


def _stage_model(core: _tokid.Model) -> Model:
    core.check()
    return Model._of(core)


# ---- Regressions ----


def windows(data: Ensemble, k: int, lags: int) -> Array:
    """The window of step k: regressors W[k] and outputs Y[k] side by side (18).

    Parameters
    ----------
    data : Ensemble
        Experiments.
    k : int
        Step, from 0 to T-1.
    lags : int
        Lag order p, from 1 to T-1.

    Returns
    -------
    V : ndarray, shape (N_k, (p+1) d)
        [v[k-p] … v[k-1] u[k] y[k]] of the experiments without a missing sample in this window, a row for each. The first
        L = p d + r columns are W[k], the last m are Y[k]. Samples before step 0 are zero.

    Examples
    --------
    >>> data = tokid.example("oscillator", experiments=40, steps=30)
    >>> V = windows(data, k=20, lags=2)
    >>> W, Y = V[:, :-2], V[:, -2:]
    >>> M = np.linalg.lstsq(W, Y, rcond=None)[0].T
    >>> bool(np.allclose(M, gtv_arx(data, 2).coefficients[20]))
    True
    """
    core = _samples(data)
    step = _options.integer("k", k, 0, core.steps - 1)
    return _tokid.stage_windows(core, step, _options.integer("lags", lags, 1, max(1, core.steps - 1)))


def channel_sizes(data: Ensemble) -> Array:
    """Return the RMS (d,) of each channel of the data, inputs first, over all samples. It is 1 for a channel of zeros.

    `hankel_factors` can use them as units, so that its singular values do not depend on the units of the channels.
    """
    return _tokid.stage_channel_sizes(_samples(data))


def content_order(data: Ensemble) -> IndexArray:
    """Return the rows (N,) of `data` in the order in which `tokid.identify` takes the experiments.

    It depends on the samples alone, so that another order of the experiments changes no bit of a model.
    """
    return np.array(_tokid.stage_content_order(_samples(data)), dtype=np.int64)


def gtv_arx(
    data: Ensemble,
    lags: Union[int, Sequence[int]],
    *,
    feedthrough: bool = True,
    tolerance: float = 1.5e-14,
    noise_shape: bool = True,
    spent: int = 0,
    threads: int = 1,
) -> GtvArx:
    """Regress each step alone (16)-(19): M[k]ᵀ = W[k]⁺ Y[k], by orthogonal factorisations.

    Parameters
    ----------
    data : Ensemble
        N experiments. A step needs r + p (r + m) of them, else it gets the solution with the smallest norm; see `rank`.
        Where the initial states are unknown, the regressions begin at step p.
    lags : int or sequence of T ints
        Lag order p, for all steps or for each.
    feedthrough : bool, default True
        False: D = 0 is known.
    tolerance : float, default 1.5e-14
        Pivots of the scaled W[k] below tolerance √L count as zero.
    noise_shape : bool, default True
        Store the noise shapes, L² numbers for each step. Without them, `markov` gives no variances.
    spent : int, default 0
        Degrees of freedom used before: 1 if a mean motion was removed.
    threads : int, default 1

    Returns
    -------
    GtvArx
    """
    core = _stated(data)
    orders = [lags] if np.ndim(lags) == 0 else list(lags)  # type: ignore[arg-type]
    return GtvArx(
        **_tokid.stage_gtv_arx(
            core,
            [_options.integer("lags", p, 1, max(1, core.steps - 1)) for p in orders],
            _options.switch("feedthrough", feedthrough),
            _options.real("tolerance", tolerance, 0.0),
            _options.switch("noise_shape", noise_shape),
            _options.integer("spent", spent, 0),
            _options.threads(threads),
        )
    )


def smooth_arx(
    data: Ensemble,
    lags: int,
    smoothing: float,
    *,
    period: Union[int, str] = 0,
    feedthrough: bool = True,
    threads: int = 1,
) -> GtvArx:
    """Regress all steps together, with a penalty on the variation of the coefficients over time.

    It minimises Σ ‖Y[k] - W[k] M[k]ᵀ‖² + λ N Σ ‖(M[k+1] - M[k]) diag(RMS of the regressors)‖².

    Parameters
    ----------
    data : Ensemble
        Experiments. A step without a complete experiment gets its coefficients from its neighbours.
    lags : int
        Lag order p, from 1 to T-1.
    smoothing : float
        λ. 0: each step uses its own data only. Infinity: all steps have the same coefficients.
    period : int or "invariant", default 0
        P: the steps k and k + P share one model. 0: no period.
    feedthrough : bool, default True
        False: D = 0 is known.
    threads : int, default 1

    Returns
    -------
    GtvArx
        Without noise shapes. `residual_cov` is EᵀE / rows.
    """
    core = _stated(data)
    return GtvArx(
        **_tokid.stage_smooth_arx(
            core,
            _options.integer("lags", lags, 1, max(1, core.steps - 1)),
            _options.real("smoothing", smoothing, 0.0, math.inf),
            _options.period(period),
            _options.switch("feedthrough", feedthrough),
            _options.threads(threads),
        )
    )


# ---- Realisations ----


def markov(arx: GtvArx, band: int, *, threads: int = 1) -> Markov:
    """Compute system and observer-gain Markov parameters from the regressions (20)-(35).

    Parameters
    ----------
    arx : GtvArx
        Without noise shapes, `Markov.system_noise` is None. `HankelFactors.error` then covers rounding errors alone, so
        that "auto" states of `realise` count noise as states: state their number.
    band : int
        The largest γ = k - i, from 1 on. `hankel_factors` needs rows + cols - 1.
    threads : int, default 1

    Returns
    -------
    Markov
    """
    _is("arx", arx, GtvArx)
    wanted = _options.integer("band", band, 1, _MOST)
    return Markov(**_tokid.stage_markov(arx, wanted, _options.threads(threads)))


def hankel_factors(
    markov: Markov,
    rows: int,
    cols: int,
    *,
    free_y: Optional[ArrayLike] = None,
    output_size: Optional[ArrayLike] = None,
    input_size: Optional[ArrayLike] = None,
    threads: int = 1,
) -> HankelFactors:
    """Factorise the Hankel matrix H[k] = [h[k+a, k-1-b]] of every step (TVERA).

    Parameters
    ----------
    markov : Markov
        With a band of at least rows + cols - 1.
    rows, cols : int
        Blocks of H[k]: (rows - 1) m ≥ n and cols r ≥ n. `tokid.identify` uses max(p, ⌈n/m⌉) + 1 rows, and max(p, n)
        columns, or max(p, 48) with noise.
    free_y : array_like, shape (Nf, Tf, m), optional
        Free responses, as in `Ensemble`. They are further columns of H[k]. The states are then known from step 0 on.
    output_size, input_size : array_like, shapes (m,), (r,), optional
        Units in which H[k] is formed; by default 1. `tokid.identify` uses `channel_sizes`.
    threads : int, default 1

    Returns
    -------
    HankelFactors
    """
    _is("markov", markov, Markov)
    m, r = markov.system.shape[2:]
    free = None if free_y is None else _arrays.shaped("free_y", free_y, (None, None, m), "Nf, Tf, m")
    if free is not None and np.any(np.isinf(free)):
        raise ValueError("free_y: an infinite sample found, numbers or NaN needed")
    output = None if output_size is None else _arrays.shaped("output_size", output_size, (m,))
    given = None if input_size is None else _arrays.shaped("input_size", input_size, (r,))
    return HankelFactors(
        **_tokid.stage_hankel_factors(
            markov,
            _options.integer("rows", rows, 1, _MOST),
            _options.integer("cols", cols, 1, _MOST),
            free,
            output,
            given,
            _options.threads(threads),
        )
    )


def realise(
    markov: Markov,
    factors: HankelFactors,
    *,
    states: Union[int, str] = "auto",
    noise_factor: float = 3.0,
    threads: int = 1,
) -> Model:
    """Realise A, B, C, D and G of every step from the factors of the Hankel matrices (36)-(40).

    A[k] = (O[k+1]↑)⁺ O[k]↓, B[k] = O[k+1]⁺ [h[k+1, k]; …], C[k] is the first block row of O[k], and
    G[k] = O[k+1]⁺ [h°[k+1, k]; …].

    Parameters
    ----------
    markov : Markov
    factors : HankelFactors
        `hankel_factors` makes it of these Markov parameters.
    states : int or "auto"
        Largest number of states n of a step. "auto": the numerical rank of each H[k], too large for noisy data.
    noise_factor : float, default 3.0
        Singular values below noise_factor times `HankelFactors.error` count as zero.
    threads : int, default 1

    Returns
    -------
    Model
        `completed` adds what its regressions know.
    """
    _is("markov", markov, Markov)
    _is("factors", factors, HankelFactors)
    core = _tokid.stage_realise(
        markov,
        factors,
        _options.count_or_auto("states", states),
        _options.real("noise_factor", noise_factor, 0.0),
        _options.threads(threads),
    )
    return _stage_model(core)


def completed(model: Model, data: Ensemble, arx: GtvArx) -> Model:
    """Complete a model of `realise` by what the regressions and the data know.

    These are covariances of the innovations, condition numbers, ranks and lags; sample time, names and initial states
    of the data. Where the initial states are unknown, the model begins at its first step of full dimension.

    Parameters
    ----------
    model : Model
        From `realise`.
    data : Ensemble
    arx : GtvArx
        The regressions of the same T steps.

    Returns
    -------
    Model
    """
    _is("model", model, Model)
    core = _stated(data)
    return _stage_model(_tokid.stage_completed(model._core, core, _regressions(arx, core)))


def subspace(
    data: Ensemble,
    arx: GtvArx,
    *,
    states: Union[int, str] = "auto",
    future: Union[int, str] = "auto",
    weighting: str = "one-step",
    smoothing: float = 0.0,
    period: Union[int, str] = 0,
    state_smoothing: Union[float, str] = "auto",
    output_weights: Optional[ArrayLike] = None,
    noisy: bool = True,
    threads: int = 1,
) -> Model:
    """Realise A, B, C, D and G of every step from noisy data, by the predictor subspace of an ARX model.

    The ARX coefficients predict f future outputs from the past samples z[k]. The weighted predictions
    Σ^-½ M[k] Z[k]ᵀ = U S Vᵀ give the states x[k] = S^-½ Uᵀ Σ^-½ M[k] z[k]. Two regressions on the states give the
    matrices: y[k] on (x[k], u[k]), and x[k+1] on (x[k], u[k], e[k]).

    Parameters
    ----------
    data : Ensemble
        Experiments.
    arx : GtvArx
        Noise shapes are not needed.
    states : int or "auto"
        Largest number of states n of a step. "auto": the numerical rank, too large for noisy data.
    future : int or "auto"
        f. "auto": p, but with "one-step" at most ⌈24/m⌉.
    weighting : {"one-step", "many-steps", "projection"}
        As in `tokid.identify`. "projection" needs a period.
    smoothing, period
        λ and P of the ARX model, as in `smooth_arx`.
    state_smoothing : float or "auto"
        λ of the regressions on the states. "auto": smoothing / 30.
    output_weights : array_like, shape (m,), optional
        Weights of the outputs from 0 on, over the largest: how much each one matters for the states that are kept.
    noisy : bool, default True
        False: the residuals are rounding errors.
    threads : int, default 1

    Returns
    -------
    Model
        Where the initial states are unknown, it begins at its first step of full dimension.
    """
    core = _stated(data)
    regressions = _regressions(arx, core)
    weights = output_weights
    if weights is not None:
        weights = _arrays.shaped("output_weights", weights, (core.outputs,))
        if not (np.all(weights >= 0) and np.max(weights) > 0 and np.all(np.isfinite(weights))):
            raise ValueError("output_weights: others found, numbers from 0 on and not all 0 needed")
        weights = np.asarray(weights, dtype=np.float64) / np.max(weights)
    automatic = isinstance(state_smoothing, str) and state_smoothing == "auto"
    return _stage_model(
        _tokid.stage_subspace(
            core,
            regressions,
            _options.count_or_auto("states", states),
            _options.count_or_auto("future", future),
            _options.choice("weighting", weighting, _WEIGHTINGS),
            _options.real("smoothing", smoothing, 0.0, math.inf),
            _options.period(period),
            -1.0 if automatic else _options.real("state_smoothing", state_smoothing, 0.0, math.inf, " or 'auto'"),
            weights,
            _options.switch("noisy", noisy),
            _options.threads(threads),
        )
    )


def with_nominal(model: Model, u: ArrayLike, y: ArrayLike) -> Model:
    """Return the model of departures with the nominal trajectory that was removed from the data before.

    Parameters
    ----------
    model : Model
        It describes the data of `Ensemble.departures`.
    u, y : array_like, shapes (T, r), (T, m)
        The mean motion, from `Ensemble.nominal`.

    Returns
    -------
    Model
        Its inputs and outputs are those of the measurements.
    """
    _is("model", model, Model)
    steps = np.shape(u)[0] if np.ndim(u) > 0 else None
    return _stage_model(
        _tokid.stage_with_nominal(
            model._core,
            _arrays.shaped("u", u, (None, model.inputs), "T, r"),
            _arrays.shaped("y", y, (steps, model.outputs), "T, m"),
        )
    )


def refine(
    model: Model,
    data: Ensemble,
    *,
    smoothing: float = 0.0,
    period: Union[int, str, None] = None,
    iterations: int = 60,
    tolerance: float = 1e-6,
    feedthrough: bool = True,
    jumps: Sequence[int] = (),
    estimate_matrices: bool = True,
    accelerate: bool = True,
    warm_up: bool = True,
    threads: int = 1,
) -> Refined:
    """Refine a model by expectation-maximisation (EM). This is the stage alone: `Model.refine` also chooses λ.

    Parameters
    ----------
    model : Model
        Any model of these channels.
    data : Ensemble
        Experiments. Unless they state their initial states, these are as the model was identified.
    smoothing : float, default 0.0
        λ of the penalty on variation over time. 0: every step has its own matrices. Infinity: all have the same ones.
    period : int or "invariant", optional
        P: the steps k and k + P share their matrices. By default, the period of the model.
    iterations : int, default 60
        Largest number of iterations.
    tolerance : float, default 1e-6
        EM has converged if an iteration without momentum gains less log-likelihood per output sample.
    feedthrough : bool, default True
        False: D = 0 is known.
    jumps : sequence of int
        Ascending steps at which the matrices may jump. No penalty couples such a step with the step before.
    estimate_matrices : bool, default True
        False: A, B, C and D are known. EM then estimates Q, R and the distribution of x[0] alone.
    accelerate : bool, default True
        Use Nesterov's momentum where it raises the likelihood.
    warm_up : bool, default True
        Reach a strong penalty through weaker ones.
    threads : int, default 1

    Returns
    -------
    Refined
    """
    _is("model", model, Model)
    core, fields = _tokid.stage_refine(
        model._core,
        _samples(data),
        _options.real("smoothing", smoothing, 0.0, math.inf),
        None if period is None else _options.period(period),
        _options.integer("iterations", iterations, 1, 1_000_000),
        _options.real("tolerance", tolerance, 0.0),
        _options.switch("feedthrough", feedthrough),
        [_options.integer("jumps", k, 0) for k in jumps],
        _options.switch("estimate_matrices", estimate_matrices),
        _options.switch("accelerate", accelerate),
        _options.switch("warm_up", warm_up),
        _options.threads(threads),
    )
    warn(finding.text for finding in fields["findings"])
    return Refined(Model._of(core, Origin(fields["findings"])), **fields)
