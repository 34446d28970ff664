# SPDX-License-Identifier: BSD-3-Clause
"""What calls find out, in dataclasses: a field for each one of the C++ library's."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Optional

import numpy as np

from ._typing import Array


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= 6:
            return "[" + ", ".join(_short(float(x)) for x in value) + "]"
        return f"array{value.shape}"
    if isinstance(value, (list, tuple)) and len(value) > 6:
        return f"{type(value).__name__} of {len(value)}"
    return repr(value)


class _Result:
    """Arrays by their shapes, numbers by four digits."""

    def __repr__(self) -> str:
        shown = ", ".join(f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({shown})"


@dataclass(frozen=True, eq=False, repr=False)
class Fit(_Result):
    """How near computed outputs are to measured ones, over all experiments and steps where both are known.

    Attributes
    ----------
    fit : ndarray, shape (m,)
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%], ȳ the nominal trajectory where the model has one, else the mean. NaN where
        nothing could be compared.
    rmse : ndarray, shape (m,)
        Root mean square errors in the units of the outputs.
    samples : int
        Samples compared, the fewest of any output.
    """

    fit: Array
    rmse: Array
    samples: int


@dataclass(frozen=True, eq=False, repr=False)
class Whiteness(_Result):
    """Are the innovations of successive steps correlated?

    Attributes
    ----------
    p : float
        Probability of innovations as correlated as these if they were white; NaN where not tested.
    z : ndarray, shape (lags,)
        Standardised sum of each lag.
    correlation : ndarray, shape (lags, m)
        Of every output with itself so many steps before.
    bound : ndarray, shape (lags,)
        99 % of the entries of `correlation` are smaller in size if the innovations are white.
    over : {"experiments", "time", "nothing"}
        What the correlations were taken over.
    """

    p: float
    z: Array
    correlation: Array
    bound: Array
    over: str


@dataclass(frozen=True, eq=False, repr=False)
class Independence(_Result):
    """Are the innovations correlated with the inputs?

    Attributes
    ----------
    p : float
        Probability of correlations as large as these if there were none; NaN where not tested.
    first : int
        Lag of the first entry of `z` and `correlation`; negative lags are those of later inputs.
    z : ndarray, shape (lags,)
        Standardised sum of each lag.
    correlation : ndarray, shape (lags,)
        Root mean square of the canonical correlations beyond what chance gives.
    over : {"experiments", "time", "nothing"}
        What the correlations were taken over.
    """

    p: float
    first: int
    z: Array
    correlation: Array
    over: str


@dataclass(frozen=True, eq=False, repr=False)
class NormalisedSquares(_Result):
    """Are the innovations as large as the model says?

    Attributes
    ----------
    ratio : float
        Mean of εᵀ S⁻¹ ε over m: 1 if the covariance S is right, more if the model is overconfident; NaN without one.
    p : float
        Probability of a ratio as far from 1 if S were right.
    normal : bool
        Whether `p` presumes normal innovations, as it does of fewer than 20 experiments.
    step, step_p : ndarray, shape (T,)
        Both of each step; NaN where there is none.
    """

    ratio: float
    p: float
    normal: bool
    step: Array
    step_p: Array


@dataclass(frozen=True, eq=False, repr=False)
class Validation(_Result):
    """How good a model is on data.

    Attributes
    ----------
    simulation, one_step, horizon : Fit
        Of simulations, and of predictions one step and `horizon` steps ahead.
    noisy : bool
        Innovations beyond rounding errors.
    whiteness_p : float
        That of `whiteness`.
    whiteness : Whiteness
    independence : Independence
        Of past and present inputs.
    feedback : Independence
        Of later inputs: a small p is no fault of the model.
    squares : NormalisedSquares
    first_predicted, first_simulated : int
        First steps with a prediction and with a simulation.
    warnings : list of str
    """

    simulation: Fit
    one_step: Fit
    horizon: Fit
    noisy: bool
    whiteness_p: float
    whiteness: Whiteness
    independence: Independence
    feedback: Independence
    squares: NormalisedSquares
    first_predicted: int
    first_simulated: int
    warnings: list[str]


@dataclass(frozen=True, eq=False, repr=False)
class TimeVariation(_Result):
    """How a model may vary with time.

    Attributes
    ----------
    smoothing : float
        λ of the penalty on variation: 0 leaves each step to its own data, infinity makes all steps one.
    period : int
        P: the steps k and k + P share one model; 1: all steps; 0: no period.
    """

    smoothing: float
    period: int


@dataclass(frozen=True, eq=False, repr=False)
class NoisyChoices(_Result):
    """What an identification from noisy data has chosen beside lag order and states.

    Attributes
    ----------
    variation : TimeVariation
    state_smoothing : float
        λ of the regressions on states.
    weighting : {"one-step", "many-steps", "projection"}
    refinement_smoothing : float
        λ of EM.
    refinement_iterations : int
        0: no refinement.
    """

    variation: TimeVariation
    state_smoothing: float
    weighting: str
    refinement_smoothing: float
    refinement_iterations: int


@dataclass(frozen=True, eq=False, repr=False)
class NominalTest(_Result):
    """Is the mean motion significantly different from zero?

    Attributes
    ----------
    statistic : float
        Mean of t² over channels and steps.
    threshold : float
        What one run in a thousand exceeds when the true mean is zero.
    significant : bool
    """

    statistic: float
    threshold: float
    significant: bool


@dataclass(frozen=True, eq=False, repr=False)
class InitialStateTest(_Result):
    """Do the residuals of the first steps show unknown initial states?

    Attributes
    ----------
    statistic : float
        Largest ratio of an early to the later residual variance.
    threshold : float
    decision : {"zero", "unknown"}
    reason : str
    """

    statistic: float
    threshold: float
    decision: str
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class LagOrderErrors(_Result):
    """Leave-one-out errors by which the lag order was chosen step by step; empty where it was not.

    Attributes
    ----------
    steps : list of int
        The steps examined.
    error : ndarray, shape (steps, p_max)
        Mean over outputs of log(leave-one-out mean square / mean square of y).
    mean : ndarray, shape (p_max,)
    best : int
        The smallest p within a standard error of the smallest mean.
    """

    steps: list[int]
    error: Array
    mean: Array
    best: int


@dataclass(frozen=True, eq=False, repr=False)
class SmoothingTrial(_Result):
    """One lag order with one λ.

    Attributes
    ----------
    lags : int
    smoothing : float
    error : float
        Relative RMS one-step error on experiments left out.
    """

    lags: int
    smoothing: float
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class SmoothingChoice(_Result):
    """Lag order and λ by cross-validation; without trials where they were not chosen together.

    Attributes
    ----------
    trials : list of SmoothingTrial
        In the order in which they were made.
    lags : int
    smoothing : float
    error : float
    """

    trials: list[SmoothingTrial]
    lags: int
    smoothing: float
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class OrderScores(_Result):
    """What each number of states made of the data; empty where it was not chosen from noisy data.

    Attributes
    ----------
    states : list of int
        The candidates.
    one_step, ahead, simulation : ndarray, shape (candidates,)
        RMS errors over that of the departures, mean logs over outputs; `ahead` is `horizon` steps ahead.
    horizon : int
    cross_validated : bool
        On experiments left out, else on the training data.
    smoothing : float
        λ of the regressions on states.
    weighting : {"one-step", "many-steps", "projection"}
    price : float
        Of a state.
    smallest : float
        The smallest mean.
    uncertainty : ndarray, shape (candidates,)
        Of the difference from the order of the smallest mean; empty on training data.
    best : int
    """

    states: list[int]
    one_step: Array
    ahead: Array
    simulation: Array
    horizon: int
    cross_validated: bool
    smoothing: float
    weighting: str
    price: float
    smallest: float
    uncertainty: Array
    best: int


@dataclass(frozen=True, eq=False, repr=False)
class RefinementTrial(_Result):
    """EM with one number of states and one λ.

    Attributes
    ----------
    states : int
    smoothing : float
    iterations : int
        0: the model as it was before EM.
    error : float
        Mean log error on experiments left out.
    """

    states: int
    smoothing: float
    iterations: int
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class RefinementChoice(_Result):
    """How far EM brought the models of experiments forward on others; without trials where that was not tried.

    Attributes
    ----------
    trials : list of RefinementTrial
    states : int
    smoothing : float
    iterations : int
        0: no refinement.
    error : float
    one_step : float
        Log of the one-step error alone, where there are iterations.
    """

    trials: list[RefinementTrial]
    states: int
    smoothing: float
    iterations: int
    error: float
    one_step: float


@dataclass(frozen=True, eq=False, repr=False)
class Identification(_Result):
    """The evidence for every choice of an identification.

    Attributes
    ----------
    experiments, steps : int
        Used for the identification.
    lags : int
        Lag order p.
    variation : TimeVariation
    state_smoothing : float
        λ of the regressions on states.
    min_experiments : int
        Experiments that this lag order needs.
    rank_deficient_steps : int
    condition_max : float
        0 where all steps were in one regression.
    nominal_test : NominalTest
    initial_state_test : InitialStateTest
    lag_order_errors : LagOrderErrors
    smoothing_choice : SmoothingChoice
    order_scores : OrderScores
    refinement : RefinementChoice
    choices : NoisyChoices or None
        Where all steps were regressed together.
    together : bool
        All steps in one regression, else one for each.
    noisy : bool
        Residuals beyond rounding errors.
    nominal : bool
        A mean motion was removed.
    singular_value_gap : float
        How clearly the order shows in the singular values; NaN where it does not.
    held_out : bool
        `validation` is on experiments held out, else on the training data.
    validation : Validation
    warnings : list of str
    seconds : float
    """

    experiments: int
    steps: int
    lags: int
    variation: TimeVariation
    state_smoothing: float
    min_experiments: int
    rank_deficient_steps: int
    condition_max: float
    nominal_test: NominalTest
    initial_state_test: InitialStateTest
    lag_order_errors: LagOrderErrors
    smoothing_choice: SmoothingChoice
    order_scores: OrderScores
    refinement: RefinementChoice
    choices: Optional[NoisyChoices]
    together: bool
    noisy: bool
    nominal: bool
    singular_value_gap: float
    held_out: bool
    validation: Validation
    warnings: list[str]
    seconds: float
