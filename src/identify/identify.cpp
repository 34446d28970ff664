// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <memory>
#include <stdexcept>

#include "base/integers.hpp"
#include "base/statistics.hpp"
#include "base/words.hpp"
#include "choose/constant.hpp"
#include "choose/realisation.hpp"
#include "choose/stages.hpp"
#include "data/axes.hpp"
#include "data/check.hpp"
#include "data/extents.hpp"
#include "data/rows.hpp"
#include "data/unused.hpp"
#include "diagnose/excitation.hpp"
#include "diagnose/model_states.hpp"
#include "diagnose/recording.hpp"
#include "diagnose/regressions.hpp"
#include "diagnose/repeats.hpp"
#include "diagnose/samples.hpp"
#include "identify/examine.hpp"
#include "identify/identify.hpp"
#include "identify/prepare.hpp"
#include "model/comparison.hpp"
#include "model/input_delays.hpp"
#include "model/options.hpp"
#include "model/outlying_samples.hpp"
#include "tokid/remarks.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace {

// Checks the options against this ensemble.
void check_jumps(const Ensemble& data, const IdentifyOptions& options) {
  const Index last = options.jumps->back();
  if (last >= data.steps())
    throw std::invalid_argument(
        fmt::format("jumps: {} found, steps from 1 to {} needed", last, std::max<Index>(1, data.steps() - 1)));
  if (options.period > 0)
    throw std::invalid_argument("jumps: steps found, but the steps of a period share a model. State no period");
  if (options.smoothing && std::isinf(*options.smoothing))
    throw std::invalid_argument("jumps: steps found, but one model serves all steps. State a finite smoothing");
  if (options.method == Method::tvera)
    throw std::invalid_argument("jumps: steps found, but each step has its own matrices. Use method subspace");
}

void check_method(const Ensemble& data, const IdentifyOptions& options) {
  const bool tvera = options.method == Method::tvera;
  if (tvera && options.period > 0)
    throw std::invalid_argument("method: tvera found, subspace needed to pool the steps of a period");
  if (tvera && options.smoothing > 0.0)
    throw std::invalid_argument("method: tvera found, subspace needed for regularisation over time");
  if (tvera && options.weighting) throw std::invalid_argument("method: tvera found, subspace needed for a weighting");
  if (tvera && options.refine.value_or(false))
    throw std::invalid_argument(
        "method: tvera found, subspace needed for the refinement of an identification; refine() refines any model");
  if (options.method == Method::regression) {
    if (options.states)
      throw std::invalid_argument("states: found, but the method regression has all states of the regression");
    if (options.weighting || options.refine.value_or(false))
      throw std::invalid_argument("method: regression found, subspace needed for a weighting or the refinement");
  }
  if (options.jumps && !options.jumps->empty()) check_jumps(data, options);
  if (options.period == 1 && options.smoothing && !std::isinf(*options.smoothing))
    throw std::invalid_argument(
        fmt::format("smoothing: {} found, but one model serves all steps, so that nothing varies. Use 0 or infinity",
                    *options.smoothing));
  if (options.period > 1 && options.period >= data.steps())
    throw std::invalid_argument(
        fmt::format("period: {} found, less than the {} steps of the data needed", options.period, data.steps()));
  const Index most = std::max<Index>(1, data.steps() - 1) * data.outputs();
  if (options.states > most)
    throw std::invalid_argument(fmt::format("states: {} found, {} steps of {} determine at most {}", *options.states,
                                            data.steps(), words::plural(data.outputs(), "output"), most));
  if (options.weighting == Weighting::projection && options.period == 0)
    throw std::invalid_argument("weighting: projection found, needs --time-invariant or --period P to pool steps");
  if (!tvera && options.period == 0 && !options.smoothing && data.experiments() < 2)
    throw std::invalid_argument(
        "experiments: 1 found, at least 2 needed to identify how a system varies in time (one is enough if the "
        "system is stated to be time-invariant or periodic)");
}

Findings findings_of_lags(const Ensemble& data, const IdentifyOptions& o) {
  if (!o.lags || *o.lags * data.outputs() >= o.states.value_or(0)) return {};
  return {{.kind = Finding::Kind::lags_below_states,
           .numbers = {{"lags", double(*o.lags)},
                       {"outputs", double(data.outputs())},
                       {"most", double(*o.lags * data.outputs())},
                       {"states", double(*o.states)}}}};
}

ExcitationOptions excitation_options(const Plan& plan, const IdentifyOptions& options) {
  return {.lags = plan.lags,
          .period = options.period,
          .centred = options.period == 0 || plan.nominal,
          .noisy = plan.noisy,
          .shared = plan.coupled && options.period == 0};
}

// Findings about the data from the regressions of each step alone, or of all steps together.
Findings findings_of_regressions(const Ensemble& data, const Survey& samples, const Regressed& regressed,
                                 RegressionSurvey survey, const IdentifyOptions& options) {
  const Plan& plan = regressed.plan;
  ExcitationOptions o = excitation_options(plan, options);
  if (plan.coupled) {
    Findings result = excitation(data, o).findings;
    if (plan.choices.variation.period == 0) append(result, findings_of_absence(samples, data.names));
    return result;
  }
  survey.unexcited = unexcited_steps(data, regressed.arx, plan.nominal, plan.lags, regressed.arx.steps());
  o.dependent_steps = survey.unexcited;
  Excitation found = excitation(data, o);
  std::erase_if(survey.unexcited,
                [&](Index k) { return std::binary_search(found.named.begin(), found.named.end(), k); });
  const Index spent = plan.nominal ? 1 : 0;
  append(found.findings, findings_of(survey,
                                     {data.experiments(), data.experiments() - spent, data.inputs(), data.outputs(),
                                      plan.lags, plan.feedthrough.present},
                                     plan.noisy));
  return std::move(found.findings);
}

// Findings about single experiments: repeated inputs, stuck sensors and outliers.
struct ExperimentFindings {
  Findings findings;
  std::vector<Outlier> outliers;
  std::vector<std::string> misfits;  // labels of the experiments that are stuck or outliers
};

// All measured experiments, and what was done about outliers among them.
struct Measured {
  const Ensemble& all;
  std::vector<Index> rows;  // of the used experiments; the others are copies, empty or dropped
  Treatment treatment = {};
};

// The outliers of the used experiments, and those that were found before. Rows are those of all measured experiments.
// `held_out`: rows of the used experiments that are held out.
std::vector<Outlier> all_outliers(std::vector<Outlier> found, const Measured& measured,
                                  const std::vector<Index>& held_out) {
  std::vector<Outlier> result = measured.treatment.outliers;
  for (Outlier& outlier : found) {
    outlier.held_out = std::count(held_out.begin(), held_out.end(), outlier.experiment) > 0;
    outlier.experiment = measured.rows[size_t(outlier.experiment)];
    outlier.name = measured.all.experiment_name(outlier.experiment);
    if (!measured.treatment.knows(measured.all, outlier.experiment)) result.push_back(std::move(outlier));
  }
  return result;
}

// `regressed_from`: the first step with a regression.
Findings findings_of_model(const Model& model, const Ensemble& data, const Plan& plan, Index regressed_from,
                           const IdentifyOptions& options) {
  Findings result;
  if (plan.method != Method::tvera && data.free.experiments > 0)
    result.push_back(
        {.kind = Finding::Kind::free_responses_unused, .numbers = {{"count", double(data.free.experiments)}}});
  const Index unknowns = model.states() + model.inputs;
  const TimeVariation& variation = plan.choices.variation;
  if (plan.coupled && plan.method == Method::subspace && variation.period == 0 && variation.smoothing > 0 &&
      data.experiments() < unknowns)
    result.push_back({.kind = Finding::Kind::few_for_states,
                      .numbers = {{"experiments", double(data.experiments())}, {"unknowns", double(unknowns)}}});
  if (options.states && model.states() < *options.states)
    result.push_back({.kind = Finding::Kind::states_below_asked,
                      .numbers = {{"asked", double(*options.states)}, {"found", double(model.states())}}});
  if (options.states) append(result, findings_of_hidden_states(model));
  if (data.free.experiments > 0 && model.states() > 0 && model.full_begin() > regressed_from)
    result.push_back({.kind = Finding::Kind::free_responses_partial,
                      .numbers = {{"count", double(data.free.experiments)},
                                  {"states", double(model.states())},
                                  {"wanted", double(regressed_from)},
                                  {"step", double(model.full_begin())}}});
  append(result, findings_of_begin(model));
  append(result, findings_of_gains(model));
  return result;
}

// Surveys the samples. \throws std::invalid_argument if they do not permit an identification
Survey checked_channels(const Ensemble& data) {
  Survey samples = checked(data);
  if (data.inputs() == 0 || data.outputs() == 0)
    throw std::invalid_argument(fmt::format("ensemble: {} inputs and {} outputs found, at least one of each needed",
                                            data.inputs(), data.outputs()));
  check_magnitudes(samples, data.names, data.inputs());
  return samples;
}

// The model in the coordinates of its plan.
std::pair<Model, Findings> framed(Model model, const Plan& plan) {
  const Index step = frame_step(model, plan);
  FramedModel result = in_frame(std::move(model), plan);
  check_finite(result.model);
  Findings findings = findings_of_frame(result, step, plan);
  return {std::move(result.model), std::move(findings)};
}

// Moves the tests and scores that led to the choices into the result.
void take_evidence(NominalTest nominal, Regressed regression, const RegressionSurvey& survey, Realised realisation,
                   Identification& result) {
  if (!result.plan.coupled) {
    result.condition_max = survey.condition_max;
    result.rank_deficient_steps = survey.rank_deficient;
  }
  result.nominal_test = std::move(nominal);
  result.initial_state_test = std::move(regression.initial_state_test);
  result.lag_order_errors = std::move(regression.lag_order_errors);
  result.smoothing_choice = std::move(regression.smoothing_choice);
  result.order_scores = std::move(realisation.order_scores);
  result.refinement = std::move(realisation.refinement);
  result.comparison = std::move(realisation.comparison);
  result.singular_value_gap = statistics::median(singular_value_gaps(result.model));
}

// The model, the plan and the sums in findings of the measured samples, from those of the prepared samples.
Model measured_model(Model model, const Prepared& prepared, const std::vector<Index>& delays) {
  model = out_of_units(of_undelayed(std::move(model), delays), prepared.units);
  if (prepared.nominal) {
    model.u_nominal = prepared.nominal->u;
    model.y_nominal = prepared.nominal->y;
  }
  return model;
}

// The constant of a regression is uncertain, above all if the plant is slow. That of the model is not.
void add_remaining_constant(const Model& model, InitialState initial, Prepared& prepared) {
  if (const std::optional<Vector> remaining = remaining_constant(model, prepared.data, initial))
    prepared.nominal->y.rowwise() += remaining->cwiseProduct(prepared.units.output).transpose();
}

Findings measured_findings(Findings findings, const Units& units) {
  for (Finding& finding : findings)
    for (Finding::Term& term : finding.terms)
      term.factor /= (term.channel.output ? units.output : units.input)(term.channel.index);
  return findings;
}

Plan measured_plan(Plan plan, const Prepared& prepared) {
  const Units& units = prepared.units;
  if (plan.output_size.size() > 0) plan.output_size = plan.output_size.cwiseProduct(units.output);
  if (plan.input_size.size() > 0) plan.input_size = plan.input_size.cwiseProduct(units.input);
  plan.choices.delays = prepared.delays;
  if (plan.states > 0) plan.states += held_inputs(prepared.delays);
  return plan;
}

// Measured experiments, their model and their plan, without the states that hold inputs: with delayed inputs instead.
// The examination of single experiments needs these, because its regressions hold no inputs.
struct Examinable {
  std::shared_ptr<const Ensemble> data;  // refers to the measured experiments if there are no dead times
  Model model;
  Plan plan;
};

// `model`: of the prepared samples. `plan`: with the states that hold inputs.
Examinable without_held_inputs(const Ensemble& used, const Model& model, const Plan& plan, const Prepared& prepared) {
  Examinable result{{std::shared_ptr<const Ensemble>(), &used}, measured_model(model, prepared, {}), plan};
  if (prepared.delays.empty()) return result;
  result.data = std::make_shared<const Ensemble>(delayed(used, prepared.delays));
  result.model.u_nominal = delayed(std::move(result.model.u_nominal), prepared.delays);
  result.plan.choices.delays.clear();
  result.plan.states -= held_inputs(prepared.delays);
  return result;
}

ExperimentFindings experiment_findings(const Examinable& plant, const Measured& measured,
                                       const std::vector<Index>& held_out, const IdentifyOptions& options) {
  const Ensemble& used = *plant.data;
  const Plan& plan = plant.plan;
  const bool exact = !plan.noisy && plan.initial_state == InitialState::zero;
  const Index r = used.inputs(), p = plan.lags;
  // With unknown initial states, or with noise, states also vary without inputs. Fewer different inputs are then
  // needed.
  const Index needed = options.period > 0 ? 0
                       : plan.coupled     ? r + plant.model.states()
                       : exact            ? experiments_for(used, p, plan)
                                          : r * (p + 1);
  ExperimentFindings result;
  result.findings = findings_of_repeats(used, needed, p);
  append(result.findings, findings_of_recording(measured.all));
  StuckOutputs stuck = stuck_outputs(measured.all);
  append(result.findings, std::move(stuck.findings));
  Examined found = examined(used, plant.model, plan, in_stage(options.execution, WorkStage::examination));
  if (!found.unnamed.empty()) {
    Finding misfits{.kind = Finding::Kind::many_misfits};
    for (const Index n : found.unnamed) {
      const Index row = measured.rows[size_t(n)];
      misfits.experiments.push_back({row, measured.all.experiment_name(row)});
    }
    result.findings.push_back(std::move(misfits));
  }
  result.outliers = all_outliers(std::move(found.outliers), measured, held_out);
  append(result.findings, findings_of(result.outliers, stuck.experiments));
  for (const Index n : stuck.experiments) result.misfits.push_back(measured.all.experiment_label(n));
  for (const Outlier& outlier : result.outliers)
    result.misfits.push_back(measured.all.experiment_label(outlier.experiment));
  return result;
}

// The model before EM, as its caller gets it.
Model first_model(const Model& model, const Plan& plan, const Prepared& prepared, const Ensemble& training,
                  const IdentifyOptions& options) {
  Identification found;
  found.plan = measured_plan(plan, prepared);
  found.model = framed(measured_model(model, prepared, prepared.delays), found.plan).first;
  found.experiments = training.experiments();
  found.steps = training.steps();
  found.model.provenance = origin_of(options, true, found);
  found.model.provenance.data = {fingerprint(training)};
  found.model.provenance.dt_stated = training.dt_stated;
  return std::move(found.model);
}

// The stated states include those that hold inputs on their way.
IdentifyOptions without_held_inputs(IdentifyOptions options, const std::vector<Index>& delays) {
  const Index held = held_inputs(delays);
  if (held == 0 || !options.states) return options;
  if (*options.states <= held)
    throw std::invalid_argument(fmt::format(
        "states: {} found, more than {} needed, because the dead times alone need these", *options.states, held));
  *options.states -= held;
  return options;
}

// What is identified.
struct Task {
  const Ensemble& used;
  Vector weights;            // of the used experiments, between 0 and 1
  const Measured* measured;  // the source of the names of single experiments; null: no findings about these
  bool validating;
  const IdentifyOptions& options;
  OnModel on_model = {};
};

// The experiments that are identified, and those that are held out.
struct Parts {
  const Ensemble& used;
  std::optional<Split> split;  // without a value, nothing is held out

  const Ensemble& training() const { return split ? split->training : used; }
  const Ensemble* held_out() const { return split ? &split->held_out : nullptr; }
  std::vector<Index> held_out_rows() const { return split ? split->held_out_rows : std::vector<Index>{}; }
  // A single record is split in time. Its weight is that of its first part.
  Vector of_training(const Vector& weights) const {
    if (training().experiments() == used.experiments()) return weights;
    return weights(other_rows(used.experiments(), held_out_rows()));
  }
};

Parts parts_of(const Ensemble& used, const IdentifyOptions& options) {
  if (options.hold_out == 0) return {used, {}};
  return {used, split(used, options.hold_out, options.period)};
}

bool may_vary(const IdentifyOptions& options) {
  return options.period == 0 && !std::isinf(options.smoothing.value_or(0.0));
}

// Validates with the held-out experiments or, if there are none, with the training data. `misfits`: labels of
// experiments that are known to be wrong.
Validation validated(const Model& model, InitialState initial, const Parts& parts, std::vector<std::string> misfits,
                     const Task& task) {
  const Execution execution = in_stage(task.options.execution, WorkStage::validation);
  if (execution.progress) execution.progress({});
  const ValidateOptions o{.initial_state = initial, .misfits = std::move(misfits)};
  const Ensemble* held_out = parts.held_out();
  const Ensemble &training = parts.training(), &tested = held_out ? *held_out : training;
  Validation result = validate_in_numbers(model, tested, o);
  if (task.measured) {
    // The held-out part of a single record is its end.
    const Ensemble& all = task.measured->all;
    const Index first = held_out ? all.steps() - held_out->steps() : 0;
    result.outlying = outlying_in(all, tested, first, std::move(result.outlying));
    if (held_out && result.noisy) {
      auto more = outlying_in(all, training, 0, outlying_samples(model, training, o));
      std::move(more.begin(), more.end(), std::back_inserter(result.outlying));
    }
    const std::vector<OutlyingSamples>& before = task.measured->treatment.samples;
    result.outlying.insert(result.outlying.begin(), before.begin(), before.end());
  }
  append(result.findings, findings_of(result.outlying, tested.names));
  return result;
}

// `missing`: samples of the used experiments.
Findings findings_of_measured(const Task& task, const Ensemble& training, const Survey& samples, Extent steps,
                              Index missing) {
  const bool named = task.measured != nullptr;
  Findings result;
  if (named) append(result, remarks(task.measured->all));
  if (named && may_vary(task.options))
    append(result, findings_of_reach(task.measured->all, task.measured->rows, steps, fewest_at_a_step));
  append(result, findings_of_samples(training, samples, steps, task.options.period));
  if (named && task.options.period == 0 && missing > 0) append(result, findings_of_overlap(task.measured->all));
  return result;
}

// What regressions show of the data, before a realisation uses up their coefficients.
struct Surveyed {
  RegressionSurvey survey;
  Index from = 0;  // the first step with a regression
  Findings findings;
};

Surveyed surveyed(Regressed& regression, const Prepared& prepared, const Survey& samples,
                  const IdentifyOptions& options) {
  const GtvArx& arx = regression.arx;
  Surveyed result{survey_of(arx, prepared.nominal.has_value(), 0, arx.steps()), arx.k_begin,
                  std::move(regression.findings)};
  Findings found = findings_of_regressions(prepared.data, samples, regression, result.survey, options);
  append(result.findings, measured_findings(std::move(found), prepared.units));
  return result;
}

Findings joined(std::initializer_list<Findings> parts) {
  Findings result;
  for (const Findings& part : parts) append(result, part);
  return result;
}

Identification identified_before(Index end, Index needed, const Ensemble& training, const Task& task);

Identification identified(const Task& task) {
  const IdentifyOptions& options = task.options;
  check_options(options);
  const Survey all_samples = checked_channels(task.used);
  const Parts parts = parts_of(task.used, options);
  const Ensemble& training = parts.training();
  const Extent steps = may_vary(options) ? reached(training, fewest_at_a_step) : Extent{0, training.steps()};
  if (steps.end < training.steps()) return identified_before(steps.end, fewest_at_a_step, training, task);
  const Survey samples = parts.split ? survey(training, 0, training.steps()) : all_samples;
  const Findings of_measured = findings_of_measured(task, training, samples, steps, all_samples.missing);

  const Vector weights = parts.of_training(task.weights);
  Prepared prepared = prepare(training, weights, options);
  check_method(prepared.data, options);
  const IdentifyOptions of_plant = without_held_inputs(options, prepared.delays);
  const Findings of_lags = findings_of_lags(prepared.data, of_plant);

  const Selection selection = selection_samples(prepared.data, options);
  Regressed regression = regressed(prepared.data, selection, prepared.nominal.has_value(), of_plant);
  if (const Index needed = experiments_for(prepared.data, regression.plan.lags, regression.plan);
      !regression.plan.coupled)
    if (const Index end = reached(training, needed).end; end < training.steps())
      return identified_before(end, needed, training, task);
  Surveyed regressions = surveyed(regression, prepared, samples, options);

  BeforeEm before_em;
  if (task.on_model)
    before_em = [&](const Model& model, const Plan& plan) {
      task.on_model(first_model(model, plan, prepared, training, options));
    };
  Realised realisation = realised(std::move(prepared.data), selection, regression, of_plant, before_em);
  if (realisation.instead) regressions = surveyed(regression, prepared, samples, options);
  if (prepared.nominal && options.period == 1 && !options.nominal && realisation.plan.noisy && weights.minCoeff() == 1)
    add_remaining_constant(realisation.model, realisation.plan.initial_state, prepared);
  Identification result;
  result.plan = measured_plan(std::move(realisation.plan), prepared);
  const Examinable plant = without_held_inputs(task.used, realisation.model, result.plan, prepared);
  Findings of_model = findings_of_model(plant.model, training, plant.plan, regressions.from, of_plant);
  Model realised_model = measured_model(std::move(realisation.model), prepared, prepared.delays);
  append(of_model, findings_of_absent_states(realised_model));
  prepared.data = {};  // frees memory for what follows
  ExperimentFindings experiments;
  if (task.measured) experiments = experiment_findings(plant, *task.measured, parts.held_out_rows(), options);
  auto [model, of_frame] = framed(std::move(realised_model), result.plan);
  result.model = std::move(model);
  result.outliers = std::move(experiments.outliers);
  if (task.validating)
    result.validation = validated(result.model, result.plan.initial_state, parts, std::move(experiments.misfits), task);
  result.findings = joined({of_measured, prepared.findings, of_lags, regressions.findings, realisation.findings,
                            of_model, experiments.findings, of_frame, result.validation.findings,
                            findings_of_fit(result.validation.one_step.fit, training.names)});

  result.experiments = training.experiments();
  result.steps = training.steps();
  result.min_experiments = experiments_for(training, result.plan.lags, result.plan);
  result.held_out = parts.split.has_value();
  result.held_out_experiments = task.used.experiments() - training.experiments();
  take_evidence(std::move(prepared.nominal_test), std::move(regression), regressions.survey, std::move(realisation),
                result);
  result.model.provenance = origin_of(options, result.plan.noisy || options.choices, result);
  result.model.provenance.data = {fingerprint(training)};
  result.model.provenance.dt_stated = training.dt_stated;
  if (options.execution.progress) options.execution.progress({.share = 1.0});
  return result;
}

// Identifies the steps before `end` alone. Fewer than the needed training experiments reach the later steps.
Identification identified_before(Index end, Index needed, const Ensemble& training, const Task& task) {
  const Measured* all = task.measured;
  const Ensemble used = begin_of(task.used, end);
  std::optional<Ensemble> all_begin;
  std::optional<Measured> measured;
  if (all) measured.emplace(Measured{all_begin.emplace(begin_of(all->all, end)), all->rows, all->treatment});
  Identification result =
      identified({used, task.weights, measured ? &*measured : nullptr, task.validating, task.options, task.on_model});
  note_data(result.model.provenance, fingerprint(training));
  const Findings unused = all ? findings_of_reach(all->all, all->rows, {0, end}, needed)
                              : findings_of_reach(task.used, range(0, task.used.experiments()), {0, end}, needed);
  result.findings = joined({unused, result.findings});
  return result;
}

// Rounds of an identification that drops or downweights what the round before has found.
constexpr int most_rounds = 6;

// Identifies after the corrections of measured.treatment. `used`: the experiments in measured.rows.
Identification identified_after(const Ensemble& used, Measured measured, const IdentifyOptions& options,
                                const OnModel& on_model = {}) {
  const Treatment& treatment = measured.treatment;
  if (treatment.corrections.empty())
    return identified({used, Vector::Ones(used.experiments()), &measured, true, options, on_model});
  const Corrected remaining = corrected(measured.all, measured.rows, treatment.corrections);
  measured.rows = remaining.rows;
  try {
    Identification result = identified({remaining.data, remaining.weights, &measured, true, options});
    result.model.provenance.corrections = treatment.corrections;
    if (options.hold_out == 0) note_data(result.model.provenance, fingerprint(measured.all));
    return result;
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(
        fmt::format("outliers: {} of {} experiments remain after the correction of those that do not fit: {}",
                    measured.rows.size(), used.experiments(), error.what()));
  }
}

// Identifies again until no more experiments or samples are found that do not fit.
Identification identified_with_outliers(const Ensemble& used, Measured measured, const IdentifyOptions& options,
                                        const OnModel& on_model = {}) {
  IdentifyOptions of_round = options;
  of_round.execution = share(options.execution, 0.0, options.outliers == OutlierChoice::keep ? 1.0 : 0.5);
  Identification result = identified_after(used, measured, of_round, on_model);
  if (options.outliers == OutlierChoice::keep) return result;
  double done = 0.5;
  for (int round = 1; round < most_rounds; ++round) {
    const Found found{result.model, result.outliers, result.validation.outlying};
    if (!treat(measured.all, found, options.outliers, measured.treatment)) break;
    of_round.execution = share(options.execution, done, (1 + done) / 2);
    done = (1 + done) / 2;
    result = identified_after(used, measured, of_round);
  }
  append(result.findings, findings_of_untreated(result.outliers, used.experiments()));
  if (options.execution.progress) options.execution.progress({.share = 1.0});
  return result;
}

}  // namespace

Identification identify(const Ensemble& ensemble, const IdentifyOptions& asked, const OnModel& on_model) {
  const auto begin = std::chrono::steady_clock::now();
  IdentifyOptions options = asked;
  double reached = 0.0;
  if (asked.execution.progress)  // where a choice is made once more, its stages begin again
    options.execution.progress = [&asked, &reached](ProgressReport now) {
      now.share = reached = std::max(reached, now.share);
      asked.execution.progress(now);
    };
  const auto of_used = [&] {
    UsedExperiments used = used_experiments(ensemble);
    const Measured measured{ensemble, used.rows};
    Identification result;
    if (used.all(ensemble)) {
      result = identified_with_outliers(ensemble, measured, options, on_model);
    } else {
      ensemble.check();  // reports errors with the rows of the caller
      result = identified_with_outliers(ensemble.subset(measured.rows), measured, options, on_model);
      note_data(result.model.provenance, fingerprint(ensemble));
    }
    const Findings dropped = findings_of(used, ensemble);
    result.findings.insert(result.findings.begin(), dropped.begin(), dropped.end());
    result.copies = std::move(used.copies);
    result.used = std::move(used.rows);
    return result;
  };
  Identification result = with_remark_on_axes(ensemble, [&] { return with_remark_on_unused(ensemble, of_used); });
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

Provenance origin_of(const IdentifyOptions& options, bool chosen, const Identification& result) {
  Provenance origin;
  origin.options = options;
  origin.options->choices.reset();
  origin.options->execution = {};
  origin.experiments = result.experiments;
  const NoisyChoices& choices = result.plan.choices;
  if (result.plan.coupled && chosen)
    origin.choices = choices;
  else if (!choices.delays.empty())
    origin.options->delays = choices.delays;
  if (result.plan.method == Method::regression) origin.options->method = Method::regression;
  if (result.refinement.iterations > 0) origin.refinement = {result.refinement.smoothing, result.refinement.iterations};
  origin.feedthrough = result.plan.feedthrough;
  origin.version = version;
  return origin;
}

Identification identify_part(const Ensemble& ensemble, const IdentifyOptions& options, bool validated) {
  if (options.outliers == OutlierChoice::keep)
    return identified({ensemble, Vector::Ones(ensemble.experiments()), nullptr, validated, options});
  IdentifyOptions half = options;
  half.execution = share(options.execution, 0.0, 0.5);
  const Corrections corrections = identified_with_outliers(ensemble, {ensemble, range(0, ensemble.experiments())}, half)
                                      .model.provenance.corrections;
  const Corrected remaining = corrected(ensemble, corrections);
  half.execution = share(options.execution, 0.5, 1.0);
  Identification result = identified({remaining.data, remaining.weights, nullptr, validated, half});
  result.model.provenance.corrections = corrections;
  return result;
}

}  // namespace tokid
