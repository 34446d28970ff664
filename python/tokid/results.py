# SPDX-License-Identifier: BSD-3-Clause
"""What calls find out, in dataclasses: a field for each one of the C++ library's."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ._ensemble import Ensemble
from ._typing import Array, ComplexArray, PathLike


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
        shown = ", ".join(
            f"{f.name}={_short(getattr(self, f.name))}"
            for f in fields(self)  # type: ignore[arg-type]
            if f.repr
        )
        return f"{type(self).__name__}({shown})"


@dataclass(frozen=True)
class FindingChannel:
    """A channel that a finding is about."""

    side: str
    index: int
    name: str


@dataclass(frozen=True)
class FindingExperiment:
    """An experiment that a finding is about; its name is None where the data give none."""

    row: int
    name: Optional[str]


@dataclass(frozen=True)
class FindingTerm:
    """A sample of a channel `lag` steps before k, and its factor in a sum."""

    channel: FindingChannel
    lag: int
    factor: float


@dataclass(frozen=True, repr=False)
class Finding(_Result):
    """What was found in data, in a model, or on the way to it, that its user should know.

    Attributes
    ----------
    kind : str
        What it is, such as "samples_outlying"; the names stay. The guide to files and the command line lists them.
    severity : str
        "note" for what was done in place of what was not stated, else "warning".
    scope : str
        "all" data, "deciding_stretches" of blocks, "new_experiments" of an update, "cross_validation" or its "folds".
    channels : list of FindingChannel
        Each with its side ("input" or "output"), its number there and its name.
    experiments : list of FindingExperiment
        Each with its row and its name.
    steps : list of int
    numbers : dict of str to float
        By how much, with the names of the kind.
    text : str
        All of it in words.
    terms : list of FindingTerm
        Of sums of samples.
    groups : list of list of FindingExperiment
        Of copies, sums and multiples: for each experiment, those that it is made of.
    names : list of str
        Of the model, where those of the data differ.
    detail : str
        Words of others: of the reader of a file, of an error.
    file : str
        Of several files, the one that it is about.
    """

    kind: str
    severity: str
    scope: str
    channels: list[FindingChannel]
    experiments: list[FindingExperiment]
    steps: list[int]
    numbers: dict[str, float]
    text: str
    terms: list[FindingTerm] = field(default_factory=list)
    groups: list[list[FindingExperiment]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    detail: str = ""
    file: str = ""


class _Found(_Result):
    """A result with findings."""

    findings: list[Finding]

    @property
    def warnings(self) -> list[str]:
        """The findings in words."""
        return [finding.text for finding in self.findings]


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
class InputGains(_Result):
    """Do the outputs answer to each input as strongly as the model says?

    Attributes
    ----------
    error : ndarray, shape (r,)
        α: the outputs answer 1 + α times as strongly as the model says; NaN where the inputs don't tell it.
    deviation : ndarray, shape (r,)
        Its standard deviation; infinite where the inputs don't tell it, NaN where nothing was tested.
    share : ndarray, shape (r,)
        RMS of what the model answers to this input alone, relative to the output where that is largest.
    """

    error: Array
    deviation: Array
    share: Array


@dataclass(frozen=True, eq=False, repr=False)
class OutlyingSamples(_Result):
    """Samples of one output of one experiment that lie far off their predictions while those of the others do not.

    Attributes
    ----------
    experiment : int
        Its row in the data.
    name : str or None
        Its name, where the data give it one.
    output : int
        Counted from 0.
    steps : list of int
    error, usual : float
        The largest prediction error one step ahead, and the median over the experiments there.
    """

    experiment: int
    name: Optional[str]
    output: int
    steps: list[int]
    error: float
    usual: float


@dataclass(frozen=True, eq=False, repr=False)
class Validation(_Found):
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
    gains : InputGains
    outlying : list of OutlyingSamples
        Of noisy data.
    first_predicted, first_simulated : int
        First steps with a prediction and with a simulation.
    findings : list of Finding
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
    gains: InputGains
    outlying: list[OutlyingSamples]
    first_predicted: int
    first_simulated: int
    findings: list[Finding]


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
class Departure(_Result):
    """A channel whose mean over the experiments departs from zero.

    Attributes
    ----------
    channel : int
        Number of the channel from 0 on, inputs first.
    steps : list of int
        Steps at which its own t² is beyond the bound; with a period its phases.
    """

    channel: int
    steps: list[int]


@dataclass(frozen=True, eq=False, repr=False)
class NominalTest(_Result):
    """Is the mean motion significantly different from zero?

    Two tests share the error of one run in a thousand: the mean of t² over channels and steps, and the largest t².

    Attributes
    ----------
    statistic : float
        Mean of t² over channels and steps.
    threshold : float
        Its bound.
    step_statistic : float
        The t² of one channel at one step that is largest beside its bound.
    step_threshold : float
        That bound, corrected for the number of channels and steps.
    departures : list of Departure
        Channels and steps whose own t² is beyond the bound.
    significant : bool
        By either test.
    """

    statistic: float
    threshold: float
    step_statistic: float
    step_threshold: float
    departures: list[Departure]
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
class Outlier(_Result):
    """An experiment that does not obey the model of the others.

    Attributes
    ----------
    experiment : int
        Its row in the data.
    name : str or None
        Its name, where the data give it one.
    ratio : float
        Size of its leave-one-out residuals over the usual one.
    explanation : str
        What would make it as usual, in words; empty where nothing that was tried does.
    """

    experiment: int
    name: Optional[str]
    ratio: float
    explanation: str


@dataclass(frozen=True, eq=False, repr=False)
class DependentExperiment(_Result):
    """An experiment that is the sum of others, each multiplied by its weight, within rounding.

    Attributes
    ----------
    experiment : int
        Its row in the data.
    of : list of int
        Rows of the others.
    weights : ndarray, shape (others,)
    """

    experiment: int
    of: list[int]
    weights: Array


@dataclass(frozen=True, eq=False, repr=False)
class Identification(_Found):
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
    outliers : list of Outlier
        Looked for where there is noise, and five experiments or more.
    copies : list of list of int
        Rows of experiments that are copies of each other, within rounding; the first one of each list was used.
    dependent : list of DependentExperiment
        Experiments that are sums or multiples of others, within rounding; they were not used.
    findings : list of Finding
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
    outliers: list[Outlier]
    copies: list[list[int]]
    dependent: list[DependentExperiment]
    findings: list[Finding]
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class LikelihoodChoice(_Result):
    """λ of EM by the likelihood of experiments left out.

    Attributes
    ----------
    smoothing : ndarray, shape (candidates,)
        Descending.
    log_likelihood : ndarray, shape (candidates,)
        Of each, per output sample.
    error : ndarray, shape (candidates,)
        Standard error of its difference from the best.
    best : float
    """

    smoothing: Array
    log_likelihood: Array
    error: Array
    best: float


@dataclass(frozen=True, eq=False, repr=False)
class RefinementFigures(_Result):
    """A model on the data of its refinement.

    Attributes
    ----------
    simulation, one_step : Fit
        Over the samples that the models before and after can both compute.
    whiteness_p : float
    """

    simulation: Fit
    one_step: Fit
    whiteness_p: float


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(_Found):
    """What a refinement by EM has done.

    Attributes
    ----------
    smoothing : float
        λ, and
    reason : str
        why.
    choice : LikelihoodChoice or None
        Where λ was chosen by cross-validation.
    start_log_likelihood : float
        Of the model given.
    log_likelihood, penalised : ndarray, shape (iterations + 1,)
        Before the first iteration and after each: the plain one, and the one that EM climbs and that never falls.
    iterations : int
    converged : bool
    noise_segments : int
        Stretches of steps whose noise has a size of its own.
    before, after : RefinementFigures
    findings : list of Finding
    """

    smoothing: float
    reason: str
    choice: Optional[LikelihoodChoice]
    start_log_likelihood: float
    log_likelihood: Array
    penalised: Array
    iterations: int
    converged: bool
    noise_segments: int
    before: RefinementFigures
    after: RefinementFigures
    findings: list[Finding]


@dataclass(frozen=True, eq=False, repr=False)
class Fold(_Found):
    """One part of a cross-validation.

    Attributes
    ----------
    experiments : list of int
        Row numbers of those that were kept back.
    experiment_names : list of str or None
        Their names, where the data give them some.
    states, lags : int
        Of the model of the others.
    simulation, one_step, horizon : Fit
    findings : list of Finding
    """

    experiments: list[int]
    experiment_names: Optional[list[str]]
    states: int
    lags: int
    simulation: Fit
    one_step: Fit
    horizon: Fit
    findings: list[Finding]


@dataclass(frozen=True, eq=False, repr=False)
class CrossValidation(_Found):
    """Every experiment judged by a model that has not seen it.

    Attributes
    ----------
    folds : list of Fold
    simulation, one_step, horizon : Fit
        Over all experiments, as computed in their folds.
    simulation_spread, one_step_spread, horizon_spread : ndarray, shape (m,)
        Standard deviations of the fits of the folds [%].
    findings : list of Finding
        Those of the folds, each of them once.
    """

    folds: list[Fold]
    simulation: Fit
    one_step: Fit
    horizon: Fit
    simulation_spread: Array
    one_step_spread: Array
    horizon_spread: Array
    findings: list[Finding]


@dataclass(frozen=True, eq=False, repr=False)
class Interval(_Result):
    """Estimates, and between what the truth lies; all arrays have one shape.

    Attributes
    ----------
    estimate : ndarray
        NaN where there is none.
    deviation : ndarray
        Standard errors.
    lower, upper : ndarray
        Bounds of each entry by itself; infinite where nothing tells the noise.
    """

    estimate: Array
    deviation: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False, repr=False)
class MarkovBounds(_Result):
    """Bounds of the Markov parameters.

    Attributes
    ----------
    band : int
    k_begin : int
        Pulses before this step have no estimate.
    interval : Interval of shape (T, band + 1, m, r)
        Entry [k, g] is h(k, k-g), with h(k, k) = D[k].
    """

    band: int
    k_begin: int
    interval: Interval


@dataclass(frozen=True, eq=False, repr=False)
class SpectrumBounds(_Result):
    """Bounds of the eigenvalues of the closed loop in a reference frame, NaN where a step has fewer.

    Attributes
    ----------
    begin : int
        Step of the first entry.
    eigenvalues : ndarray of complex, shape (S, n)
    real, imaginary : Interval of shape (S, n)
        Of their parts.
    covariance : ndarray, shape (S, n)
        Of real and imaginary part.
    simple : ndarray of bool, shape (S, n)
        False where neighbours are too near for bounds, which are infinite then.
    """

    begin: int
    eigenvalues: ComplexArray
    real: Interval
    imaginary: Interval
    covariance: Array
    simple: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False, repr=False)
class Confidence(_Found):
    """How far parameters, outputs and eigenvalues of a model may lie from the truth.

    Attributes
    ----------
    method : {"factors", "bootstrap"}
    level : float
        Probability that an interval holds the truth.
    dt : float
        Sample time [s].
    experiments, lags : int
    replicates : int
        Of the bootstrap, that could be identified.
    freedom : float
        Degrees of freedom of Student's t.
    markov : MarkovBounds
    simulated : Interval of shape (N, T, m)
        Mean outputs for the inputs of the data.
    predicted : Interval of shape (N, T, m), or None
        New measurements one step ahead; of the factors alone.
    spectrum : SpectrumBounds or None
    findings : list of Finding
    """

    method: str
    level: float
    dt: float
    experiments: int
    lags: int
    replicates: int
    freedom: float
    markov: MarkovBounds
    simulated: Optional[Interval]
    predicted: Optional[Interval]
    spectrum: Optional[SpectrumBounds]
    findings: list[Finding]
    _core: Any = field(repr=False)

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Writes the bounds to .npz, .h5 or .mat, whole or not at all.

        Parameters
        ----------
        path : path
            The file; its extension says the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        self._core.save(path, mat73)


@dataclass(frozen=True, eq=False, repr=False)
class Plan(_Found):
    """How many experiments, and inputs for them.

    Attributes
    ----------
    inputs : Ensemble
        N experiments of T steps with r inputs and no outputs.
    lags : int
        Lag order p.
    unknowns : int
        L = r + p (r + m), per output and step.
    minimum, recommended : int
        Numbers of experiments.
    reasons : list of str
        Of both numbers, and of the steps that have no full regression.
    kind : {"gaussian", "binary", "multisine", "orthogonal", "optimised"}
    peak, rms : ndarray, shape (r,)
        Of the inputs.
    first_step : int
        First step with a regression.
    excess : float
        Share that estimated coefficients add to the one-step mean square error.
    input_condition : ndarray, shape (T,)
        Condition number of the inputs in a window; NaN without a regression.
    first_forecast : int
        With a model: first step whose window it forecasts.
    condition : ndarray, shape (T,), rank : list of int
        With a model: of the whole windows; empty without one.
    start_condition : float
        Worst condition before the inputs were optimised.
    output_peak : ndarray, shape (m,)
        With a model: largest output without noise.
    noise_floor, markov_error : float
        With a model and noise levels: best one-step error over the outputs; error of the Markov parameters over
        themselves.
    findings : list of Finding
    """

    inputs: Ensemble
    lags: int
    unknowns: int
    minimum: int
    recommended: int
    reasons: list[str]
    kind: str
    peak: Array
    rms: Array
    first_step: int
    excess: float
    input_condition: Array
    first_forecast: int
    condition: Array
    rank: list[int]
    start_condition: float
    output_peak: Array
    noise_floor: float
    markov_error: float
    findings: list[Finding]

    @property
    def u(self) -> Array:
        """The inputs (N, T, r), a view."""
        return self.inputs.u

    @property
    def experiments(self) -> int:
        """Number of experiments N of the inputs."""
        return self.inputs.experiments

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Writes the inputs as an ensemble, as `Ensemble.save` does."""
        self.inputs.save(path, mat73=mat73)


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(_Result):
    """Can the model be trusted?

    Attributes
    ----------
    trust : {"good", "look closer", "don't trust"}
    summary : str
        One sentence of figures.
    reasons : list of str
        Against the model, the gravest first.
    horizon : int
        Steps ahead of the predictions that were judged; 0: the simulation was.
    """

    trust: str
    summary: str
    reasons: list[str]
    horizon: int


@dataclass(frozen=True, eq=False, repr=False)
class Streamed(_Result):
    """An identification in blocks, whose model is in a file.

    Attributes
    ----------
    identification : Identification
    states : int
        Largest state dimension n.
    block, blocks : int
        Steps of a block, and how many there are.
    overlap : int
        Steps that a block shares with its neighbours.
    missing : int
        Samples, within the lengths of the experiments.
    resumed : int
        Blocks that come from the journal of an earlier call.
    """

    identification: Identification
    states: int
    block: int
    blocks: int
    overlap: int
    missing: int
    resumed: int


@dataclass(frozen=True, eq=False, repr=False)
class Additions(_Found):
    """What new experiments have added, and how well the model of those before does on them.

    Attributes
    ----------
    experiments : list of int
        That each ensemble or file has added.
    known : list of list of int
        Row numbers, in each ensemble or file, of experiments that the state had already. They are not added again.
    simulation, one_step : Fit
        Of the model before on all new experiments.
    findings : list of Finding
        Among them one for each output that the model before predicts no better than by its mean, or simulates far worse.
    """

    experiments: list[int]
    known: list[list[int]]
    simulation: Fit
    one_step: Fit
    findings: list[Finding]


@dataclass(frozen=True, eq=False, repr=False)
class Updated(_Found):
    """The model of all experiments so far.

    Attributes
    ----------
    experiments : int
        All of them.
    condition_max : float
        0 where all steps were in one regression.
    rank_deficient_steps : int
    added : Additions or None
        What the last update has added.
    findings : list of Finding
    """

    experiments: int
    condition_max: float
    rank_deficient_steps: int
    added: Optional[Additions]
    findings: list[Finding]


@dataclass(frozen=True, eq=False, repr=False)
class PrintedNumber(_Result):
    """A number of the paper's Appendix B and the one computed here.

    Attributes
    ----------
    equation, quantity : str
    printed, computed : complex
    tolerance : float
        What counts as agreement.
    """

    equation: str
    quantity: str
    printed: complex
    computed: complex
    tolerance: float

    @property
    def agrees(self) -> bool:
        """Whether the two are as near as the printed digits can tell."""
        return abs(self.computed - self.printed) <= self.tolerance


@dataclass(frozen=True, eq=False, repr=False)
class Paper(_Result):
    """The paper's example, recomputed.

    Attributes
    ----------
    printed : list of PrintedNumber
    data : dict
        All that the figures show, as `paper.json` holds it.
    """

    printed: list[PrintedNumber]
    data: dict[str, Any]
