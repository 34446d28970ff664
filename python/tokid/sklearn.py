# SPDX-License-Identifier: BSD-3-Clause
"""Identification as a scikit-learn estimator, whose samples are whole experiments."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Callable, Optional, Union

import numpy as np

from . import _arrays
from ._identify import identify
from ._model import Model
from ._optional import need
from ._typing import Array, ArrayLike

need("sklearn", "tokid.sklearn", "tokid[sklearn]")

import sklearn.metrics as metrics  # type: ignore[import-untyped, import-not-found, unused-ignore]
from sklearn.base import BaseEstimator, RegressorMixin  # type: ignore[import-untyped, import-not-found, unused-ignore]
from sklearn.utils.validation import check_is_fitted  # type: ignore[import-untyped, import-not-found, unused-ignore]

__all__ = ["LTVIdentifier", "make_scorer", "scorers"]


class LTVIdentifier(RegressorMixin, BaseEstimator):  # type: ignore[misc, unused-ignore]
    """A linear time-varying model of every step, identified from repeated experiments by `tokid.identify`.

    A sample of scikit-learn is an experiment: X holds inputs (N, T, r), y outputs (N, T, m), and the folds of
    `GridSearchCV` and `cross_val_score` are experiments left out. NaN marks a missing sample in both.

    Parameters
    ----------
    dt : float, default 1.0
        Sample time [s].
    states, lags, method, smoothing, period, weighting, refine, initial_state, nominal
        As of `tokid.identify`.
    frame, reference_step, rows, cols, threads
        As of `tokid.identify`.
    horizon : int or None, default None
        What `predict` and `score` compute. None: simulations from the inputs alone. A number: predictions so many
        steps ahead, for which `predict` takes the measured outputs as its second argument.

    Attributes
    ----------
    model_ : Model
        The model, with the evidence for every choice at ``model_.identification``.
    n_features_in_ : int
        Number of inputs r.
    n_outputs_ : int
        Number of outputs m.
    n_steps_ : int
        Number of steps T of the experiments that it was fitted to.

    Notes
    -----
    `score` is R², see there. `tokid.validate` and the report page tell fits in percent instead, 100 (1 - sqrt(1 - R²))
    for the same means.

    The scorers that scikit-learn has names for, as ``scoring="r2"``, take tables (n_samples, n_outputs) without NaN
    alone, and make NaN of experiments. `tokid.sklearn.scorers` has them for experiments under the same names, and
    `make_scorer` makes one of any other metric.

    Examples
    --------
    >>> from sklearn.model_selection import GridSearchCV
    >>> data = tokid.example("oscillator", experiments=60, steps=40, measurement_noise=0.01)
    >>> search = GridSearchCV(LTVIdentifier(lags=2, smoothing=0.0, refine=False), {"states": [2, 4]}, cv=3)
    >>> search.fit(data.u, data.y).best_params_
    {'states': 4}
    """

    model_: Model
    n_features_in_: int
    n_outputs_: int
    n_steps_: int

    def __init__(
        self,
        *,
        dt: float = 1.0,
        states: Union[int, str] = "auto",
        lags: Union[int, str] = "auto",
        method: str = "auto",
        smoothing: Union[float, str] = "auto",
        period: Union[int, str] = 0,
        weighting: str = "auto",
        refine: Optional[bool] = None,
        initial_state: str = "auto",
        nominal: str = "auto",
        frame: str = "raw",
        reference_step: Optional[int] = None,
        rows: Union[int, str] = "auto",
        cols: Union[int, str] = "auto",
        horizon: Optional[int] = None,
        threads: int = 1,
    ) -> None:
        self.dt = dt
        self.states = states
        self.lags = lags
        self.method = method
        self.smoothing = smoothing
        self.period = period
        self.weighting = weighting
        self.refine = refine
        self.initial_state = initial_state
        self.nominal = nominal
        self.frame = frame
        self.reference_step = reference_step
        self.rows = rows
        self.cols = cols
        self.horizon = horizon
        self.threads = threads

    def fit(self, X: ArrayLike, y: ArrayLike) -> LTVIdentifier:
        """Identifies the model.

        Parameters
        ----------
        X : array_like, shape (N, T, r)
            Inputs.
        y : array_like, shape (N, T, m)
            Outputs.

        Returns
        -------
        LTVIdentifier
            Itself.
        """
        if y is None:
            # In the words that scikit-learn has for it.
            raise ValueError(
                f"{type(self).__name__} requires y to be passed, but the target y is None: outputs (N, T, m) needed"
            )
        inputs = _experiments("X", X, "r")
        outputs = _experiments("y", y, "m", inputs)
        self.model_ = identify(
            inputs,
            outputs,
            dt=self.dt,
            states=self.states,
            lags=self.lags,
            method=self.method,
            smoothing=self.smoothing,
            period=self.period,
            weighting=self.weighting,
            refine=self.refine,
            initial_state=self.initial_state,
            nominal=self.nominal,
            frame=self.frame,
            reference_step=self.reference_step,
            rows=self.rows,
            cols=self.cols,
            threads=self.threads,
        )
        self.n_features_in_ = inputs.shape[2]
        self.n_outputs_ = outputs.shape[2]
        self.n_steps_ = inputs.shape[1]
        return self

    def predict(self, X: ArrayLike, y: Optional[ArrayLike] = None) -> Array:
        """Outputs for inputs: simulated, or predicted `horizon` steps ahead.

        Parameters
        ----------
        X : array_like, shape (N, T, r)
            Inputs from step 0 on.
        y : array_like, shape (N, T, m), optional
            Measured outputs, which predictions with a `horizon` need; simulations leave them alone.

        Returns
        -------
        ndarray, shape (N, T, m)
            NaN where the model has no step, behind a missing input, and before the first prediction.

        Raises
        ------
        sklearn.exceptions.NotFittedError
            Before `fit`.
        """
        check_is_fitted(self, "model_")
        inputs = self._inputs(X)
        if self.horizon is None:
            return self.model_.simulate(inputs)
        if y is None:
            raise ValueError(
                f"y: none found, the measured outputs (N, T, {self.n_outputs_}) needed for predictions with horizon "
                f"{self.horizon}; horizon=None simulates from the inputs alone"
            )
        return self.model_.predict(inputs, self._outputs(y, inputs), horizon=self.horizon)

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: Optional[ArrayLike] = None) -> float:
        """R² of what `predict` computes.

        For each output 1 - Σ (y - ŷ)² / Σ (y - ȳ)², where the sums go over all experiments and steps that are both
        measured and computed, and ȳ is the mean of the measured ones among them; of that the mean over the outputs.
        1 is no error, 0 no better than a constant, and there is no lower bound. It is `sklearn.metrics.r2_score` of the
        samples as a table (N T, m).

        Parameters
        ----------
        X : array_like, shape (N, T, r)
            Inputs.
        y : array_like, shape (N, T, m)
            Measured outputs.
        sample_weight : array_like, shape (N,), optional
            Weights of the experiments.

        Returns
        -------
        float
            NaN where nothing can be compared.
        """
        check_is_fitted(self, "model_")
        inputs = self._inputs(X)
        outputs = self._outputs(y, inputs)
        weights = np.ones(len(inputs))
        if sample_weight is not None:
            weights = _arrays.shaped("sample_weight", sample_weight, (len(inputs),))
        return _r2(outputs, self.predict(inputs, outputs), weights)

    def _inputs(self, X: Any) -> Array:
        inputs = _experiments("X", X, "r")
        if inputs.shape[2] != self.n_features_in_:
            # In the words that scikit-learn has for it.
            raise ValueError(
                f"X has {inputs.shape[2]} features, but {type(self).__name__} is expecting {self.n_features_in_} "
                "features as input."
            )
        return inputs

    def _outputs(self, y: Any, inputs: Array) -> Array:
        outputs = _experiments("y", y, "m", inputs)
        if outputs.shape[2] != self.n_outputs_:
            raise ValueError(f"y: {outputs.shape[2]} outputs found, {self.n_outputs_} needed")
        return outputs

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.input_tags.three_d_array = True
        tags.input_tags.allow_nan = True
        tags.target_tags.two_d_labels = False
        tags.target_tags.single_output = False
        tags.target_tags.multi_output = True
        return tags


def _experiments(name: str, values: Any, channels: str, inputs: Optional[Array] = None) -> Array:
    """An array (N, T, channels), with as many experiments and steps as the inputs have."""
    array = _arrays.numbers(name, values)
    size = "N, T" if inputs is None else f"{inputs.shape[0]}, {inputs.shape[1]}"
    if array.ndim != 3 or (inputs is not None and array.shape[:2] != inputs.shape[:2]):
        raise ValueError(f"{name}: shape {array.shape} found, ({size}, {channels}) needed: one entry per experiment")
    return array


def _of_each_output(
    metric: Callable[..., float], measured: Array, computed: Array, weights: Optional[Array]
) -> float:
    """The mean over the outputs of a metric of the samples that are both measured and computed."""
    scores = []
    for j in range(measured.shape[2]):
        y, y_hat = measured[:, :, j], computed[:, :, j]
        both = ~(np.isnan(y) | np.isnan(y_hat))
        options = {}
        if weights is not None:
            options["sample_weight"] = np.broadcast_to(weights[:, np.newaxis], y.shape)[both]
        if not both.any():
            return float("nan")
        scores.append(float(metric(y[both], y_hat[both], **options)))
    return float(np.mean(scores))


class _Scorer:
    """A scorer that goes to other processes if its metric does."""

    def __init__(self, metric: Callable[..., float], sign: int, options: dict[str, Any]) -> None:
        self._metric = metric
        self._sign = sign
        self._options = options

    def __call__(self, estimator: Any, X: ArrayLike, y: ArrayLike, sample_weight: Optional[ArrayLike] = None) -> float:
        inputs = _experiments("X", X, "r")
        outputs = _experiments("y", y, "m", inputs)
        weights = None
        if sample_weight is not None:
            weights = _arrays.shaped("sample_weight", sample_weight, (len(inputs),))
        best = getattr(estimator, "best_estimator_", estimator)
        last = best[-1] if hasattr(best, "steps") else best
        # Predictions ahead need what has been measured.
        computed = best.predict(X, y=outputs) if isinstance(last, LTVIdentifier) else best.predict(X)

        def metric(y: Array, y_hat: Array, **options: Any) -> float:
            return self._metric(y, y_hat, **options, **self._options)

        return self._sign * _of_each_output(metric, outputs, np.asarray(computed, dtype=np.float64), weights)

    def __repr__(self) -> str:
        name = getattr(self._metric, "__name__", self._metric)
        return f"<tokid.sklearn scorer: {'-' if self._sign < 0 else ''}{name}>"


def make_scorer(
    metric: Callable[..., float], *, greater_is_better: bool = True, **options: Any
) -> Callable[..., float]:
    """A scorer of experiments, for ``scoring=`` of `GridSearchCV`, `cross_val_score` and their like.

    Parameters
    ----------
    metric : callable
        ``metric(y_true, y_pred, **options)`` of two arrays (samples,), as those of `sklearn.metrics`. It gets the
        samples of all experiments and steps that are both measured and computed, of one output after another.
    greater_is_better : bool, default True
        False for an error, whose sign is turned.
    **options
        For the metric.

    Returns
    -------
    callable
        ``scorer(estimator, X, y, sample_weight=None)``, the mean over the outputs; NaN where an output has nothing to
        compare. `sample_weight` (N,) holds weights of experiments, for metrics that take them. Of an `LTVIdentifier`
        with a `horizon` it judges predictions, else simulations.

    Examples
    --------
    >>> from sklearn.metrics import max_error
    >>> from sklearn.model_selection import cross_val_score
    >>> data = tokid.example("oscillator", experiments=60, steps=40, measurement_noise=0.01)
    >>> estimator = LTVIdentifier(states=4, lags=2, smoothing=0.0, refine=False)
    >>> worst = cross_val_score(estimator, data.u, data.y, cv=3, scoring=make_scorer(max_error, greater_is_better=False))
    >>> bool((worst < 0).all())
    True
    """
    return _Scorer(metric, 1 if greater_is_better else -1, options)


def _root_mean_squared_error(y_true: Array, y_pred: Array, **options: Any) -> float:
    return float(np.sqrt(metrics.mean_squared_error(y_true, y_pred, **options)))


#: Scorers of experiments by the names that scikit-learn has for those of tables: ``scoring=scorers["r2"]``.
scorers: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "r2": make_scorer(metrics.r2_score),
        "explained_variance": make_scorer(metrics.explained_variance_score),
        "neg_mean_squared_error": make_scorer(metrics.mean_squared_error, greater_is_better=False),
        "neg_root_mean_squared_error": make_scorer(_root_mean_squared_error, greater_is_better=False),
        "neg_mean_absolute_error": make_scorer(metrics.mean_absolute_error, greater_is_better=False),
        "neg_median_absolute_error": make_scorer(metrics.median_absolute_error, greater_is_better=False),
    }
)


def _r2(measured: Array, computed: Array, weights: Array) -> float:
    scores = []
    for j in range(measured.shape[2]):
        y, y_hat = measured[:, :, j], computed[:, :, j]
        both = ~(np.isnan(y) | np.isnan(y_hat))
        weight = np.broadcast_to(weights[:, np.newaxis], y.shape)[both]
        if not weight.sum() > 0:
            return float("nan")
        y, y_hat = y[both], y_hat[both]
        error = float(np.sum(weight * (y - y_hat) ** 2))
        spread = float(np.sum(weight * (y - np.average(y, weights=weight)) ** 2))
        # As scikit-learn has it for outputs that do not move.
        scores.append(1 - error / spread if spread > 0 else 1.0 if error == 0 else 0.0)
    return float(np.mean(scores))
