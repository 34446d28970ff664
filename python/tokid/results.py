# SPDX-License-Identifier: BSD-3-Clause
"""The results of calls, as dataclasses with the fields of the C++ structs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Callable, Optional

import numpy as np
import numpy.typing as npt

from . import _display
from ._ensemble import Ensemble
from ._held import read_only
from ._samples import plural
from ._summary import ChannelSummary as ChannelSummary
from ._typing import Array, ComplexArray, PathLike

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_: Any) -> Callable[[type], type]:
        """Do nothing: only type checkers use this decorator of newer versions of Python."""
        return lambda cls: cls


_LINE = 100  # characters


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= 6 and value.dtype.kind == "f":
            return "[" + ", ".join(_short(float(x)) for x in value) + "]"
        return f"array{value.shape}"
    if isinstance(value, _Result):
        shown = value._line()
        return shown if len(shown) <= _LINE else f"{type(value).__name__}(…)"
    if isinstance(value, (list, tuple, dict)):
        shown = repr(value) if len(value) <= 6 else ""
        return shown if 0 < len(shown) <= _LINE and "\n" not in shown else f"{type(value).__name__} of {len(value)}"
    return repr(value)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
class _Result:
    """A result that is shown in a few lines, and as a table of HTML: arrays by their shapes, numbers with three digits.

    The classes of results are frozen dataclasses.
    """

    def __init_subclass__(cls, eq: bool = False) -> None:
        dataclass(frozen=True, eq=eq, repr=False)(cls)

    def _fields(self) -> list[tuple[str, str]]:
        shown = (f.name for f in fields(self) if f.repr)  # type: ignore[arg-type]
        return [(name, _short(getattr(self, name))) for name in shown]

    def _line(self) -> str:
        """The result in one line."""
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self._fields())})"

    def _rows(self) -> Sequence[_display.Row]:
        """What is shown, for results with a page of their own."""
        return self._fields()

    def __repr__(self) -> str:
        own = type(self)._rows is not _Result._rows
        line = "" if own else self._line()
        if 0 < len(line) <= _LINE and "\n" not in line:
            return line
        return _display.as_text(f"tokid.{type(self).__name__}", self._rows())

    def _repr_html_(self) -> str:
        return _display.as_html(f"tokid.{type(self).__name__}", self._rows())


def _fits(names: list[str], columns: dict[str, Fit], spreads: Optional[dict[str, Array]] = None) -> list[list[str]]:
    """A table of fits: a row for each output, and a column for each kind of fit."""
    table = [["output", *columns]]
    for j in range(len(next(iter(columns.values())).fit)):
        row = [names[j] if names else f"output {j}"]
        for title, fit in columns.items():
            text = _display.percent(float(fit.fit[j]))
            spread = np.nan if spreads is None else float(spreads[title][j])
            shown = f"{spread:.0f}" if spread >= 10 else f"{spread:.2g}"
            row.append(text if np.isnan(spread) else text.replace(" %", f" ± {shown} %"))
        table.append(row)
    return table


def _columns(of: Any) -> dict[str, Fit]:
    """The fits of a validation or a cross-validation. With a horizon of one step, two of them are the same."""
    columns = {"simulation": of.simulation, "one step": of.one_step}
    if of.steps_ahead > 1:
        columns[plural(of.steps_ahead, "step")] = of.horizon
    return columns


def _counted(numbers: list[int], noun: str) -> str:
    """How many folds have each number: "4 in 1 fold, 6 in 3", or "4 in all folds"."""
    counts = {n: numbers.count(n) for n in sorted(set(numbers))}
    if len(counts) == 1:
        return f"{numbers[0]} in all {noun}s"
    words = [f"{n} in {plural(count, noun) if i == 0 else count}" for i, (n, count) in enumerate(counts.items())]
    return ", ".join(words)


@dataclass(frozen=True)
class FindingChannel:
    """A channel that a finding is about."""

    side: str
    index: int
    name: str


@dataclass(frozen=True)
class FindingExperiment:
    """An experiment that a finding is about. Its name is None if the data give none."""

    row: int
    name: Optional[str]


@dataclass(frozen=True)
class FindingTerm:
    """A term of a sum: `factor` times the sample of a channel `lag` steps before k."""

    channel: FindingChannel
    lag: int
    factor: float


class Finding(_Result, eq=True):
    """A fact about data, a model or an identification that the user should know.

    Attributes
    ----------
    kind : str
        Name of the kind, such as "samples_outlying". docs/formats.md lists all kinds and the fields that they fill.
    severity : {"note", "warning"}
        "note": an assumption replaced missing information. "warning": the data or the model may not be what the user
        expects.
    scope : {"all", "first_steps", "new_experiments", "cross_validation", "folds"}
        Data that the finding is about. "first_steps": those from which an identification in blocks makes its
        choices. "new_experiments": those of an update. "cross_validation", "folds": all experiments of a
        cross-validation, or the training data of its folds.
    channels : list of FindingChannel
        Each with its side ("input" or "output"), its number there, and its name.
    experiments : list of FindingExperiment
        Each with its row and its name.
    steps : list of int
        Steps k.
    numbers : dict of str to float
        Numbers, with the names that docs/formats.md gives for the kind.
    text : str
        The finding as a sentence.
    terms : list of FindingTerm
        Terms of a sum of samples.
    groups : list of list of FindingExperiment
        For each of `experiments`: the experiments that it is a copy or a weighted sum of.
    names : list of str
        Names in the model, if those in the data differ.
    detail : str
        A text from elsewhere, such as the message of an error or the name of an option.
    file : str
        The file that the finding is about, if there are several.
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

    def _rows(self) -> Sequence[_display.Row]:
        return [("kind", self.kind), (self.severity, self.text)]

    def __repr__(self) -> str:  # in one line, because findings are shown in lists
        return f"<Finding {self.kind}, {self.severity}: {self.text}>"


class _Found:
    """A result with findings."""

    findings: list[Finding]

    @property
    def warnings(self) -> list[str]:
        """The findings as sentences."""
        return [finding.text for finding in self.findings]

    def _warned(self) -> list[_display.Row]:
        return [("Warnings", f"{len(self.findings)}; the attribute warnings lists them")] if self.findings else []


class Fit(_Result):
    """The agreement of computed and measured outputs, over all experiments and steps where both are known.

    Attributes
    ----------
    fit : ndarray, shape (m,)
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%]. ȳ is the nominal trajectory if the model has one, else the mean over
        experiments and steps. NaN if nothing could be compared.
    rmse : ndarray, shape (m,)
        Root mean square errors, in the units of the outputs.
    samples : int
        Number of compared samples per output, the smallest over the outputs.
    """

    fit: Array
    rmse: Array
    samples: int


class ExperimentFits(_Result):
    """The fits of each experiment alone.

    Attributes
    ----------
    simulation_fit, one_step_fit : ndarray, shape (N, m)
        As `Fit.fit` [%], but ȳ is the mean of the experiment if the model has no nominal trajectory.
    simulation_rmse, one_step_rmse : ndarray, shape (N, m)
        Root mean square errors, in the units of the outputs.
    simulation_samples, one_step_samples : ndarray of int, shape (N, m)
        Numbers of samples that were compared.
    over_median : ndarray, shape (N, m)
        RMS error one step ahead, as a multiple of its median over the experiments. NaN if the median is zero.
    simulation_error, one_step_error : ndarray, shape (N,)
        RMS errors over steps and outputs, each relative to the spread of its output over all experiments and steps.
    simulation_limit, one_step_limit : float
        Limits of these errors: 10 times their median over the experiments, and 0.05 at least.
    excess : ndarray, shape (N,)
        The larger one of both errors over their limits.
    outlying : ndarray of bool, shape (N,)
        Whether an error is above its limit. Of fewer than three experiments, this is true only of one whose errors
        overflow beside another one.
    worst_first : list of int
        The experiments in falling order of their excess.
    worst_output : list of int or None, shape (N,)
        The output with the largest part of the error that gives the excess. None: without an error.
    """

    simulation_fit: Array
    one_step_fit: Array
    simulation_rmse: Array
    one_step_rmse: Array
    simulation_samples: Array
    one_step_samples: Array
    over_median: Array
    simulation_error: Array
    one_step_error: Array
    simulation_limit: float
    one_step_limit: float
    excess: Array
    outlying: Array
    worst_first: list[int]
    worst_output: list[Optional[int]]


class Whiteness(_Result):
    """Test: are the innovations of different steps correlated?

    Attributes
    ----------
    p : float
        Probability of at least this correlation if the innovations are white. NaN if not tested.
    z : ndarray, shape (lags,)
        Standardised sum of each lag.
    correlation : ndarray, shape (lags, m)
        Correlation of each output with itself 1, 2, … steps before.
    bound : ndarray, shape (lags,)
        If the innovations are white, 99 % of the entries of `correlation` are smaller in size.
    over : {"experiments", "time", "nothing"}
        Samples over which the correlations were computed.
    """

    p: float
    z: Array
    correlation: Array
    bound: Array
    over: str


class Independence(_Result):
    """Test: are the innovations correlated with the inputs?

    Attributes
    ----------
    p : float
        Probability of correlations at least this large if there are none. NaN if not tested.
    first : int
        Lag of the first entry of `z` and `correlation`. Negative lags belong to later inputs.
    z : ndarray, shape (lags,)
        Standardised sum of each lag.
    correlation : ndarray, shape (lags,)
        Root mean square of the canonical correlations beyond chance.
    over : {"experiments", "time", "nothing"}
        Samples over which the correlations were computed.
    """

    p: float
    first: int
    z: Array
    correlation: Array
    over: str


class NormalisedSquares(_Result):
    """Test: are the innovations as large as their covariance in the model?

    Attributes
    ----------
    ratio : float
        Mean of εᵀ S⁻¹ ε over m. 1 if the covariance S is right, more if S is too small. NaN if the model has no S.
    p : float
        Probability of a ratio at least this far from 1 if S is right.
    normal : bool
        True: there are fewer than 20 experiments, and `p` assumes normal innovations.
    step, step_p : ndarray, shape (T,)
        Ratio and probability of each step. NaN where there is none.
    """

    ratio: float
    p: float
    normal: bool
    step: Array
    step_p: Array


class InputGains(_Result):
    """Test: does each input act on the outputs as strongly as in the model?

    Attributes
    ----------
    error : ndarray, shape (r,)
        α: the input acts 1 + α times as strongly as in the model. NaN if the inputs do not determine it.
    deviation : ndarray, shape (r,)
        Standard deviation of α. Infinite if the inputs do not determine it, NaN if nothing was tested.
    share : ndarray, shape (r,)
        RMS of the simulated response to this input alone over the RMS of the output, for the output where it is
        largest.
    """

    error: Array
    deviation: Array
    share: Array


class Conclusion(_Result):
    """What a test of the innovations shows.

    Attributes
    ----------
    result : {"untested", "nothing", "negligible", "against"}
        "nothing": no sign against the model; "negligible": significant, but too small to matter; "against": significant
        and large enough to matter.
    reason : str
        "size_as_stated", "correlated", …; docs/formats.md lists the reasons.
    channels : list of FindingChannel
        The inputs that the reason is about.
    numbers : dict of str to float
    errors, intervals : ndarray, shape (channels,)
        For each of these inputs: the error of its effect in the model, and half of the 99 % interval of this error.
    pooled : bool
        The test took all steps together, because the experiments are few.
    text : str
        The sentence.
    """

    result: str
    reason: str
    channels: list[FindingChannel]
    numbers: dict[str, float]
    errors: Array
    intervals: Array
    pooled: bool
    text: str


class OutlyingSamples(_Result):
    """Samples of one output of one experiment with much larger prediction errors than in the other experiments.

    Attributes
    ----------
    experiment : int
        Row of the experiment in the data.
    name : str or None
        Name of the experiment, if the data give one.
    output : int
        Number of the output, from 0.
    steps : list of int
        Steps of the samples.
    error, usual : float
        Largest one-step prediction error, and the median over the experiments at that step.
    weight : float
        Weight in the identification. 1: as any other sample. 0: counted as missing. In between: moved towards its
        prediction, to this share of the error.
    """

    experiment: int
    name: Optional[str]
    output: int
    steps: list[int]
    error: float
    usual: float
    weight: float


class Validation(_Found, _Result):
    """The fits and tests of a model on data.

    Attributes
    ----------
    simulation, one_step, horizon : Fit
        Fits of the simulation and of the predictions one step and `horizon` steps ahead.
    noisy : bool
        True: the innovations exceed rounding errors.
    whiteness_p : float
        `whiteness.p`.
    whiteness : Whiteness
        Test for correlation in time.
    independence, feedback : Independence
        Tests for correlation with past and present inputs, and with later inputs. A small p of `feedback` is not a
        fault of the model.
    squares : NormalisedSquares
        Test of the covariance of the innovations.
    gains : InputGains
        Test of the effect of each input.
    conclusions : dict of str to Conclusion
        Conclusions of the tests "nis" (the squares), "whiteness", "independence", "gains" and "feedback".
    outlying : list of OutlyingSamples
        Outlying samples; only for noisy data.
    first_predicted, first_simulated : int
        First steps with a prediction and with a simulation.
    findings : list of Finding
    output_names : list of str
        Names (m) of the outputs.
    steps_ahead : int
        Steps ahead of the predictions of `horizon`.
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
    conclusions: dict[str, Conclusion]
    outlying: list[OutlyingSamples]
    first_predicted: int
    first_simulated: int
    findings: list[Finding]
    output_names: list[str] = field(default_factory=list)
    steps_ahead: int = 1

    def _rows(self) -> Sequence[_display.Row]:
        rows: list[_display.Row] = [("Fit", _fits(self.output_names, _columns(self)))]
        tested = {name: found for name, found in self.conclusions.items() if found.result != "untested"}
        rows += [(_TESTS[name], found.text) for name, found in tested.items()]
        if not tested:
            rows += [("Innovations", text) for text in sorted({found.text for found in self.conclusions.values()})]
        if self.outlying:
            rows.append(("Outliers", f"samples of {plural(len({o.experiment for o in self.outlying}), 'experiment')}"))
        return rows + self._warned()


# The tests of the innovations, with the names that the tool gives them.
_TESTS = {
    "nis": "Innovations",
    "whiteness": "Whiteness",
    "independence": "Inputs",
    "gains": "Gains",
    "feedback": "Feedback",
}


class TimeVariation(_Result):
    """The variation of a model over time.

    Attributes
    ----------
    smoothing : float
        λ of the penalty on variation. 0: each step has its own coefficients. Infinity: all steps have the same ones.
    period : int
        P: the steps k and k + P share one model. 1: all steps do. 0: no period.
    """

    smoothing: float
    period: int


class NoisyChoices(_Result):
    """The choices of an identification from noisy data, apart from lag order and state dimension.

    Attributes
    ----------
    variation : TimeVariation
    state_smoothing : float
        λ of the regressions on states.
    weighting : {"one-step", "many-steps", "projection"}
    refinement_smoothing : float
        λ of EM.
    refinement_iterations : int
        Iterations of EM. 0: no refinement.
    jumps : list of int
        Steps at which the matrices jump.
    delays : list of int
        Dead time of each input in steps. Empty: none.
    """

    variation: TimeVariation
    state_smoothing: float
    weighting: str
    refinement_smoothing: float
    refinement_iterations: int
    jumps: list[int]
    delays: list[int]


class Departure(_Result):
    """A channel whose mean over the experiments differs from zero.

    Attributes
    ----------
    channel : int
        Number of the channel, from 0, inputs first.
    steps : list of int
        Steps at which its t² exceeds the bound; with a period, phases.
    """

    channel: int
    steps: list[int]


class NominalTest(_Result):
    """Test: does the mean motion differ significantly from zero?

    Two tests share a total false-alarm rate of 1 in 1000: the mean of t² over channels and steps, and the largest t².

    Attributes
    ----------
    statistic, threshold : float
        Mean of t² over channels and steps, and its bound.
    step_statistic, step_threshold : float
        The t² of one channel at one step that is largest relative to its bound, and this bound. The bound is corrected
        for the number of channels and steps.
    constant_statistic, constant_threshold : float
        F of the constant in a regression of the outputs of a time-invariant system, and its bound. 0: not tested.
    departures : list of Departure
        Channels and steps whose own t² exceeds the bound.
    significant : bool
        True if a test is significant.
    """

    statistic: float
    threshold: float
    step_statistic: float
    step_threshold: float
    constant_statistic: float
    constant_threshold: float
    departures: list[Departure]
    significant: bool


class InitialStateTest(_Result):
    """Test: do the errors of the first steps show unknown initial states?

    Attributes
    ----------
    statistic, threshold : float
        Largest ratio of an early error variance to the later one, and its bound.
    decision : {"zero", "unknown"}
    reason : str
    """

    statistic: float
    threshold: float
    decision: str
    reason: str


class LagOrderErrors(_Result):
    """Leave-one-out errors of the lag orders; empty unless p was chosen with a regression for each step.

    Attributes
    ----------
    steps : list of int
        The examined steps.
    error : ndarray, shape (steps, p_max)
        Mean over the outputs of log(leave-one-out mean square / mean square of y).
    mean : ndarray, shape (p_max,)
        Mean of `error` over the steps.
    best : int
        The smallest p within a standard error of the smallest mean.
    """

    steps: list[int]
    error: Array
    mean: Array
    best: int


class SmoothingTrial(_Result):
    """The cross-validation error of one lag order with one λ.

    Attributes
    ----------
    lags : int
    smoothing : float
    error : float
        Relative RMS one-step error in cross-validation, geometric mean over the outputs.
    """

    lags: int
    smoothing: float
    error: float


class SmoothingChoice(_Result):
    """The choice of lag order and λ by cross-validation; without trials unless both were chosen together.

    Attributes
    ----------
    trials : list of SmoothingTrial
        All trials, in the order of the search.
    lags : int
    smoothing : float
    error : float
    """

    trials: list[SmoothingTrial]
    lags: int
    smoothing: float
    error: float


class OrderScores(_Result):
    """The errors of each state dimension; empty unless n was chosen from noisy data.

    Attributes
    ----------
    states : list of int
        The candidates.
    horizons : list of int
        Steps ahead.
    errors : ndarray, shape (candidates, horizons)
        Log of the RMS error over the RMS of the departures, mean over the outputs with their weights. Beyond one step
        at most 0, the error of predicting no departure.
    cross_validated : bool
        True: cross-validation errors. False: errors on the training data.
    smoothing : float
        λ of the regressions on states.
    weighting : {"one-step", "many-steps", "projection"}
    price : float
        Penalty for each state, for errors on the training data.
    smallest : float
        The smallest mean of these logs over the horizons, penalty included.
    uncertainty : ndarray, shape (candidates,)
        Standard error of the difference from the order with the smallest mean. Empty for errors on the training data.
    best : int
        The smallest order whose mean is close to the smallest mean.
    """

    states: list[int]
    horizons: list[int]
    errors: Array
    cross_validated: bool
    smoothing: float
    weighting: str
    price: float
    smallest: float
    uncertainty: Array
    best: int


class RefinementTrial(_Result):
    """The cross-validation error of EM with one state dimension and one λ.

    Attributes
    ----------
    states : int
    smoothing : float
    iterations : int
        Iterations of EM. 0: the model before EM.
    error : float
        Mean log of the errors, as in `OrderScores`.
    log_likelihood : float
        Mean over the held-out experiments. NaN without EM.
    """

    states: int
    smoothing: float
    iterations: int
    error: float
    log_likelihood: float


class Jump(_Result):
    """A step at which the matrices jump.

    Attributes
    ----------
    step : int
    loss : float or None
        By how many standard errors the error of the held-out experiments is larger without this jump. None if the jump
        was stated.
    """

    step: int
    loss: Optional[float]


class HeldOutErrors(_Result):
    """Errors of predictions of held-out experiments, at each horizon.

    Attributes
    ----------
    error : ndarray, shape (H,)
        RMS of the errors over that of the departures from the mean motion, mean over the outputs.
    standard_error : ndarray, shape (H,)
        Of these, over the experiments.
    """

    error: Array
    standard_error: Array


class RegressionComparison(_Result):
    """The errors of the models of the folds beside those of the regression that predicts best.

    Attributes
    ----------
    horizons : list of int
        Steps ahead, ascending. The first is 1.
    experiments : int
        Experiments that were held out, each once.
    first_step : int
        The first step that is predicted.
    model, regression : HeldOutErrors
    lags : int
        Lag order of the regression.
    smoothing : float
        λ of the regression. Infinite: one regression for all steps.
    """

    horizons: list[int]
    experiments: int
    first_step: int
    model: HeldOutErrors
    regression: HeldOutErrors
    lags: int
    smoothing: float


class RefinementChoice(_Result):
    """The cross-validation of EM, by the likelihood of held-out experiments; without trials if EM was not tried.

    Attributes
    ----------
    trials : list of RefinementTrial
    states : int
    smoothing : float
    iterations : int
        Iterations of EM. 0: no refinement.
    error : float
    one_step : float
        Log of the one-step error alone, if there are iterations.
    jumps : list of Jump
        Steps at which the matrices jump, ascending.
    ahead_ratio : float
        RMS of the errors of held-out experiments, several steps ahead, over what the model says. NaN if not known.
    ahead_model_share : float
        Share of the variance of these errors that comes from the model, because its experiments are few: by how much
        the models of different folds differ. NaN if not known.
    """

    trials: list[RefinementTrial]
    states: int
    smoothing: float
    iterations: int
    error: float
    one_step: float
    jumps: list[Jump]
    ahead_ratio: float
    ahead_model_share: float


class Outlier(_Result):
    """An experiment that does not fit models of the others: its innovations are too large.

    Attributes
    ----------
    experiment : int
        Row of the experiment in the data.
    name : str or None
        Name of the experiment, if the data give one.
    ratio : float
        Size of its innovations by models of the other experiments, over the usual size.
    outputs : list of FindingChannel
        The outputs with innovations that are too large, the worst first.
    weight : float
        Weight in the identification. 1: as any other experiment. 0: dropped.
    held_out : bool
        The experiment was held out for validation.
    """

    experiment: int
    name: Optional[str]
    ratio: float
    outputs: list[FindingChannel]
    weight: float
    held_out: bool


class FeedthroughChoice(_Result):
    """Whether the outputs respond to the inputs of the same step.

    Attributes
    ----------
    present : bool
        False: D = 0.
    reason : {"stated", "exact", "no_response", "response", "feedback", "untested", "unknown"}
        "stated": by the option. "exact": data without noise. "no_response": inputs and outputs of a step are not
        correlated, apart from what earlier samples explain. "response": they are, and there is no sign of feedback.
        "feedback": they are, and there is feedback, so the inputs may respond to the outputs of the same step.
        "untested": the samples do not tell.
    response_p, feedback_p : float
        Probabilities of correlations at least this significant if there are none: between inputs and outputs of a step,
        and between inputs and earlier innovations. NaN if not tested.
    """

    present: bool
    reason: str
    response_p: float
    feedback_p: float


class Identification(_Found, _Result):
    """The choices of an identification, and the evidence for them.

    Attributes
    ----------
    experiments, steps : int
        Numbers used for the identification.
    lags : int
        Lag order p.
    variation : TimeVariation
    state_smoothing : float
        λ of the regressions on states.
    min_experiments : int
        Number of experiments that this lag order needs.
    rank_deficient_steps : int
        Number of steps whose regression has no full rank.
    condition_max : float
        Largest condition number of the regressions of single steps. 0 if all steps are in one regression.
    nominal_test : NominalTest
    initial_state_test : InitialStateTest
    feedthrough : FeedthroughChoice
    lag_order_errors : LagOrderErrors
    smoothing_choice : SmoothingChoice
    order_scores : OrderScores
    refinement : RefinementChoice
    comparison : RegressionComparison or None
        None if the choices were not cross-validated, or if the steps share their matrices periodically.
    choices : NoisyChoices or None
        The choices, if all steps are in one regression.
    together : bool
        True: one regression of all steps. False: one regression for each step.
    noisy : bool
        True: the residuals exceed rounding errors.
    nominal : bool
        True: a mean motion was removed.
    singular_value_gap : float
        Median of σ_n / σ_{n+1} over the steps of full dimension. A large gap shows the order clearly. NaN if not known.
    held_out : bool
        True: `validation` uses held-out experiments. False: the training data.
    held_out_experiments : int
        Number of held-out experiments. 0 also if the end of a single record is held out.
    validation : Validation
    outliers : list of Outlier
        Outliers. The search needs at least five experiments.
    copies : list of list of int
        Rows of experiments that are copies of each other, within rounding. The first one of each list was used.
    findings : list of Finding
    seconds : float
        Duration of the whole identification [s].
    verdict : Verdict or None
        Whether the model can be trusted: the verdict of the tool and of a report, on the experiments of `validation`.
        None if nothing could be compared, and for an identification in blocks.
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
    feedthrough: FeedthroughChoice
    lag_order_errors: LagOrderErrors
    smoothing_choice: SmoothingChoice
    order_scores: OrderScores
    refinement: RefinementChoice
    comparison: Optional[RegressionComparison]
    choices: Optional[NoisyChoices]
    together: bool
    noisy: bool
    nominal: bool
    singular_value_gap: float
    held_out: bool
    held_out_experiments: int
    validation: Validation
    outliers: list[Outlier]
    copies: list[list[int]]
    findings: list[Finding]
    seconds: float
    verdict: Optional[Verdict] = None

    def _rows(self) -> Sequence[_display.Row]:
        rows: list[_display.Row] = [
            ("Data", f"{plural(self.experiments, 'experiment')} of {plural(self.steps, 'step')}"),
            ("Noise", "found" if self.noisy else "none"),
            ("Lag order", f"p = {self.lags}"),
            ("Smoothing", self._smoothing()),
            ("Mean motion", "removed" if self.nominal else "none removed"),
            ("Initial state", self.initial_state_test.decision),
            ("Feedthrough", "present" if self.feedthrough.present else "none"),
        ]
        if self.refinement.iterations:
            rows.append(("Refinement", f"EM, {plural(self.refinement.iterations, 'iteration')}"))
        if self.refinement.jumps:
            rows.append(("Jumps", "at " + ", ".join(str(jump.step) for jump in self.refinement.jumps)))
        if self.outliers:
            rows.append(("Outliers", plural(len(self.outliers), "experiment")))
        unused = sum(len(group) - 1 for group in self.copies)
        if unused:
            rows.append(("Not used", f"{plural(unused, 'experiment')}: copies of others"))
        return rows + self._judgement() + self._warned()

    def _smoothing(self) -> str:
        period, smoothing = self.variation.period, self.variation.smoothing
        if period == 1 or smoothing == np.inf:
            return "one model for all steps"
        over = f"over {period} steps of a period" if period else "over time"
        return f"λ = {smoothing:.3g} {over}" if smoothing else "none"

    def _judgement(self) -> list[_display.Row]:
        """Fits and verdict."""
        number = self.held_out_experiments
        held_out = f"on {plural(number, 'experiment')} held out" if number else "on data held out"
        where = held_out if self.held_out else "on the training data"
        found = self.validation
        rows: list[_display.Row] = [("Fit", where), ("", _fits(found.output_names, _columns(found)))]
        return rows + ([] if self.verdict is None else list(self.verdict._rows()))


class LikelihoodChoice(_Result):
    """The choice of λ of EM by the likelihood of held-out experiments.

    Attributes
    ----------
    smoothing : ndarray, shape (candidates,)
        The candidates, descending.
    log_likelihood : ndarray, shape (candidates,)
        Log-likelihood of each candidate, per output sample.
    error : ndarray, shape (candidates,)
        Standard error of its difference from the best candidate.
    best : float
        The most likely candidate; infinity if infinity is within one standard error of it.
    """

    smoothing: Array
    log_likelihood: Array
    error: Array
    best: float


class RefinementFigures(_Result):
    """The fits of a model on the data of its refinement.

    Attributes
    ----------
    simulation, one_step : Fit
        Fits over the samples that the models before and after EM can both compute.
    whiteness_p : float
    """

    simulation: Fit
    one_step: Fit
    whiteness_p: float


class Refinement(_Found, _Result):
    """The course of a refinement by EM.

    Attributes
    ----------
    smoothing : float
        λ.
    reason : str
        Reason for this λ.
    choice : LikelihoodChoice or None
        The cross-validation, if it chose λ.
    start_log_likelihood : float
        Log-likelihood of the given model.
    log_likelihood, penalised : ndarray, shape (iterations + 1,)
        Log-likelihood before the first iteration and after each one, without and with the penalty. EM climbs the
        penalised one, which never falls.
    iterations : int
    converged : bool
    noise_segments : int
        Number of stretches of steps with their own noise size.
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


class Fold(_Found, _Result):
    """One fold of a cross-validation.

    Attributes
    ----------
    experiments : list of int
        Rows of the held-out experiments.
    experiment_names : list of str or None
        Names of the held-out experiments, if the data give some.
    states, lags : int
        n and p of the model of the other experiments.
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


class CrossValidation(_Found, _Result):
    """A cross-validation: a model of the other folds predicts and simulates each experiment.

    Attributes
    ----------
    folds : list of Fold
    simulation, one_step, horizon : Fit
        Fits over all experiments, each computed by the model of its fold.
    simulation_spread, one_step_spread, horizon_spread : ndarray, shape (m,)
        Standard deviations of the fits of the folds [%].
    findings : list of Finding
        Findings of all folds, each one once.
    output_names : list of str
        Names (m) of the outputs.
    steps_ahead : int
        Steps ahead of the predictions of `horizon`.
    """

    folds: list[Fold]
    simulation: Fit
    one_step: Fit
    horizon: Fit
    simulation_spread: Array
    one_step_spread: Array
    horizon_spread: Array
    findings: list[Finding]
    output_names: list[str] = field(default_factory=list)
    steps_ahead: int = 1

    def _rows(self) -> Sequence[_display.Row]:
        states, lags = ([getattr(fold, name) for fold in self.folds] for name in ("states", "lags"))
        counts = f"n = {_counted(states, 'fold')}; p = {_counted(lags, 'fold')}"
        spreads = {
            "simulation": self.simulation_spread,
            "one step": self.one_step_spread,
            plural(self.steps_ahead, "step"): self.horizon_spread,
        }
        rows: list[_display.Row] = [
            ("Folds", f"K = {len(self.folds)}, {counts}"),
            ("Fit", _fits(self.output_names, _columns(self), spreads)),
        ]
        return rows + self._warned()


class Interval(_Result):
    """Estimates with their bounds. All arrays have the same shape.

    Attributes
    ----------
    estimate : ndarray
        Estimates. NaN where there is none.
    deviation : ndarray
        Standard errors.
    lower, upper : ndarray
        Bounds of each entry, taken alone. Infinite if no degree of freedom is left to estimate the noise.
    """

    estimate: Array
    deviation: Array
    lower: Array
    upper: Array


class MarkovBounds(_Result):
    """Bounds of the Markov parameters.

    Attributes
    ----------
    band : int
        Largest number of steps between input and output.
    k_begin : int
        Pulses before this step have no estimate.
    interval : Interval of shape (T, band + 1, m, r)
        Entry [k, g] is h(k, k-g), with h(k, k) = D[k].
    relative_error : ndarray, shape (m, r)
        The error to expect from noise, for comparison with `ModelDifference.relative_error` of the same `band`.
        Standard errors over estimates, RMS over all steps.
    relative_error_limit : ndarray, shape (m, r)
        The error is smaller with the probability `Confidence.level` or more.
    """

    band: int
    k_begin: int
    interval: Interval
    relative_error: Array
    relative_error_limit: Array


class ModelDifference(_Result):
    """The difference of the pulse responses of two models, for pulses and responses at the steps begin … end-1.

    A periodic model is continued to the end of the other one, or both over a common period.

    Attributes
    ----------
    relative_error : ndarray, shape (m, r)
        ‖h - h'‖ / ‖h'‖ of the response of each output to each input, over all steps; h' is that of the other model.
        NaN where the other model has no response. `Confidence.markov.relative_error` is the error to expect from noise,
        if the other model is the truth.
    largest : float
        Largest difference at one step, relative to the largest response at this step. A single step with small
        responses can make it large, so it is a test of equality.
    begin, end : int
        First step, and the step after the last one.
    band : int
        Responses up to this number of steps after the pulse are compared.
    """

    relative_error: Array
    largest: float
    begin: int
    end: int
    band: int


class SpectrumBounds(_Result):
    """Bounds of the eigenvalues of the closed loop in a reference frame. NaN if a step has fewer eigenvalues.

    Attributes
    ----------
    begin : int
        Step of the first entry.
    eigenvalues : ndarray of complex, shape (S, n)
    real, imaginary : Interval of shape (S, n)
        Real and imaginary parts.
    covariance : ndarray, shape (S, n)
        Covariance of real and imaginary part.
    simple : ndarray of bool, shape (S, n)
        False: a neighbour is too near for bounds, which are then infinite.
    """

    begin: int
    eigenvalues: ComplexArray
    real: Interval
    imaginary: Interval
    covariance: Array
    simple: npt.NDArray[np.bool_]


class Confidence(_Found, _Result):
    """Bounds of the parameters, outputs and eigenvalues of a model.

    Attributes
    ----------
    level : float
        Probability that an interval contains the true value.
    dt : float
        Sample time [s].
    experiments, lags : int
        N and p of the identification.
    replicates : int
        Number of bootstrap replicates with a successful identification.
    freedom : float
        Degrees of freedom of Student's t.
    smoothing : float
        The λ whose bias the intervals include; 0 if they include none.
    bias : ndarray of shape (T,), or None
        Bias of the Markov parameters over their scatter, RMS at each step.
    markov : MarkovBounds
    simulated : Interval of shape (N, T, m)
        Mean outputs for the inputs of the data.
    spectrum : SpectrumBounds or None
    findings : list of Finding
    """

    level: float
    dt: float
    experiments: int
    lags: int
    replicates: int
    freedom: float
    smoothing: float
    bias: Optional[Array]
    markov: MarkovBounds
    simulated: Interval
    spectrum: Optional[SpectrumBounds]
    findings: list[Finding]
    _core: Any = field(repr=False)

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Write the bounds to .npz, .h5 or .mat. The file appears as a whole or not at all.

        Parameters
        ----------
        path : path
            The file; its extension determines the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        self._core.save(path, mat73)


class FunctionBounds(_Found, _Result):
    """Bounds of a function of a model, by the bootstrap.

    Attributes
    ----------
    interval : Interval
        Arrays with the shape of the function's values.
    level : float
        Probability that an interval contains the true value.
    replicates : int
        Number of replicates with a successful identification.
    freedom : float
        Degrees of freedom of Student's t.
    smoothing : float
        The λ whose bias the intervals include; 0 if they include none.
    findings : list of Finding
    """

    interval: Interval
    level: float
    replicates: int
    freedom: float
    smoothing: float
    findings: list[Finding]


class Modes(_Found, _Result):
    """Natural frequencies and damping ratios with the time frozen, at the steps begin … begin+S-1.

    The columns follow modes over time. A conjugate pair has two columns, the one with positive imaginary part first.

    Attributes
    ----------
    begin : int
        Step of the first entry.
    dt : float
        Sample time [s].
    window : int
        Number of steps whose outputs define the states.
    slow : float
        Largest variation of a valid mode.
    poles : ndarray of complex, shape (S, n)
        s [1/s]. NaN where the window does not determine the state.
    frequency, damping : ndarray, shape (S, n)
        Natural frequencies |s| [rad/s] and damping ratios -Re s/|s|.
    shapes : ndarray of complex, shape (S, m, n)
        Outputs of each mode; the largest one is 1.
    variation : ndarray, shape (S, n)
        Relative change of pole and shape while the mode turns by one radian.
    window_change : ndarray, shape (S, n)
        Relative change of the pole with half the window, or with twice. NaN where there is no other window.
    valid : ndarray of bool, shape (S, n)
        False: the frozen mode describes the motion poorly.
    multipliers : ndarray of complex, shape (n,), or None
        Floquet multipliers of a periodic model.
    multipliers_error : ndarray, shape (n,), or None
        Relative errors of the multipliers by rounding, from 2.2e-16 to 1.
    exponents : ndarray of complex, shape (n,), or None
        Floquet exponents log(multipliers)/(P dt) [1/s]; also where multipliers leave the range of numbers.
    level : float or None
        Probability that an interval contains the true value.
    frequency_bounds, damping_bounds : Interval of shape (S, n), or None
        Intervals; only with data.
    exponents_real_bounds, exponents_imag_bounds : Interval of shape (n,), or None
        Intervals of the parts of the exponents; only with data and for a periodic model. NaN for a multiplier of zero.
    findings : list of Finding
    """

    begin: int
    dt: float
    window: int
    slow: float
    poles: ComplexArray
    frequency: Array
    damping: Array
    shapes: ComplexArray
    variation: Array
    window_change: Array
    valid: npt.NDArray[np.bool_]
    multipliers: Optional[ComplexArray]
    multipliers_error: Optional[Array]
    exponents: Optional[ComplexArray]
    level: Optional[float]
    frequency_bounds: Optional[Interval]
    damping_bounds: Optional[Interval]
    exponents_real_bounds: Optional[Interval]
    exponents_imag_bounds: Optional[Interval]
    findings: list[Finding]

    @property
    def steps(self) -> npt.NDArray[np.int_]:
        """The step of each row, shape (S,)."""
        steps: npt.NDArray[np.int_] = read_only(self.begin + np.arange(len(self.poles)))
        return steps

    @property
    def time(self) -> Array:
        """The time of each row [s], shape (S,)."""
        time: Array = read_only(np.multiply(self.steps, self.dt, dtype=np.float64))
        return time


class Plan(_Found, _Result):
    """A number of experiments, and inputs for them.

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
        Reasons for both numbers, and for steps without a full regression.
    kind : {"gaussian", "binary", "multisine", "orthogonal", "optimised"}
        Kind of the inputs.
    peak, rms : ndarray, shape (r,)
        Peak and RMS of the inputs.
    first_step : int
        First step with a regression.
    excess : float
        Relative increase of the one-step mean square error, because N experiments estimate the coefficients.
    input_condition : ndarray, shape (T,)
        Condition number of the inputs in a window. NaN without a regression.
    first_forecast : int
        First step with a forecast. Forecasts need a model.
    condition : ndarray, shape (T,), rank : list of int
        Condition number and rank of the windows, from a model. Empty without one.
    start_condition : float
        Largest condition number before the optimisation of the inputs. NaN without a model.
    output_peak : ndarray, shape (m,)
        Largest output without noise, from a model. Empty without one.
    noise_floor, markov_error : float
        RMS one-step error of the best coefficients over the RMS of the outputs; expected relative error of the Markov
        parameters. NaN without a model and noise levels.
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
        """The inputs (N, T, r), as a view."""
        return self.inputs.u

    @property
    def experiments(self) -> int:
        """Number of experiments N of the inputs."""
        return self.inputs.experiments

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Write the inputs as an ensemble, as `Ensemble.save` does."""
        self.inputs.save(path, mat73=mat73)


class VerdictReason(_Result):
    """Why a check of a verdict did not pass.

    Attributes
    ----------
    trust : {"look closer", "don't trust"}
        How serious this reason is.
    text : str
        The reason, in words.
    """

    trust: str
    text: str


class CheckFigure(_Result):
    """A figure by which a check decides, and its bound.

    Attributes
    ----------
    name : str
        "fit", "p", …; docs/formats.md lists the names.
    values : ndarray, shape (m,), (1,) or (0,)
        Fits have one value for each output, NaN for a constant one. Others have one value, or none if it is not known.
    rule : {"at least", "at most", "below"}
        What every known value has to be, relative to the bound.
    bound : float
    distrust : float
        A smaller fit leads to distrust. NaN: no such limit, or an exception applies to these data. Noise that the
        model states explains small fits, and good predictions many steps ahead make up for a simulation that is not
        good.
    """

    name: str
    values: Array
    rule: str
    bound: float
    distrust: float


class VerdictCheck(_Result):
    """A check of a verdict, in words and as numbers.

    Attributes
    ----------
    name : str
        "simulation_fit", …; docs/formats.md lists the names.
    subject : str
        What is checked.
    found, needed : str
        The figures of these data, and their bounds, in words. `found` has the reason for a check that is not tested.
    result : {"good", "look closer", "don't trust", None}
        "good": passed. None: not tested.
    untested : str or None
        Why the check is not tested: "no_predictions", …
    figures : list of CheckFigure
        The figures of these data, and their bounds.
    one_suffices : bool
        Whether the check passes if one figure keeps its bound. Otherwise all have to.
    numbers : dict of str to float
        Other numbers that belong to the figures, for example the step with the largest error.
    experiment : FindingExperiment or None
        The experiment with the largest error.
    conclusion : str or None
        Reason of the conclusion, for tests of the innovations.
    reasons : list of VerdictReason
        Why it did not pass. Empty if it passed, or if another check has the reason.
    """

    name: str
    subject: str
    found: str
    needed: str
    result: Optional[str]
    untested: Optional[str]
    figures: list[CheckFigure]
    one_suffices: bool
    numbers: dict[str, float]
    experiment: Optional[FindingExperiment]
    conclusion: Optional[str]
    reasons: list[VerdictReason]


class Verdict(_Result):
    """The conclusion of a report: can the model be trusted?

    Attributes
    ----------
    trust : {"good", "look closer", "don't trust"}
    summary : str
        The main figures in one sentence.
    reasons : list of str
        Reasons against the model, the most serious first.
    checks : list of VerdictCheck
        The checks that decide: `trust` is the worst of their results, and `reasons` are their reasons.
    horizon : int
        Prediction horizon of the fits that decide. 0: the simulation decides.
    """

    trust: str
    summary: str
    reasons: list[str]
    checks: list[VerdictCheck]
    horizon: int

    def _rows(self) -> Sequence[_display.Row]:
        reasons = [("", f"- {reason}") for reason in self.reasons]
        return [("Verdict", self.trust), ("", self.summary), *reasons]


class Streamed(_Result):
    """An identification in blocks. Its model is in a file.

    Attributes
    ----------
    identification : Identification
    states : int
        Largest state dimension n.
    block, blocks : int
        Steps of a block, and number of blocks.
    overlap : int
        Steps that a block shares with its neighbours.
    missing : int
        Number of missing samples within the lengths of the experiments.
    """

    identification: Identification
    states: int
    block: int
    blocks: int
    overlap: int
    missing: int


class Additions(_Found, _Result):
    """The experiments of an update, and the fit of the previous model to them.

    Attributes
    ----------
    experiments : list of int
        Number of experiments added from each ensemble or file.
    known : list of list of int
        Rows, in each ensemble or file, of experiments that the state already had. They are not added again.
    simulation, one_step : Fit
        Fits of the previous model to all new experiments.
    findings : list of Finding
        They include one for each output that the previous model predicts no better than its mean does, or simulates far
        worse.
    """

    experiments: list[int]
    known: list[list[int]]
    simulation: Fit
    one_step: Fit
    findings: list[Finding]


class Updated(_Found, _Result):
    """The identification of a model from an update state.

    Attributes
    ----------
    experiments : int
        Number of all experiments so far.
    condition_max : float
        Largest condition number of the regressions of single steps. 0 if all steps are in one regression.
    rank_deficient_steps : int
        Number of steps whose regression has no full rank.
    added : Additions or None
        The experiments of the last update.
    findings : list of Finding
    """

    experiments: int
    condition_max: float
    rank_deficient_steps: int
    added: Optional[Additions]
    findings: list[Finding]


class PrintedNumber(_Result):
    """A number printed in Appendix B of the paper, and the same number computed here.

    Attributes
    ----------
    equation, quantity : str
    printed, computed : complex
    tolerance : float
        Largest difference that counts as agreement.
    """

    equation: str
    quantity: str
    printed: complex
    computed: complex
    tolerance: float

    @property
    def agrees(self) -> bool:
        """Whether the two numbers differ by no more than the tolerance."""
        return abs(self.computed - self.printed) <= self.tolerance


class Paper(_Result):
    """The example of the paper, recomputed.

    Attributes
    ----------
    printed : list of PrintedNumber
    data : dict
        The data of all figures, as in `paper.json`.
    """

    printed: list[PrintedNumber]
    data: dict[str, Any]


class Observation(_Result):
    """What one step of an observer shows. NaN where the state is not known, and where a sample is missing.

    Attributes
    ----------
    prediction : ndarray, shape (m,)
        One-step prediction of the output.
    innovation : ndarray, shape (m,)
        Output minus prediction.
    normalised_square : float
        Square of the innovation in units of its covariance, over the available outputs. Its mean is `outputs` if the
        covariance is right. NaN if the model has no `innovation_cov`.
    outputs : int
        Number of available outputs.
    """

    prediction: Array
    innovation: Array
    normalised_square: float
    outputs: int


class ExpectedCost(_Result, eq=True):
    """The parts of an expected cost, for outputs without measurement noise.

    Attributes
    ----------
    outputs, inputs, input_rates : float
        Expected weighted squares.
    measurement_noise : float
        What the noise that enters the outputs at the same step adds to the weighted outputs. No controller changes it.
    presumes_zero_state : bool
        True: the model knows neither the initial state nor its distribution, and the observer is presumed to begin with
        zero. Before it has estimated the state from some samples, the inputs of the real loop are nominal.
    """

    outputs: float
    inputs: float
    input_rates: float
    measurement_noise: float
    presumes_zero_state: bool

    @property
    def total(self) -> float:
        """The sum of `outputs`, `inputs` and `input_rates`."""
        return self.outputs + self.inputs + self.input_rates


@dataclass(frozen=True)
class Operations:
    """Operations of one call of exported code, at most.

    Attributes
    ----------
    multiplications, additions, divisions : int
        Subtractions are additions.
    """

    multiplications: int
    additions: int
    divisions: int


class ExportedCode(_Result, eq=True):
    """The sizes of C code.

    Attributes
    ----------
    name : str
        The beginning of all names in C.
    table_bytes : int
        Bytes of the constant tables.
    state_bytes : int
        Bytes of the struct of the state.
    stored_steps : int
        Number of different steps. Equal ones are in the tables once.
    step : Operations
        One step with all outputs.
    step_missing : Operations
        One step if outputs are missing.
    control : Operations
        One input of the controller; zero without one.
    """

    name: str
    table_bytes: int
    state_bytes: int
    stored_steps: int
    step: Operations
    step_missing: Operations
    control: Operations


class ClosedLoop(_Result):
    """A simulation of a closed loop.

    Attributes
    ----------
    data : Ensemble
        Inputs and measured outputs of the experiments, from step 0 on.
    cost : ndarray, shape (N,)
        Cost of each experiment, for outputs without measurement noise.
    """

    data: Ensemble
    cost: Array


class LearnedRun(_Result):
    """The next run of iterative learning.

    Attributes
    ----------
    u : ndarray, shape (T, r)
        Inputs of the next run.
    predicted : ndarray, shape (T, m)
        Its outputs, as predicted by the last run and the model.
    error, predicted_error : ndarray, shape (m,)
        RMS of reference minus output, in the last run and as predicted for the next one.
    """

    u: Array
    predicted: Array
    error: Array
    predicted_error: Array
