# SPDX-License-Identifier: BSD-3-Clause
"""Identification as a scikit-learn estimator. Its samples are whole experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

    A sample of scikit-learn is an experiment: X has the inputs (N, T, r) and y the outputs (N, T, m). The folds of
    `GridSearchCV` and `cross_val_score` are held-out experiments. NaN marks a missing sample in X and y.

    Parameters
    ----------
    dt : float, default 1.0
        Sample time [s].
    states, lags, method, smoothing, feedthrough, period, jumps, delays, weighting, output_weights, refine
        As in `tokid.identify`.
    initial_state, nominal, frame, reference_step, outliers, rows, cols, threads
        As in `tokid.identify`.
    horizon : int or None, default None
        None: `predict` and `score` use simulations from the inputs alone. A number: they use predictions this number of
        steps ahead, and `predict` needs the measured outputs as its second argument.

    Attributes
    ----------
    model_ : Model
        The model. ``model_.identification`` has the evidence for every choice.
    n_features_in_ : int
        Number of inputs r.
    n_outputs_ : int
        Number of outputs m.
    n_steps_ : int
        Number of steps T of the training data.

    Notes
    -----
    `score` is R². `Model.validate` and the report page give fits in percent instead: 100 (1 - sqrt(1 - R²)) for the
    same means.

    The named scorers of scikit-learn, such as ``scoring="r2"``, accept only tables (n_samples, n_outputs) without NaN.
    Their result for experiments is NaN. `tokid.sklearn.scorers` has scorers for experiments with the same names, and
    `make_scorer` makes a scorer from any other metric.

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
        feedthrough: Union[bool, str, None] = None,
        period: Union[int, str] = 0,
        jumps: Union[int, str, Sequence[int]] = "auto",
        delays: Union[int, str, Sequence[int]] = "auto",
        weighting: str = "auto",
        output_weights: Union[str, Sequence[float]] = "equal",
        refine: Optional[bool] = None,
        initial_state: str = "auto",
        nominal: str = "auto",
        frame: str = "raw",
        reference_step: Optional[int] = None,
        outliers: str = "keep",
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
        self.feedthrough = feedthrough
        self.period = period
        self.jumps = jumps
        self.delays = delays
        self.weighting = weighting
        self.output_weights = output_weights
        self.refine = refine
        self.initial_state = initial_state
        self.nominal = nominal
        self.frame = frame
        self.reference_step = reference_step
        self.outliers = outliers
        self.rows = rows
        self.cols = cols
        self.horizon = horizon
        self.threads = threads

    def fit(self, X: ArrayLike, y: ArrayLike) -> LTVIdentifier:
        """Identify the model.

        Parameters
        ----------
        X : array_like, shape (N, T, r)
            Inputs.
        y : array_like, shape (N, T, m)
            Outputs.

        Returns
        -------
        LTVIdentifier
            The estimator itself.
        """
        if y is None:
            # The words of scikit-learn, which its checks expect.
            raise ValueError(
                f"{type(self).__name__} requires y to be passed, but the target y is None: outputs (N, T, m) needed"
            )
        inputs = _experiments("X", X, "r")
        outputs = _experiments("y", y, "m", inputs)
        options = {name: value for name, value in self.get_params(deep=False).items() if name != "horizon"}
        self.model_ = identify(inputs, outputs, **options)
        self.n_features_in_ = inputs.shape[2]
        self.n_outputs_ = outputs.shape[2]
        self.n_steps_ = inputs.shape[1]
        return self

    def predict(self, X: ArrayLike, y: Optional[ArrayLike] = None) -> Array:
        """Simulate the outputs, or predict them `horizon` steps ahead.

        Parameters
        ----------
        X : array_like, shape (N, T, r)
            Inputs from step 0 on.
        y : array_like, shape (N, T, m), optional
            Measured outputs. Predictions with a `horizon` need them; simulations ignore them.

        Returns
        -------
        ndarray, shape (N, T, m)
            Outputs. NaN where the model has no step, after a missing input, and before the first prediction.

        Raises
        ------
        sklearn.exceptions.NotFittedError
            If `fit` was not called before.
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
        """Return R² of the outputs of `predict`, as the mean over the outputs.

        For each output, R² is 1 - Σ (y - ŷ)² / Σ (y - ȳ)². The sums are over all experiments and steps with a measured
        and a computed sample, and ȳ is the mean of these measured samples. 1 means no error, 0 no better than a
        constant; there is no lower bound. It is `sklearn.metrics.r2_score` of the samples as a table (N T, m).

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
            NaN if nothing can be compared.
        """
        check_is_fitted(self, "model_")
        inputs = self._inputs(X)
        outputs = self._outputs(y, inputs)
        weights = np.ones(len(inputs))
        if sample_weight is not None:
            weights = _arrays.shaped("sample_weight", sample_weight, (len(inputs),))
        return _of_each_output(_r2, outputs, self.predict(inputs, outputs), weights)

    def _inputs(self, X: Any) -> Array:
        inputs = _experiments("X", X, "r")
        if inputs.shape[2] != self.n_features_in_:
            # The words of scikit-learn, which its checks expect.
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
    """Return an array (N, T, channels) with the numbers of experiments and steps of the inputs."""
    array = _arrays.numbers(name, values)
    size = "N, T" if inputs is None else f"{inputs.shape[0]}, {inputs.shape[1]}"
    if array.ndim != 3 or (inputs is not None and array.shape[:2] != inputs.shape[:2]):
        raise ValueError(f"{name}: shape {array.shape} found, ({size}, {channels}) needed: one entry per experiment")
    return array


def _of_each_output(
    metric: Callable[..., float], measured: Array, computed: Array, weights: Optional[Array]
) -> float:
    """Return the mean of a metric over the outputs, from the samples that are both measured and computed."""
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
    """A scorer that can be pickled if its metric can."""

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
        # Predictions some steps ahead need the measured outputs.
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
    """Make a scorer of experiments, for the argument ``scoring`` of `GridSearchCV`, `cross_val_score` and others.

    Parameters
    ----------
    metric : callable
        ``metric(y_true, y_pred, **options)`` of two arrays (samples,), such as those of `sklearn.metrics`. It is called
        for each output, with the samples of all experiments and steps that are both measured and computed.
    greater_is_better : bool, default True
        False for an error. The scorer then changes the sign.
    **options
        Options of the metric.

    Returns
    -------
    callable
        ``scorer(estimator, X, y, sample_weight=None)`` returns the mean over the outputs, NaN if an output has nothing
        to compare. `sample_weight` (N,) contains weights of experiments, for metrics that accept weights. For an
        `LTVIdentifier` with a `horizon` it scores predictions, else simulations.

    Examples
    --------
    >>> from sklearn.metrics import max_error
    >>> from sklearn.model_selection import cross_val_score
    >>> data = tokid.example("oscillator", experiments=60, steps=40, measurement_noise=0.01)
    >>> estimator = LTVIdentifier(states=4, lags=2, smoothing=0.0, refine=False)
    >>> scorer = make_scorer(max_error, greater_is_better=False)
    >>> worst = cross_val_score(estimator, data.u, data.y, cv=3, scoring=scorer)
    >>> bool((worst < 0).all())
    True
    """
    return _Scorer(metric, 1 if greater_is_better else -1, options)


def _root_mean_squared_error(y_true: Array, y_pred: Array, **options: Any) -> float:
    return float(np.sqrt(metrics.mean_squared_error(y_true, y_pred, **options)))


#: Scorers of experiments, by the names of the scorers of scikit-learn for tables: ``scoring=scorers["r2"]``.
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


def _r2(y: Array, y_hat: Array, sample_weight: Array) -> float:
    if not sample_weight.sum() > 0:
        return float("nan")
    error = float(np.sum(sample_weight * (y - y_hat) ** 2))
    spread = float(np.sum(sample_weight * (y - np.average(y, weights=sample_weight)) ** 2))
    # For constant outputs, the results are those of scikit-learn.
    return 1 - error / spread if spread > 0 else 1.0 if error == 0 else 0.0
