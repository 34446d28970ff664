// SPDX-License-Identifier: BSD-3-Clause
#include "choose/regression.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "base/integers.hpp"
#include "base/words.hpp"
#include "choose/feedthrough.hpp"
#include "choose/held_out_error.hpp"
#include "choose/initial_state.hpp"
#include "choose/jumps.hpp"
#include "choose/stages.hpp"
#include "data/output_weights.hpp"
#include "diagnose/regressions.hpp"

namespace tokid {

namespace {

// Largest lag order that the leave-one-out choice tries first. It tries twice as many if the largest is the best.
constexpr Index first_lags = 16;
// Most coefficients per output and step that a choice for noisy data tries: the time grows with their cube.
constexpr Index most_regressors = 160;
// Largest lag order of a model that varies and from which EM starts. EM does not depend on the lag order, and its start
// needs only the right states. The time of larger orders is better spent on EM.
constexpr Index enough_for_em = 12;
// Windows without a missing sample for each unknown, from which EM starts.
constexpr Index enough_windows = 16;
// Most steps that the choices for noisy data use, and most steps of all experiments together.
constexpr Index most_selection_steps = 256, most_selection_samples = 200000;
// One model for all steps of a long record must have a one-step error smaller by this factor than a model that varies.
constexpr double clearly_better = 1.25;
// `stiff`: λ if missing samples leave too few windows to choose λ. `moderate`: λ if a periodic record is too short to
// choose λ.
constexpr double stiff = 1e3, moderate = 1.0;

// Number of experiments, minus one if a mean motion is subtracted, because estimating it uses one degree of freedom.
Index effective_experiments(const Ensemble& data, bool nominal) { return data.experiments() - (nominal ? 1 : 0); }

// L = r + p·(r+m), or p·(r+m) without feedthrough
Index unknowns_of(const Ensemble& data, Index lags, bool feedthrough) {
  return minimum_experiments(data.inputs(), data.outputs(), lags, feedthrough);
}

// The smallest p for the states asked for: p·m ≥ n.
Index least_lags(const Ensemble& data, const IdentifyOptions& options) {
  return options.states ? ceil_div(*options.states, data.outputs()) : 1;
}

// Number of windows of p+1 steps without a gap.
Index whole_windows(const Ensemble& e, Index lags) {
  if (e.missing() == 0) return e.experiments() * std::max<Index>(0, e.steps() - lags);
  Index whole = 0;
  for (Index k = lags; k < e.steps(); ++k) whole += Index(e.complete_rows(k, lags).size());
  return whole;
}

// Chooses p by the leave-one-out error of one-step predictions.
void choose_lags(const Ensemble& data, const IdentifyOptions& options, Regressed& result) {
  const Index needed = least_lags(data, options);
  LagOrderOptions o;
  o.p_min = needed;
  o.output_weights = result.plan.output_weights;
  o.feedthrough = result.plan.feedthrough.present;
  // The order is chosen by residuals, so each step needs at least one degree of freedom.
  const Index testable = largest_lag_order(effective_experiments(data, result.plan.nominal) - 1, data.inputs(),
                                           data.outputs(), o.feedthrough);
  const Index most = std::min(testable, (data.steps() - 1) / 2);
  o.execution = in_stage(options.execution, WorkStage::lags);
  result.plan.lags = needed;
  if (most >= needed && most >= 1) {
    for (o.p_max = std::max(first_lags, needed);; o.p_max *= 2) {
      o.p_max = std::min(o.p_max, most);
      result.lag_order_errors = lag_order_errors(data, o);
      if (result.lag_order_errors.best < o.p_max || o.p_max == most) break;
    }
    result.plan.lags = result.lag_order_errors.best;
    if (result.plan.lags == testable)
      result.findings.push_back({.kind = Finding::Kind::lags_at_limit,
                                 .numbers = {{"lags", double(testable)}, {"experiments", double(data.experiments())}}});
  } else if (testable < needed && data.experiments() >= experiments_for(data, needed, result.plan)) {
    result.findings.push_back({.kind = Finding::Kind::lags_untested,
                               .numbers = {{"lags", double(needed)}, {"experiments", double(data.experiments())}}});
  }
}

void check_size(const Ensemble& data, const Plan& plan, bool tvera_asked) {
  const Index r = data.inputs(), m = data.outputs(), p = plan.lags, found = data.experiments();
  const Index needed = experiments_for(data, p, plan);
  if (found < needed) {
    const Index would_do = largest_lag_order(effective_experiments(data, plan.nominal), r, m, plan.feedthrough.present);
    throw std::invalid_argument(fmt::format(
        "experiments: {} found, lag order {} with {} inputs and {} outputs needs at least {} ({}{}); {}{}", found, p, r,
        m, needed, plan.feedthrough.present ? "r + p(r+m)" : "p(r+m)", plan.nominal ? " + 1 for the mean motion" : "",
        would_do > 0
            ? fmt::format("{} suffice for lag orders up to {}", found, would_do)
            : fmt::format("too few for any lag order, {} are needed for lag order 1", experiments_for(data, 1, plan)),
        tvera_asked ? "; with smoothing over time, fewer experiments suffice (omit --method tvera)" : ""));
  }
  if (data.steps() < p + 1)
    throw std::invalid_argument(fmt::format("steps: {} found, lag order {} needs at least {}", data.steps(), p, p + 1));
}

// Throws if there are fewer windows than unknowns, because a model then fits any data. Returns the number of windows.
Index checked_windows(const Ensemble& data, const Plan& plan) {
  const Index lags = plan.lags, needed = unknowns_of(data, lags, plan.feedthrough.present),
              whole = whole_windows(data, lags);
  const bool gaps = data.missing() > 0;
  if (whole < needed)
    throw std::invalid_argument(fmt::format(
        "{}: {} of {} successive steps {}, at least {} needed at lag order {}{}", gaps ? "missing samples" : "steps",
        words::plural(whole, "window"), lags + 1, gaps ? "without a gap found" : "found", needed, lags,
        lags > 1 ? "; a smaller lag order needs fewer" : "; EM from a model of other data (refine) needs no windows"));
  return whole;
}

// May a model from this regression be the start of EM?
bool may_start_em(const IdentifyOptions& options) {
  return options.refine.value_or(true) && options.method != Method::regression;
}

// Reports that the chosen order is the largest that was tried, if the data permit `more`.
void report_size_limit(bool more, Index last_tried, const Ensemble& data, Regressed& result) {
  if (!more || result.plan.lags != last_tried) return;
  result.findings.push_back({.kind = Finding::Kind::lags_at_limit,
                             .numbers = {{"lags", double(result.plan.lags)},
                                         {"experiments", double(data.experiments())},
                                         {"unknowns", double(most_regressors)}}});
}

struct LagOrders {
  std::vector<Index> tried;
  bool more;  // the data permit larger ones, which would take too long
};

// Lag orders to choose from. More than half of the steps must remain for the evaluation. The windows without a gap must
// be at least twice as many as the unknowns. Each uncoupled step needs at least one degree of freedom.
LagOrders lag_candidates(const Ensemble& selection, const Ensemble& data, bool nominal, InitialState initial,
                         Index period, const IdentifyOptions& options) {
  if (options.lags) return {{*options.lags}, false};
  const Index needed = least_lags(data, options), first = first_scored(initial, 1, period);
  const bool coupled = period > 0 || options.smoothing != 0.0;
  const bool starts_em = period == 0 && may_start_em(options);
  // A start from few windows leads EM to a wrong maximum.
  const Index windows_each = starts_em && selection.missing() > 0 ? enough_windows : 2;
  const auto unknowns = [&](Index p) { return unknowns_of(data, p, options.feedthrough.value_or(true)); };
  const auto permitted = [&](Index p) {
    return 2 * std::max<Index>(1, first) * p < selection.steps() && p + period <= selection.steps() &&
           whole_windows(selection, p) >= windows_each * unknowns(p) &&
           (coupled || unknowns(p) < effective_experiments(data, nominal));
  };
  LagOrders orders{{}, false};
  for (Index p = 1; p < needed || permitted(p); p = next_of_grid(p)) {
    if (p < needed) continue;
    const bool small = unknowns(p) <= most_regressors && !(starts_em && p > enough_for_em);
    if (!small && !orders.tried.empty()) {
      orders.more = !starts_em;  // EM does not depend on the lag order
      break;
    }
    orders.tried.push_back(p);
  }
  if (orders.tried.empty()) orders.tried.push_back(needed);
  return orders;
}

// Each step has its own regression. This is the method of the paper, and it suffices for data without noise.
Regressed each_step_alone(const Ensemble& data, const Plan& stated, const IdentifyOptions& options) {
  Regressed result;
  result.plan = stated;
  if (options.lags)
    result.plan.lags = *options.lags;
  else
    choose_lags(data, options, result);
  check_size(data, result.plan, options.method == Method::tvera);
  // Unless they are stated, initial states are assumed to be zero if the residuals do not contradict this.
  result.arx = regressions(data, result.plan, in_stage(options.execution, WorkStage::each_step));
  GtvArx& arx = result.arx;
  if (const auto known = stated_initial_state(data, options))
    result.initial_state_test = *known;
  else
    result.initial_state_test = test_initial_state(residuals_of(arx), result.plan.lags);
  result.plan.initial_state = result.initial_state_test.decision;
  // The regressions of the steps k ≥ p hold for any initial state. The regressions of earlier steps do not, so they
  // are dropped.
  if (result.plan.initial_state == InitialState::unknown) arx.begin_at(result.plan.lags);
  result.plan.noisy = survey_of(arx, stated.nominal, 0, arx.steps()).noisy();
  return result;
}

// Of these orders, those up to half of p. Around a jump, p steps have past samples of both sides, and little data
// determine their coefficients. EM does not depend on the lag order, and starts better from fewer lags.
std::vector<Index> half_of(std::vector<Index> orders, Index lags) {
  const Index most = std::max(orders.front(), ceil_div(lags, 2));
  std::erase_if(orders, [&](Index p) { return p > most; });
  return orders;
}

// Chooses λ and p by cross-validation error, or takes the values asked for. `o.lags`: those of `orders`
void choose_variation(const Ensemble& data, const Ensemble& selection, const IdentifyOptions& options,
                      const LagOrders& orders, SmoothingOptions o, Regressed& result) {
  Plan& plan = result.plan;
  TimeVariation& variation = plan.choices.variation;
  plan.lags = o.lags.front();
  if (options.choices) {
    variation = options.choices->variation;
  } else if (selection.experiments() > 1) {
    result.smoothing_choice = choose_smoothing(selection, o);
    const double smoothing = result.smoothing_choice.smoothing;
    if (options.period == 0 && !options.jumps && smoothing > 0 && std::isfinite(smoothing)) {
      result.jumps = find_jumps(selection, o, result.smoothing_choice.lags, smoothing);
      for (const Jump& jump : result.jumps) o.jumps.push_back(jump.step);
    }
    if (!o.jumps.empty()) {
      if (may_start_em(options)) o.lags = half_of(o.lags, result.smoothing_choice.lags);
      result.smoothing_choice = choose_smoothing(selection, o);
    }
    plan.lags = result.smoothing_choice.lags;
    variation.smoothing = result.smoothing_choice.smoothing;
  } else {
    variation.smoothing = options.smoothing.value_or(options.period > 1 ? moderate : 0.0);
    if (!options.smoothing && options.period > 1)
      result.findings.push_back({.kind = Finding::Kind::smoothing_untested, .numbers = {{"smoothing", moderate}}});
  }
  // If few windows have no missing sample, an infinite λ may only mean that they do not determine the variation over
  // time. A large finite λ is then used. EM uses every sample and chooses another λ.
  const bool by_gaps = !options.smoothing && !options.choices && std::isinf(variation.smoothing) &&
                       windows_are_scarce(selection, plan.lags);
  if (by_gaps) variation.smoothing = stiff;
  const auto report = [&] {
    report_size_limit(orders.more, orders.tried.back(), data, result);
    if (by_gaps)
      result.findings.push_back({.kind = Finding::Kind::smoothing_by_gaps, .numbers = {{"smoothing", stiff}}});
  };
  // With jumps the matrices do vary.
  if (!result.jumps.empty() && std::isinf(variation.smoothing)) variation.smoothing = stiff;
  if (!options.choices) variation.period = options.period;
  const bool varies = !std::isinf(variation.smoothing) && options.period != 1;
  // A record that is much longer than its selection determines many lags of one model for all steps.
  const bool questioned = varies && options.period == 0 && !options.smoothing && !options.choices && !options.jumps &&
                          result.jumps.empty() && selection.experiments() > 1 && selection.steps() < data.steps();
  if (varies && !questioned) return report();
  // One regression of all steps has more samples than the regression of one step, so it permits larger lag orders.
  LagOrders constant_orders = orders;
  std::optional<SmoothingChoice> constant;
  if (options.period == 0 && selection.experiments() > 1) {
    o.period = 1;
    constant_orders = lag_candidates(selection, data, plan.nominal, o.initial_state, o.period, options);
    o.lags = constant_orders.tried;
    o.execution = share(in_stage(options.execution, WorkStage::variation), 0.7, 1.0);
    constant = choose_smoothing(selection, o);
    for (SmoothingTrial trial : constant->trials) {
      trial.smoothing = std::numeric_limits<double>::infinity();
      result.smoothing_choice.trials.push_back(trial);
    }
  }
  if (questioned && !(constant->error * clearly_better < result.smoothing_choice.error)) return report();
  if (options.period == 0 && !options.smoothing) result.findings.push_back({.kind = Finding::Kind::no_variation});
  variation = {0.0, 1};
  if (constant) plan.lags = constant->lags;
  report_size_limit(constant_orders.more, constant_orders.tried.back(), data, result);
}

// The regressions that choose_variation() does not reach, and the one that it chose.
std::optional<Rivals> rivals_beside(const Ensemble& data, const Selection& selected, IdentifyOptions options,
                                    SmoothingOptions o, const Plan& plan) {
  const Ensemble& selection = *selected.samples;
  const TimeVariation& variation = plan.choices.variation;
  if (variation.period > 1 || options.choices || selection.experiments() < 2) return std::nullopt;
  const bool stated = options.period > 0 || options.smoothing || options.lags || options.states || options.jumps;
  options.refine = false;
  LagOrders orders = lag_candidates(selection, data, plan.nominal, o.initial_state, 0, options);
  o.lags = std::move(orders.tried);
  if (plan.lags > o.lags.back()) o.lags.push_back(plan.lags);
  return Rivals{o,
                plan.lags,
                variation.period == 1 ? std::numeric_limits<double>::infinity() : variation.smoothing,
                jumps_within(variation.jumps, selected),
                stated,
                orders.more};
}

// Evenly spaced experiments, if there are more samples than the choices need.
Selection with_enough_experiments(Selection selection) {
  const Ensemble& all = *selection.samples;
  const Index N = all.experiments(), enough = most_selection_samples / std::max<Index>(1, all.steps());
  if (N <= enough) return selection;
  std::vector<Index> rows;
  for (Index i = 0; i < enough; ++i) rows.push_back(i * N / enough);
  selection.samples = std::make_shared<Ensemble>(all.subset(rows));
  return selection;
}

// The first steps of a record whose choices are made from steps in its middle or from pieces.
Selection first_steps_of(const Ensemble& data, Index period) {
  const Index steps = period > 0 ? refined_steps(data, period) : most_selection_steps;
  return with_enough_experiments(
      {std::make_shared<Ensemble>(stretch(data, 0, std::min(steps, data.steps()))), 0, true});
}

// One regression couples all steps.
Regressed coupled(const Ensemble& data, const Selection& selected, const Plan& stated, const IdentifyOptions& options) {
  const std::optional<InitialStateTest> known = stated_initial_state(data, options);
  const Ensemble& selection = *selected.samples;
  if (const Index most = selection.steps() / 2; !options.choices && options.horizons != IdentifyOptions{}.horizons &&
                                                options.horizons.back() > std::max<Index>(1, most))
    throw std::invalid_argument(
        fmt::format("horizons: {} steps found, at most {} needed, which is half of the {} steps that the choices use",
                    options.horizons.back(), most, selection.steps()));
  const bool nominal = stated.nominal;
  Regressed result;
  Plan& plan = result.plan = stated;
  plan.coupled = true;
  plan.nominal_period = nominal ? options.period : 0;
  SmoothingOptions o;
  o.period = options.period;
  o.feedthrough = plan.feedthrough.present;
  o.initial_state = known && selected.from_start ? known->decision : InitialState::unknown;
  const LagOrders orders = lag_candidates(selection, data, nominal, o.initial_state, o.period, options);
  o.lags = orders.tried;
  o.smoothing = options.smoothing;
  o.centred = is_centred(plan);
  o.output_weights = plan.output_weights;
  o.execution = share(in_stage(options.execution, WorkStage::variation), 0.0, 0.7);
  const Index regressors = unknowns_of(data, o.lags.back(), plan.feedthrough.present);
  o.folds = regressors > 100 ? 3 : fold_count(selection.experiments());
  o.steps = std::clamp<Index>(Index{256} * 60 * 60 / (regressors * regressors), 64, 256);
  if (o.lags.back() >= selection.steps())
    throw std::invalid_argument(fmt::format("steps: {} found, lag order {} needs at least {}", selection.steps(),
                                            o.lags.back(), o.lags.back() + 1));
  if (options.jumps) {
    for (const Index step : *options.jumps) result.jumps.push_back({step});
    o.jumps = jumps_within(*options.jumps, selected);
  }
  choose_variation(data, selection, options, orders, o, result);
  if (!options.choices) {
    // Regressions show a jump of A_k and B_k one step late, because these affect no output before step k+1. Until EM
    // tells, a found jump may also be one step earlier.
    std::vector<Index>& steps = plan.choices.variation.jumps;
    for (Jump& jump : result.jumps) {
      if (!options.jumps) jump.step += selected.begin;
      if (!options.jumps && jump.step > 1 && (steps.empty() || steps.back() < jump.step - 1))
        steps.push_back(jump.step - 1);
      steps.push_back(jump.step);
    }
  }
  result.rivals = rivals_beside(data, selected, options, o, plan);

  const Index whole = checked_windows(data, plan), unknowns = unknowns_of(data, plan.lags, plan.feedthrough.present);
  if (whole < 2 * unknowns)
    result.findings.push_back({.kind = Finding::Kind::few_windows,
                               .numbers = {{"windows", double(whole)},
                                           {"length", double(plan.lags + 1)},
                                           {"gaps", data.missing() > 0},
                                           {"unknowns", double(unknowns)},
                                           {"lags", double(plan.lags)}}});
  const TimeVariation& variation = plan.choices.variation;
  if (variation.period == 0 && variation.smoothing == 0) {
    const RegressionSizes sizes{data.experiments(), effective_experiments(data, nominal),
                                data.inputs(),      data.outputs(),
                                plan.lags,          plan.feedthrough.present};
    RegressionSurvey survey;
    survey.freedom = std::max<Index>(0, sizes.effective_experiments - unknowns);
    append(result.findings, findings_of(survey, sizes, true));
  }

  const Execution execution = in_stage(options.execution, WorkStage::together);
  if (known) {
    result.initial_state_test = *known;
  } else if (data.experiments() < 2) {
    result.initial_state_test = {.threshold = std::numeric_limits<double>::infinity(),
                                 .decision = InitialState::unknown,
                                 .reason = "not stated with the data"};
  } else {
    const Selection first = selected.from_start ? selected : first_steps_of(data, options.period);
    SmoothArxOptions from_rest{plan.lags, InitialState::zero, plan.feedthrough.present, variation,
                               share(execution, 0.0, 0.5)};
    from_rest.variation.jumps = jumps_within(variation.jumps, first);
    result.initial_state_test = test_initial_state(held_out_errors(*first.samples, from_rest, o.centred), plan.lags);
  }
  plan.initial_state = result.initial_state_test.decision;
  result.arx = regressions(data, plan, share(execution, 0.5, 1.0));

  const RegressionSurvey survey = survey_of(result.arx, nominal, 0, result.arx.steps());
  // With as many unknowns as windows there is no residual, so the data may be noisy.
  const Index models = variation.smoothing > 0 ? 1 : variation.groups(data.steps());
  plan.noisy = survey.noisy() || whole <= models * (unknowns + data.outputs());
  return result;
}

// The regressions with the feedthrough that is stated, or with feedthrough.
Regressed with_stated_feedthrough(const Ensemble& data, const Selection& selection, bool nominal,
                                  const IdentifyOptions& options) {
  const Index needed = options.lags.value_or(least_lags(data, options));
  Plan stated;
  stated.nominal = nominal;
  stated.feedthrough.present = options.feedthrough.value_or(true);
  stated.output_weights = relative_weights(options.output_weights, data.outputs());
  const bool asked = options.method == Method::tvera, together = options.period > 0 || options.smoothing > 0.0;
  if (!asked && (together || data.experiments() < experiments_for(data, needed, stated)))
    return coupled(data, selection, stated, options);
  Regressed alone = each_step_alone(data, stated, options);
  const bool free = std::any_of(alone.arx.step.begin(), alone.arx.step.end(),
                                [](const GtvArxStep& step) { return step.freedom > 0; });
  // Regressions without degrees of freedom fit any data exactly. Such data count as free of noise only if no sample is
  // missing and the user stated p or n.
  const bool tells = free || (data.missing() == 0 && (options.lags || options.states));
  if (asked || (!alone.plan.noisy && tells)) return alone;
  // With noise, coupled steps give better models. They permit more lags, so they test the initial state again: too few
  // lags leave larger residuals at all steps, among which those of an initial state do not show.
  return coupled(data, selection, stated, options);
}

}  // namespace

Regressed regressed(const Ensemble& data, const Selection& selection, bool nominal, const IdentifyOptions& options) {
  Regressed result = with_stated_feedthrough(data, selection, nominal, options);
  if (options.feedthrough) return result;
  result.plan.feedthrough =
      choose_feedthrough(*selection.samples, result.plan, in_stage(options.execution, WorkStage::feedthrough));
  if (!result.plan.feedthrough.present) result.arx = regressions(data, result.plan, {options.execution.threads, {}});
  if (result.rivals) result.rivals->options.feedthrough = result.plan.feedthrough.present;
  append(result.findings, findings_of(result.plan.feedthrough, data.names));
  return result;
}

Regressed regressed_as(const RegressionErrors::Found& rival, const Rivals& rivals, const Ensemble& data,
                       const Selection& selection, bool nominal, const IdentifyOptions& options) {
  IdentifyOptions stated = options;
  stated.lags = rival.lags;
  stated.smoothing = rival.smoothing;
  stated.jumps = std::vector<Index>{};
  Regressed result = regressed(data, selection, nominal, stated);
  if (std::isinf(rival.smoothing)) result.findings.push_back({.kind = Finding::Kind::no_variation});
  report_size_limit(rivals.more_lags, rivals.options.lags.back(), data, result);
  return result;
}

GtvArx regressed_as(const Ensemble& data, const Plan& plan, const Execution& execution) {
  if (plan.coupled)
    checked_windows(data, plan);
  else
    check_size(data, plan, plan.method == Method::tvera);
  return regressions(data, plan, execution);
}

Selection selection_samples(const Ensemble& data, const IdentifyOptions& options) {
  const Index period = options.period, pieces = ceil_div(5, data.experiments()), steps = data.steps();
  if (period == 0 && steps > 2 * most_selection_steps) {
    const Index begin = (steps - most_selection_steps) / 2;
    return with_enough_experiments(
        {std::make_shared<Ensemble>(stretch(data, begin, begin + most_selection_steps)), begin, false});
  }
  if (period > 0 && pieces > 1 && steps / pieces >= 2 * std::max(period, options.lags.value_or(0)))
    return {std::make_shared<Ensemble>(cut(data, steps / pieces / period * period)), 0, false};
  const Selection all{{std::shared_ptr<const Ensemble>(), &data}};
  return period == 0 ? with_enough_experiments(all) : all;
}

std::vector<Index> jumps_within(const std::vector<Index>& jumps, const Selection& selection) {
  std::vector<Index> result;
  for (const Index step : jumps)
    if (step > selection.begin && step < selection.begin + selection.samples->steps())
      result.push_back(step - selection.begin);
  return result;
}

bool windows_are_scarce(const Ensemble& data, Index lags) {
  constexpr double enough = 0.5;
  return data.missing() > 0 &&
         double(whole_windows(data, lags)) < enough * double(data.experiments() * (data.steps() - lags));
}

Index experiments_for(const Ensemble& data, Index lags, const Plan& plan) {
  return unknowns_of(data, lags, plan.feedthrough.present) + (plan.nominal ? 1 : 0);
}

}  // namespace tokid
