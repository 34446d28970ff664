// SPDX-License-Identifier: BSD-3-Clause
#include "report/evidence.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/nan.hpp"
#include "base/rounding.hpp"
#include "base/statistics.hpp"
#include "data/axes.hpp"
#include "data/extents.hpp"
#include "data/scales.hpp"
#include "diagnose/excitation.hpp"
#include "model/comparison.hpp"
#include "model/outlying_samples.hpp"
#include "model/step_fields.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid::report {

namespace {

// Root mean square errors of each step over experiments and outputs, relative to the spread of the outputs.
std::vector<double> relative_errors(const Innovations& innovations, const Vector& spread) {
  std::vector<double> result;
  for (const Matrix& innovation : innovations) {
    double sum = 0.0;
    Index count = 0;
    for (Index j = 0; j < innovation.cols(); ++j)
      for (const double e : innovation.col(j))
        if (!std::isnan(e)) sum += (e / spread(j)) * (e / spread(j)), ++count;
    result.push_back(count > 0 ? std::sqrt(sum / double(count)) : nan);
  }
  return result;
}

// The spread of an input over the experiments at each step; NaN for fewer than three samples.
std::vector<double> spreads(const Ensemble& data, Index input) {
  std::vector<double> spread(size_t(data.steps()), nan);
  for (Index k = 0; k < data.steps(); ++k) {
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (const double u : data.input(k).col(input))
      if (!std::isnan(u)) sum += u, ++count;
    if (count < 3) continue;
    const double mean = sum / double(count);
    for (const double u : data.input(k).col(input))
      if (!std::isnan(u)) squares += (u - mean) * (u - mean);
    const double deviation = std::sqrt(squares / double(count - 1));
    spread[size_t(k)] = spread_above_rounding(deviation, mean);
  }
  return spread;
}

// The share of the steps at which an input differs between two experiments by at most `distance`. For a binary random
// input it is one half.
double chance_agreement(const Ensemble& data, Index input, double distance) {
  Index pairs = 0, close = 0;
  for (Index k = 0; k < data.steps(); ++k)
    for (Index n = 1; n < data.experiments(); ++n) {
      const double difference = std::abs(data.u(n, k, input) - data.u(n - 1, k, input));
      if (std::isnan(difference)) continue;
      ++pairs;
      if (difference <= distance) ++close;
    }
  return pairs > 0 ? double(close) / double(pairs) : 1.0;
}

// Does the mean motion of the inputs differ between steps that share their matrices? Only differences between
// experiments are then left.
bool has_mean_of_each_step(const Model& model) {
  const Index others = model.u_nominal.rows() - model.period;
  return others > 0 && model.u_nominal.topRows(others) != model.u_nominal.bottomRows(others);
}

void assess_inputs(const Model& model, const Ensemble& data, Evidence& found) {
  std::vector<WeakInput>& result = found.weak_inputs;
  const bool shared = model.period > 0, each_step = shared && has_mean_of_each_step(model);
  found.inputs_over_time = shared && !each_step;
  found.input_spread.assign(size_t(data.inputs()), nan);
  if (shared) {  // differences at any step help
    for (Index i = 0; i < data.inputs(); ++i) {
      const ChannelSummary s = channel_summary(data, i);
      if (s.samples < 2) continue;
      ++found.assessed_inputs;
      const std::vector<double> spread = each_step ? spreads(data, i) : std::vector<double>{s.max - s.min};
      if (std::none_of(spread.begin(), spread.end(), [](double x) { return x > 0; }))
        result.push_back({i, {}, 0.0, true});
    }
    return;
  }
  for (Index i = 0; i < data.inputs(); ++i) {
    const std::vector<double> spread = spreads(data, i);
    if (std::all_of(spread.begin(), spread.end(), [](double s) { return std::isnan(s); })) continue;
    ++found.assessed_inputs;
    std::vector<double> moving;
    for (const double s : spread)
      if (s > 0) moving.push_back(s);
    WeakInput weak{i, {}, 1.0};
    const double usual = finite_median(moving);  // median over the steps at which the input differs between experiments
    if (std::isnan(usual)) {
      weak.always = true;
      weak.spread = found.input_spread[size_t(i)] = 0.0;
      result.push_back(weak);
      continue;
    }
    double least = nan;
    for (const double s : spread) least = std::fmin(least, s / usual);
    for (Index k = 0; k < data.steps(); ++k)
      if (spread[size_t(k)] < bounds::weak_input * usual) {
        weak.steps.push_back(k);
        weak.spread = std::min(weak.spread, spread[size_t(k)] / usual);
      }
    if (weak.steps.empty()) {
      found.input_spread[size_t(i)] = least;
      continue;
    }
    // A few experiments may agree by chance, most often if the input has few different values.
    const double agreement = chance_agreement(data, i, 3 * bounds::weak_input * usual);
    const double expected = double(data.steps() * data.inputs()) * std::pow(agreement, double(data.experiments() - 1));
    if (expected >= bounds::chance) continue;
    found.input_spread[size_t(i)] = least;
    result.push_back(weak);
  }
}

// Inputs that are the same function of other samples at half of the steps or more. Some steps are examined, which takes
// no longer with more steps.
Findings dependent_inputs(const Model& model, const Ensemble& data, const Evidence& evidence) {
  const Excitation found =
      excitation(data, {.lags = std::max<Index>(1, evidence.lags > 0 ? evidence.lags : model.states()),
                        .period = model.period,
                        .centred = model.period == 0 || model.y_nominal.rows() > 0,
                        .noisy = evidence.noisy,
                        .shared = model.period == 0,
                        .sampled = model.period == 0});
  Findings result;
  for (const Finding& f : found.findings) {
    // Without noise, outputs are functions of the inputs. An input that follows from them need not be a feedback.
    const bool hides =
        f.kind == Finding::Kind::inputs_dependent || (f.kind == Finding::Kind::input_feedback && evidence.noisy);
    const Index steps = Index(f.steps.size());
    if (!hides || (model.period != 1 && 2 * steps < found.places)) continue;
    result.push_back(f);
    if (model.period == 0 && steps == found.places) {  // at all examined steps: at those between them too
      std::vector<Index>& all = result.back().steps;
      for (Index k = all.front() + 1; k < f.steps.back(); ++k) all.push_back(k);
      std::sort(all.begin(), all.end());
      all.erase(std::unique(all.begin(), all.end()), all.end());
    }
  }
  return result;
}

std::vector<Index> constant_outputs(const Ensemble& data) {
  std::vector<Index> result;
  for (Index j = 0; j < data.outputs(); ++j) {
    const ChannelSummary s = channel_summary(data, data.inputs() + j);
    if (s.samples > 1 && spread_above_rounding(s.max - s.min, std::max(s.max, -s.min)) == 0) result.push_back(j);
  }
  return result;
}

// RMS of the innovations that the model states at step k, relative to the spread of the outputs; 0 if the model states
// no covariance.
double stated_error(const Model& model, const Vector& spread, Index k) {
  if (!model.has(&Step::has_innovation_cov)) return 0.0;
  const Vector variance = model.at(k).innovation_cov().diagonal();
  return std::sqrt((variance.array() / spread.array().square()).mean());
}

// The RMS of normally distributed errors, relative to the median RMS, that the largest of all steps exceeds by chance
// in few data sets. `freedom`: number of errors of a step that are alike.
double largest_by_chance(double freedom, Index steps) {
  constexpr double many = 1e9;  // degrees of freedom: F is then χ² divided by its own
  return std::sqrt(statistics::f_quantile(1 - bounds::chance / double(steps), freedom, many) /
                   statistics::f_quantile(0.5, freedom, many));
}

// The number of outputs that have as much influence on the RMS error over the outputs as if they were alike.
double alike_outputs(const Prediction& prediction, const Vector& spread) {
  Vector square = Vector::Zero(spread.size());
  for (const Matrix& innovations : prediction.innovations)
    square += innovations.array().isFinite().select(innovations, 0.0).colwise().squaredNorm().transpose();
  square = (spread.array() > 0).select(square.cwiseQuotient(spread.cwiseAbs2()), 0.0).eval();
  const double largest = square.size() > 0 ? square.maxCoeff() : 0.0;
  if (!(largest > 0) || !std::isfinite(largest)) return 1.0;
  square /= largest;
  return square.sum() * square.sum() / square.squaredNorm();
}

// Finds the steps from `first_step` on with unusually large errors, which a mean over all samples hides, and the steps
// without a comparison.
void assess_errors(const Model& model, const Ensemble& data, const Vector& spread, Index first_step, Evidence& found) {
  const double usual = finite_median(found.step_error);
  const Index freedom = found.samples - found.unknowns;
  const double alike = alike_outputs(found.prediction, spread);
  std::map<Index, double> multiple;  // of the usual error that is unusual, for each number of experiments
  found.step_excess.assign(size_t(data.steps()), nan);
  found.noise_excess = found.step_excess;
  // A step of a periodic model is tested where any step of its phase is tested.
  std::vector<char> tested(size_t(std::min(model.period, model.steps())), 0);
  const auto phase = [&](Index k) { return size_t((k - model.k_begin) % model.period); };
  const auto error_at = [&](Index k) { return k < data.steps() ? found.step_error[size_t(k)] : nan; };
  for (Index k = std::max(model.k_begin, first_step); model.period > 0 && k < model.k_end(); ++k)
    if (!std::isnan(error_at(k))) tested[phase(k)] = 1;
  for (Index k = std::max(model.k_begin, first_step); k < model.k_end(); ++k) {
    const double error = error_at(k);
    if (std::isnan(error)) {
      if (model.period == 0 || !tested[phase(k)]) found.untested.push_back(k);
      continue;
    }
    // With unknown initial states, errors are larger at the first steps. The covariance that the model states may
    // contain this.
    const Index experiments = found.prediction.innovations[size_t(k)].array().isFinite().rowwise().any().count();
    const auto [own, is_new] = multiple.try_emplace(experiments, bounds::error_peak);
    if (is_new) own->second = std::max(own->second, largest_by_chance(double(experiments) * alike, data.steps()));
    const double unusual = own->second;
    found.step_excess[size_t(k)] =
        error / std::max({bounds::error_floor, unusual * usual, bounds::error_stated * stated_error(model, spread, k)});
    if (found.step_excess[size_t(k)] > 1) found.error_peaks.push_back(k);
    // With few degrees of freedom, the covariances are too uncertain.
    if (!model.has(&Step::has_innovation_cov) || freedom < 10) continue;
    double sum = 0.0;
    Index count = 0;
    for (Index j = 0; j < data.outputs(); ++j) {
      const double variance = model.at(k).innovation_cov()(j, j);
      if (!(std::sqrt(variance) > rounding_share * spread(j))) continue;
      for (const double e : found.prediction.innovations[size_t(k)].col(j))
        if (!std::isnan(e)) sum += e * e / variance, ++count;
    }
    if (count == 0) continue;
    found.noise_excess[size_t(k)] = std::sqrt(sum / double(count));
    if (found.noise_excess[size_t(k)] > bounds::beyond_noise) found.beyond_noise.push_back(k);
  }
}

void assess_regressions(const Model& model, Evidence& found) {
  const std::vector<double> condition = known_values(model, &Step::has_condition, &Step::condition);
  found.condition_median = finite_median(condition);
  found.condition_max = nan;
  for (const double c : condition) found.condition_max = std::fmax(found.condition_max, c);
  found.condition_limit = bounds::ill_conditioned;
  if (found.noisy && !std::isnan(found.condition_median))
    found.condition_limit = std::min(found.condition_limit,
                                     std::max(bounds::worth_a_word, bounds::worse_than_usual * found.condition_median));
  for (size_t s = 0; s < condition.size(); ++s)
    if (condition[s] > found.condition_limit) found.ill.push_back(model.k_begin + Index(s));
  for (size_t s = 0; model.has(&Step::has_rank) && s < model.step.size(); ++s) {
    const Index k = model.k_begin + Index(s);
    if (model.step[s].rank() < unknowns(model, k)) found.deficient.push_back(k);
  }
}

// Number of experiments of the identification; 0 if it is not known.
Index identified_from(const Model& model, const ReportOptions& options) {
  if (options.identified_from > 0) return options.identified_from;
  return model.provenance.experiments;
}

// The findings of `first`, and those of `second` whose text is not in `first`.
Findings merged(Findings first, const Findings& second) {
  for (const Finding& finding : second)
    if (std::none_of(first.begin(), first.end(), [&](const Finding& other) { return same_words(other, finding); }))
      first.push_back(finding);
  return first;
}

}  // namespace

ValidateOptions validate_options(const Tested& tested) {
  ValidateOptions options;
  options.horizon = std::clamp<Index>(tested.options.horizon, 1, std::max<Index>(1, tested.data.steps() - 1));
  options.initial_state = tested.options.initial_state;
  options.first_step = tested.options.first_step;
  return options;
}

Evidence evidence(const Model& model, const Tested& tested) {
  return evidence(model, tested, compare(model, tested.data, validate_options(tested)));
}

Evidence evidence(const Model& model, const Tested& tested, Comparison compared) {
  const Ensemble& data = tested.data;
  const ReportOptions& options = tested.options;
  Evidence found;
  found.horizon = validate_options(tested).horizon;
  found.rows = tested.rows;
  found.experiment_names = tested.names;
  found.names = model.names;
  const auto complete = [](std::vector<std::string>& names, const std::vector<std::string>& others) {
    if (names.empty()) names = others;
  };
  complete(found.names.input_names, data.names.input_names);
  complete(found.names.output_names, data.names.output_names);
  complete(found.names.input_units, data.names.input_units);
  complete(found.names.output_units, data.names.output_units);
  for (auto* list :
       {&found.names.input_names, &found.names.output_names, &found.names.input_units, &found.names.output_units})
    for (std::string& name : *list) name = words::quoted(name);
  found.experiments = data.experiments();
  found.missing = missing_samples(data);
  Index expected = 0;
  for (const Index length : lengths(data)) expected += length * data.channels();
  found.missing_share = expected > 0 ? double(found.missing) / double(expected) : 0.0;
  found.noisy = compared.validation.noisy;
  if (model.has(&Step::has_lags)) {
    found.lags = model.max_lags();
    for (Index k = model.k_begin; k < model.k_end(); ++k) found.unknowns = std::max(found.unknowns, unknowns(model, k));
  }
  found.identified_from = identified_from(model, options);
  found.samples = found.identified_from * (model.period > 0 ? std::max<Index>(1, data.steps() / model.period) : 1);
  assess_regressions(model, found);
  assess_inputs(model, data, found);
  found.dependent_inputs = dependent_inputs(model, data, found);
  found.differences = differences(model, data);
  if (auto swapped = swapped_axes(data)) found.differences.push_back(*std::move(swapped));
  found.conclusions = conclusions(compared.validation, found.names);

  const Vector spread = output_spread(model, data);
  found.constant_outputs = constant_outputs(data);
  std::vector<Index> moving;
  for (Index j = 0; j < data.outputs(); ++j)
    if (std::find(found.constant_outputs.begin(), found.constant_outputs.end(), j) == found.constant_outputs.end())
      moving.push_back(j);
  found.deciding = deciding_horizon(model, data, compared, options, spread, moving);
  Findings findings = compared.validation.findings;
  append(findings, findings_of(tested.in_given_data(compared.validation.outlying), data.names));
  found.findings =
      merged(options.bands ? merged(options.findings, options.bands->findings) : options.findings, findings);
  if (!compared.tested.empty())
    found.input_correlation =
        input_correlation(compared.tested, data, -test_lags, test_lags, compared.validation.independence.over);
  found.validation = std::move(compared.validation);
  found.prediction = std::move(compared.prediction);
  found.simulated = std::move(compared.simulated);
  found.fits = std::move(compared.experiments);
  found.step_error = relative_errors(found.prediction.innovations, spread);
  assess_errors(model, data, spread, options.first_step, found);
  return found;
}

double finite_median(std::vector<double> values) {
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); }), values.end());
  return statistics::median(std::move(values));
}

}  // namespace tokid::report
