// SPDX-License-Identifier: BSD-3-Clause
#include "choose/realisation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "base/nan.hpp"
#include "choose/first_steps.hpp"
#include "choose/folds.hpp"
#include "choose/stages.hpp"
#include "data/channel_sizes.hpp"
#include "data/output_weights.hpp"
#include "noise/observer_form.hpp"
#include "tokid/em.hpp"
#include "tokid/markov.hpp"

namespace tokid {

namespace {

// Above this ratio of errors to what the model says, several steps ahead, controllers designed on a model may be bad.
constexpr double surely_ahead = 1.5;
// Or above this share of the variance of these errors that comes from the model.
constexpr double much_of_model = 0.375;

// Number of orders of TVERA that are tried after the best order so far.
constexpr Index patience = 4;
// Most experiments from which the order of TVERA is chosen.
constexpr Index most_scored = 64;
// A refined model may not increase an error by more than this factor.
constexpr double tolerated = 1.1;
// EM goes on while the one-step error of all experiments exceeds that of the held-out ones by this factor.
constexpr double as_expected = 1.02;
// In a record so many times longer than the samples of the choices, regressions determine one model for all steps as
// well as EM does, and EM is not tried unless it is asked for.
constexpr Index enough_without_em = 8;
// For the progress: iterations of one fold in a search, and how many of them take as long as one with all experiments.
constexpr double usual_iterations = 1500.0, fold_iterations = 1.5;

// Takes the choices about the realisation from the options. The other choices are made later, from the data.
Plan as_asked(const Ensemble& data, Plan plan, const IdentifyOptions& o) {
  plan.method = o.method.value_or(automatic_method(plan));
  plan.states = o.states.value_or(0);
  plan.rows = o.rows, plan.cols = o.cols;
  plan.frame = o.frame, plan.reference_step = o.reference_step;
  plan.choices.weighting = o.weighting.value_or(Weighting::one_step);
  plan.choices.state_smoothing = SubspaceOptions::state_share * plan.choices.variation.smoothing;
  if (plan.method == Method::tvera) {
    plan.output_size = channel_sizes(data, data.inputs(), data.outputs());
    plan.input_size = channel_sizes(data, 0, data.inputs());
  }
  return plan;
}

// The predictions that count in these data. Before `from`, the observers have not settled.
Ahead ahead_of(const Plan& plan, const Ensemble& data, const IdentifyOptions& options) {
  const Index period = plan.choices.variation.period;
  return ahead_in(data, first_scored(plan.initial_state, plan.lags, period), options.horizons, period);
}

// `like`: as in squares_of()
HeldOutError error_of(const Predicted& predicted, const Ensemble& data, const Ahead& ahead, const Plan& plan,
                      const Predicted* like = nullptr) {
  return held_out_error(squares_of(predicted, data, ahead, like), weights_of(plan.output_weights, data.outputs()));
}

// Singular values of noisy data show no rank. The errors of predictions choose the order instead.
OrderScores score_orders(const Ensemble& data, const GtvArx& arx, const Markov& parameters,
                         const HankelFactors& factors, TveraOptions o, const Plan& plan,
                         const IdentifyOptions& options) {
  OrderScores scores;
  std::optional<Ensemble> fewer;
  if (data.experiments() > most_scored) {
    std::vector<Index> rows;
    for (Index n = 0; n < most_scored; ++n) rows.push_back(n * data.experiments() / most_scored);
    fewer = data.subset(rows);
  }
  const Ensemble& scored = fewer ? *fewer : data;
  // The training error of an order is too small, by about the number of its coefficients divided by the number of
  // samples.
  scores.price = 2.0 / 3 * double(data.channels()) / double(data.outputs() * data.experiments());
  const Index most = std::min(plan.lags * data.outputs(), o.cols * data.inputs());
  const Ahead ahead = ahead_of(plan, scored, options);
  scores.horizons = ahead.horizons;
  Index best = 0;
  for (Index n = 1; n <= most; ++n) {
    o.states = n;
    Model model = completed(realise(parameters, factors, o), data, arx, plan);
    if (model.steps() == 0 || model.states() < n) break;
    const Predicted predicted = predicted_by(std::move(model), scored, plan.initial_state, ahead);
    scores.add(n, error_of(predicted, scored, ahead, plan).of_horizon);
    if (scores.mean(scores.states.size() - 1) <= scores.smallest) best = n;
    if (n >= best + patience) break;
  }
  scores.choose();
  return scores;
}

// TVERA with the order that has the smallest corrected training error. One factorisation of H_k is used for all orders.
void realise_in_scored_order(const Ensemble& data, GtvArx arx, const IdentifyOptions& options, Realised& result) {
  const Execution execution = in_stage(options.execution, WorkStage::realisation);
  Plan& plan = result.plan;
  TveraOptions o = tvera_options(plan, data.outputs());
  const Markov parameters = markov(arx, o.rows + o.cols - 1, share(execution, 0.0, 0.5));
  arx.forget_noise_shapes();
  o.execution = share(execution, 0.5, 1.0);
  const HankelFactors factors = hankel_factors(parameters, data.free, o);
  o.execution.progress = {};
  result.order_scores = score_orders(data, arx, parameters, factors, o, plan, options);
  plan.states = o.states = result.order_scores.best;
  result.model = completed(realise(parameters, factors, o), data, arx, plan);
}

RefineOptions refine_options(const Plan& plan, const Execution& execution) {
  RefineOptions o;
  o.smoothing = plan.choices.refinement_smoothing;
  o.period = plan.choices.variation.period;
  o.initial_state = plan.initial_state;
  o.feedthrough = plan.feedthrough.present;
  o.jumps = plan.choices.variation.jumps;
  o.execution = execution;
  return o;
}

// The weightings to choose from. Projection needs many windows of 2p steps: more than the number of samples in one
// window.
std::vector<Weighting> weightings(const Ensemble& selection, const Plan& plan, const IdentifyOptions& options) {
  if (options.weighting) return {*options.weighting};
  std::vector<Weighting> result = {Weighting::one_step};
  const Index period = plan.choices.variation.period, p = plan.lags;
  if (period == 0) return result;
  result.push_back(Weighting::many_steps);
  const Index windows = selection.steps() - 2 * p - period + 1;
  if (windows > 0 && selection.experiments() * windows / period > 2 * p * selection.channels())
    result.push_back(Weighting::projection);
  return result;
}

struct Refined {
  Model model;
  HeldOutError errors;  // of the training data
  Index iterations = 0;
};

// EM with the iterations of the plan. A mode may need more iterations to grow out of a saddle of the likelihood than on
// the folds. EM therefore goes on while its one-step error is larger than `expected`. If the folds stopped early, it
// goes on only if the result would not be accepted. Of results that stay larger, the best one is returned.
Refined refined_by(const Plan& plan, const Ensemble& data, const Model& begun, const Ahead& ahead,
                   const Predicted& like, double expected, const Execution& execution) {
  RefineOptions options = refine_options(plan, execution);
  const auto after = [&](const Model& model, Index from, Index to) {
    Refined result{refined(model, data, from, to, options), {}, to};
    result.errors = error_of(predicted_by(result.model, data, plan.initial_state, ahead), data, ahead, plan, &like);
    return result;
  };
  const Index planned = plan.choices.refinement_iterations;
  Refined now = after(begun, 0, planned), best = now;
  if (plan.choices.variation.period > 0) return best;
  const double limit = expected + std::log(stopped_early(planned, options) ? tolerated : as_expected);
  while (now.errors.of_horizon(0) > limit && now.iterations < most_iterations) {
    now = after(now.model, now.iterations, next_stage_end(now.iterations));
    if (now.errors.of_horizon(0) < best.errors.of_horizon(0) && now.errors.value < best.errors.value) best = now;
  }
  return now.errors.of_horizon(0) > limit ? best : now;
}

// EM on all experiments may converge to another model than EM on the folds. If so, its one-step error on the training
// data may exceed the cross-validation error. Such a model is used only if its errors are clearly smaller than before
// EM. EM minimises one-step errors only. If steps share a model, its errors over many steps must therefore not increase
// either.
void refine_if_better(const Ensemble& data, const GtvArx& arx, const RefinementChoice& choice,
                      const IdentifyOptions& options, const Execution& execution, Realised& result) {
  const Plan plain = result.plan;
  const Index period = plain.choices.variation.period;
  const double allowed = std::log(tolerated);
  const Ahead ahead = ahead_of(plain, data, options);
  const Predicted start = predicted_by(result.model, data, plain.initial_state, ahead);
  const HeldOutError before = error_of(start, data, ahead, plain);
  result.refinement = choice;

  // EM starts from the subspace model, as in cross-validation. If this result is not accepted, EM starts from the
  // subspace model with the λ of EM.
  std::vector<double> starts{plain.choices.state_smoothing};
  if (plain.choices.state_smoothing != choice.smoothing) starts.push_back(choice.smoothing);
  bool one_step = true;
  HeldOutError best = before;
  std::optional<std::pair<Model, Plan>> fallback;
  for (const double smoothing : starts) {
    Plan plan = plain;
    plan.states = choice.states;
    plan.choices.state_smoothing = smoothing;
    plan.choices.refinement_smoothing = choice.smoothing;
    plan.choices.refinement_iterations = choice.iterations;
    Refined found;
    try {
      const Model begun = realise(data, arx, {}, plan, {execution.threads, {}});
      found = refined_by(plan, data, begun, ahead, start, choice.one_step, execution);
    } catch (const std::runtime_error&) {
      continue;  // EM failed from this start
    }
    const HeldOutError& after = found.errors;
    plan.choices.refinement_iterations = found.iterations;
    const Index beyond = after.of_horizon.size() - 1;
    const bool longer = ((after.of_horizon - before.of_horizon).tail(beyond).array() <= allowed).all();
    one_step = after.of_horizon(0) <= choice.one_step + allowed;
    if (!longer && period > 0) continue;
    // A part of the samples may determine a model worse than all of them.
    if (refined_steps(data, period) < data.steps() && !(after.value < before.value)) continue;
    if (one_step) {
      result.refinement.iterations = found.iterations;
      result.model = std::move(found.model);
      result.plan = std::move(plan);
      return;
    }
    if (after.of_horizon(0) < best.of_horizon(0) && after.value < best.value - allowed) {
      best = after;
      fallback.emplace(std::move(found.model), std::move(plan));
    }
  }
  if (fallback) {
    result.findings.push_back({.kind = Finding::Kind::em_unreliable});
    std::tie(result.model, result.plan) = std::move(*fallback);
    result.refinement.iterations = result.plan.choices.refinement_iterations;
    return;
  }
  result.findings.push_back({.kind = one_step ? Finding::Kind::em_worse_ahead : Finding::Kind::em_worse_one_step});
  result.plan.choices.refinement_smoothing = choice.smoothing;
  result.refinement.iterations = 0;
  result.refinement.ahead = choice.ahead_without_em;
  result.refinement.states = result.order_scores.best;
  result.refinement.error = choice.trials.front().error;
}

// Is EM to be tried?
bool tries_em(const Ensemble& data, const Selection& selected, const Plan& plan, const IdentifyOptions& options) {
  const bool found_constant = options.period == 0 && plan.choices.variation.period == 1;
  return options.refine.value_or(!found_constant || data.steps() < enough_without_em * selected.samples->steps());
}

// A subspace realisation, by cross-validation errors.
struct BegunByFolds {
  Folds folds;
  Plan plan;
  OrderScores scores;
  Model model;                  // of all data
  std::vector<Model> of_folds;  // empty if no state predicts

  std::vector<Squares> squares(const Ahead& ahead) const { return folds.squares(of_folds, ahead); }
  std::vector<Model> with_states(Index n) const { return n == scores.best ? of_folds : folds.models_of(scores, n); }
};

// Its EM, if that was tried.
struct ChosenByFolds {
  Model start;  // of all data, without EM
  std::optional<RefinementOfFolds> refinement;
};

TimeVariation of_selection(TimeVariation variation, const Selection& selection) {
  variation.jumps = jumps_within(variation.jumps, selection);
  return variation;
}

// The found jumps, at the steps that the model uses: before EM, a jump may also be one step earlier.
std::vector<Jump> used_jumps(const std::vector<Jump>& found, const std::vector<Index>& used) {
  std::vector<Jump> result;
  for (const Index step : used)
    for (const Jump& jump : found)
      if (step == jump.step || (step == jump.step - 1 && jump.loss)) {
        result.push_back({step, jump.loss});
        break;
      }
  return result;
}

BegunByFolds begun_by_folds(const Ensemble& data, const Selection& selected, const Plan& decided, const GtvArx& arx,
                            const IdentifyOptions& options) {
  const Ensemble& selection = *selected.samples;
  BegunByFolds result{
      Folds(selection, {.lags = decided.lags,
                        .initial_state = selected.from_start ? decided.initial_state : InitialState::unknown,
                        .feedthrough = decided.feedthrough.present,
                        .variation = of_selection(decided.choices.variation, selected),
                        .weightings = weightings(selection, decided, options),
                        .centred = is_centred(decided),
                        .output_weights = decided.output_weights,
                        .horizons = options.horizons,
                        .execution = in_stage(options.execution, WorkStage::folds)}),
      decided,
      {},
      {},
      {}};
  Plan& plan = result.plan;
  result.scores = result.folds.choose_states(options.states, plan.lags * data.outputs(),
                                             in_stage(options.execution, WorkStage::states));
  plan.choices.state_smoothing = result.scores.smoothing;
  plan.choices.weighting = result.scores.weighting;
  if (!options.states) plan.states = result.scores.best;
  result.model = realise(data, arx, {}, plan, in_stage(options.execution, WorkStage::realisation));
  if (result.scores.best > 0) result.of_folds = result.folds.models_of(result.scores, result.scores.best);
  return result;
}

ChosenByFolds chosen_by_folds(const BegunByFolds& begun, const Ensemble& data, const Selection& selected,
                              const IdentifyOptions& options, const BeforeEm& before_em, SearchProgress& work) {
  const Plan& plan = begun.plan;
  const Index n = begun.model.states();
  ChosenByFolds result{begun.model, {}};
  if (!tries_em(data, selected, plan, options) || n == 0 || n < plan.states) return result;
  result.start = with_first_steps(result.start, data, plan.initial_state, options.execution.threads);
  // A stated λ is the λ of the ARX model, not of EM. Only a stated λ of 0 is also the λ of EM.
  const std::optional<double> stated = options.smoothing == 0.0 ? options.smoothing : std::nullopt;
  if (before_em) before_em(result.start, plan);
  RefinementSettings settings = begun.folds.refinement_settings();
  settings.stated = stated;
  const auto starts = [&](Index states) { return begun.with_states(states); };
  result.refinement = choose_refinement(plan.states, begun.folds.from_first_step(starts(plan.states)), !options.states,
                                        starts, settings, work);
  return result;
}

// The model of all data with these choices.
void realise_by_folds(const Ensemble& data, const Selection& selected, const GtvArx& arx, const BegunByFolds& begun,
                      ChosenByFolds chosen, const IdentifyOptions& options, SearchProgress& work, Realised& result) {
  Plan& plan = result.plan = begun.plan;
  result.order_scores = begun.scores;
  result.model = std::move(chosen.start);
  if (!chosen.refinement) return;
  RefinementChoice& choice = chosen.refinement->choice;
  if (choice.iterations > 0) {
    if (!options.jumps) {
      plan.choices.variation.jumps.clear();
      for (const Jump& jump : choice.jumps) plan.choices.variation.jumps.push_back(selected.begin + jump.step);
    }
    work.begin("all experiments");
    refine_if_better(data, arx, choice, options, {options.execution.threads, work.counted(fold_iterations)}, result);
  } else {
    plan.choices.refinement_smoothing = choice.smoothing;
    result.refinement = std::move(choice);
  }
  if (const double ratio = result.refinement.ahead.ratio; ratio > surely_ahead)
    result.findings.push_back({.kind = Finding::Kind::uncertain_ahead,
                               .numbers = {{"ratio", ratio}, {"horizon", double(AheadCertainty::horizon)}}});
  if (const double share = result.refinement.ahead.model_share; share > much_of_model)
    result.findings.push_back({.kind = Finding::Kind::model_errs_ahead,
                               .numbers = {{"share", share}, {"horizon", double(AheadCertainty::horizon)}}});
}

// Regressions use only windows without a gap, and EM uses every sample.
bool may_keep_regression(const Ensemble& data, const IdentifyOptions& options) {
  const bool jumps = options.jumps && !options.jumps->empty();
  return !options.method && !options.weighting && !options.refine.value_or(false) && !options.states && !jumps &&
         data.missing() == 0;
}

RegressionComparison comparison_of(const RegressionErrors& errors, const Squares& of_model,
                                   const RegressionErrors::Found& regression) {
  const Ahead& ahead = errors.ahead();
  return {ahead.horizons,
          of_model.errors.rows(),
          ahead.from,
          errors.at_horizons(of_model),
          errors.at_horizons(regression.squares),
          regression.lags,
          regression.smoothing};
}

Model of_regression(const Ensemble& data, const GtvArx& arx, const Plan& plan, const Execution& execution) {
  return plan.initial_state == InitialState::unknown && plan.choices.variation.period == 0
             ? observer_form_from_start(
                   data, arx,
                   {plan.lags, plan.initial_state, plan.feedthrough.present, plan.choices.variation, execution})
             : realise(data, arx, {}, plan, execution);
}

// The model of all data is the regression itself. From unknown initial states, the first steps need regressions of
// their own, so that not all steps share their matrices, even if nothing varies.
void keep_regression(const Ensemble& data, Regressed& regression, OrderScores scores, const IdentifyOptions& options,
                     Realised& result) {
  TimeVariation& variation = regression.plan.choices.variation;
  if (variation.period == 1 && options.period == 0 && regression.plan.initial_state == InitialState::unknown) {
    variation = {std::numeric_limits<double>::infinity(), 0};
    regression.arx = regressions(data, regression.plan, {options.execution.threads, {}});
  }
  result.plan = as_asked(data, regression.plan, options);
  result.plan.method = Method::regression;
  result.order_scores = std::move(scores);
  result.model = of_regression(data, regression.arx, result.plan, in_stage(options.execution, WorkStage::realisation));
  result.findings.push_back(
      {.kind = Finding::Kind::regression_kept,
       .numbers = {{"lags", double(result.plan.lags)}, {"states", double(result.model.states())}}});
}

// The result of a call, if the samples suffice for it.
template <class Call>
auto if_possible(Call&& call) -> std::optional<decltype(call())> {
  try {
    return call();
  } catch (const std::runtime_error&) {
  } catch (const std::invalid_argument&) {
  }
  return std::nullopt;
}

// A subspace realisation, its EM, and the errors of both.
struct Candidate {
  BegunByFolds begun;
  std::vector<Squares> of_start, of_model;
  std::optional<ChosenByFolds> chosen = {};

  bool refined() const { return chosen && chosen->refinement && chosen->refinement->choice.iterations > 0; }
};

// Subspace realisation and EM. If another regression predicts surely better than the chosen one, and than the result or
// where EM brings nothing, its p and λ are tried, too, and used if that predicts surely better. A regression that
// predicts surely better than this is the model itself. It is the model without any EM if the realisations with both p
// and λ predict far worse.
void realise_by_folds(const Ensemble& data, const Selection& selected, Regressed& regression,
                      const IdentifyOptions& options, const BeforeEm& before_em, Realised& result) {
  SearchProgress work(in_stage(options.execution, WorkStage::em), usual_iterations);
  BegunByFolds begun = begun_by_folds(data, selected, result.plan, regression.arx, options);
  const std::optional<Rivals> rivals = regression.rivals;
  if (!rivals || begun.scores.best == 0)
    return realise_by_folds(data, selected, regression.arx, begun,
                            chosen_by_folds(begun, data, selected, options, before_em, work), options, work, result);
  const RegressionErrors errors(*selected.samples, rivals->options, Folds::validating(selected.samples->experiments()),
                                options.horizons);
  const Ahead& ahead = errors.ahead();
  const auto candidate = [&](BegunByFolds by) {
    std::vector<Squares> squares = by.squares(ahead);
    return Candidate{std::move(by), squares, squares};
  };
  const auto choose = [&](Candidate& c, const BeforeEm& before) {
    c.chosen = chosen_by_folds(c.begun, data, selected, options, before, work);
    if (c.chosen->refinement) c.of_model = c.begun.folds.squares(c.chosen->refinement->models, ahead);
  };
  Candidate own = candidate(std::move(begun));
  // Another regression counts only if it is surely better than the chosen one. Of many that are tried, one seems better
  // by chance.
  const RegressionErrors::Found regressed = errors.found(rivals->lags, rivals->smoothing, rivals->jumps),
                                best_found = best_regression(*rivals, errors, regressed, own.of_start);
  const bool rival_leads = surely_smaller(best_found.error, regressed.error);
  const RegressionErrors::Found& leader = rival_leads ? best_found : regressed;
  std::optional<Regressed> of_leader;
  std::optional<Candidate> other;
  const auto begin_other = [&] {
    if (!other)
      other = if_possible([&] {
        of_leader = regressed_as(leader, *rivals, data, selected, regression.plan.nominal, options);
        return candidate(
            begun_by_folds(data, selected, as_asked(data, of_leader->plan, options), of_leader->arx, options));
      });
    return other.has_value();
  };
  std::optional<bool> holds;
  const auto may_keep = [&] {
    if (!may_keep_regression(data, options) || (rival_leads && !begin_other())) return false;
    if (!holds) holds = holds_with_nearly_all(leader, errors, *selected.samples, rivals->options);
    return *holds;
  };
  const auto keep = [&] {
    result.instead = rival_leads;
    if (rival_leads) regression = std::move(*of_leader);
    keep_regression(data, regression, rival_leads ? other->begun.scores : own.begun.scores, options, result);
    result.comparison = comparison_of(errors, leader.squares, leader);
  };
  const auto far_worse = [&](const Candidate& c) {
    return c.of_start.empty() || far_smaller(leader.error, errors.error_of(c.of_start));
  };
  const auto leads = [&](const Candidate& c) { return surely_smaller(leader.error, errors.error_of(c.of_model)); };
  if (far_worse(own) && may_keep() && (!rival_leads || far_worse(*other))) return keep();

  choose(own, before_em);
  // From unknown initial states, steps that share one regression can't predict the first outputs.
  const bool late = options.period > 0 && regression.plan.initial_state == InitialState::unknown,
             keeps = own.chosen->refinement && !late && leads(own) && may_keep();
  // From a start that is far worse, EM would not make the model better than the regression. From one of nearly as many
  // states, it takes long and makes the model hardly simpler.
  const auto hopeless = [&] {
    return far_worse(*other) || 2 * other->begun.scores.best > leader.lags * data.outputs();
  };
  if (rival_leads && (leads(own) || !own.refined()) && begin_other() && !other->of_start.empty() &&
      !(keeps && hopeless())) {
    const bool found = if_possible([&] { return choose(*other, {}), true; }).has_value();
    result.instead = found && surely_smaller(errors.error_of(other->of_model), errors.error_of(own.of_model));
  }
  const Candidate& best = result.instead ? *other : own;
  if (keeps && leads(best)) return keep();
  if (result.instead) regression = std::move(*of_leader);
  realise_by_folds(data, selected, regression.arx, best.begun, *best.chosen, options, work, result);
  const bool refined = result.plan.choices.refinement_iterations > 0;
  result.comparison = comparison_of(errors, joined(refined ? best.of_model : best.of_start), leader);
}

}  // namespace

Method automatic_method(const Plan& plan) {
  if (plan.method == Method::regression) return plan.method;
  const bool exact = !plan.noisy && plan.initial_state == InitialState::zero && !plan.coupled;
  return exact ? Method::tvera : Method::subspace;
}

Realised realised(Ensemble&& data, const Selection& selection, Regressed& regression, const IdentifyOptions& options,
                  const BeforeEm& before_em) {
  const Plan plan = regression.plan;
  GtvArx& arx = regression.arx;
  Realised result;
  result.plan = as_asked(data, plan, options);
  const Execution execution = in_stage(options.execution, WorkStage::realisation);
  if (result.plan.method == Method::tvera) {
    if (plan.noisy && !options.states) {
      realise_in_scored_order(data, std::move(arx), options, result);
    } else {
      data = data.subset({});
      result.model = realise(data, std::move(arx), data.free, result.plan, execution);
    }
  } else if (result.plan.method == Method::regression) {
    result.model = of_regression(data, arx, result.plan, execution);
  } else if (options.choices && plan.coupled) {
    const TimeVariation variation = plan.choices.variation;
    result.plan.choices = *options.choices;
    result.plan.choices.variation = variation;
    result.refinement.smoothing = result.plan.choices.refinement_smoothing;
    result.refinement.iterations = result.plan.choices.refinement_iterations;
    result.model = realised_as(data, std::move(arx), result.plan, in_stage(options.execution, WorkStage::em));
  } else if (plan.noisy && plan.coupled && selection.samples->experiments() > 1) {
    realise_by_folds(data, selection, regression, options, before_em, result);
  } else {
    result.model = realise(data, std::move(arx), {}, result.plan, execution);
  }
  result.refinement.jumps = used_jumps(regression.jumps, result.plan.choices.variation.jumps);
  const bool refined = result.plan.choices.refinement_iterations > 0;
  if (!refined && plan.noisy && result.plan.method == Method::subspace && options.refine.value_or(true))
    result.model = with_first_steps(result.model, data, result.plan.initial_state, options.execution.threads);
  return result;
}

Model realised_as(const Ensemble& data, GtvArx arx, const Plan& plan, const Execution& execution) {
  constexpr double until_em = 0.1;  // share of the work
  const Index iterations = plan.choices.refinement_iterations;
  Model model = realise(data, std::move(arx), data.free, plan, share(execution, 0.0, iterations > 0 ? until_em : 1.0));
  if (iterations == 0) return model;
  RefineOptions options = refine_options(plan, execution);
  double done = 0.0;
  if (execution.progress)
    options.execution.progress = [&, report = share(execution, until_em, 1.0).progress](const ProgressReport&) {
      report({.share = std::min(1.0, ++done / double(iterations))});
    };
  return refined(std::move(model), data, 0, iterations, options);
}

}  // namespace tokid
