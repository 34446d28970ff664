// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/replication.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/statistics.hpp"
#include "data/check.hpp"
#include "data/extents.hpp"
#include "data/unused.hpp"
#include "tokid/identify.hpp"
#include "tokid/validate.hpp"
#include "uncertainty/interval.hpp"

namespace tokid {

namespace uncertainty {

namespace {

// Models count as the same if they differ by less than this. They may differ by rounding errors, which noisy Hankel
// matrices amplify.
constexpr double same = 1e-6;
// Weaker smoothing for the bias: this share of λ. The bias that is left is about the same share.
constexpr double weaker = 0.1;

bool differ(const Vector& a, const Vector& b) {
  double largest = 0.0, difference = 0.0;
  for (Index i = 0; i < a.size(); ++i) {
    if (std::isnan(a(i)) && std::isnan(b(i))) continue;
    if (!std::isfinite(a(i) - b(i))) return true;
    largest = std::max(largest, std::abs(a(i)));
    difference = std::max(difference, std::abs(a(i) - b(i)));
  }
  return difference > same * largest;
}

// Widens the intervals by the bias of the smoothing over time: the change of the estimates with weaker smoothing.
void add_bias(const Model& model, const Ensemble& training, const IdentifyOptions& identification,
              const Functional& functional, const std::vector<PerStep>& places, double level, Care care,
              Replication& result) {
  const double smoothing = smoothing_of(model);
  if (std::isinf(smoothing)) {
    const bool stated = identification.period > 0 || std::isinf(identification.smoothing.value_or(0.0));
    if (!stated) result.findings.push_back({.kind = Finding::Kind::bounds_of_constant_system});
    return;
  }
  if (smoothing == 0) return;
  Vector change;
  try {
    const bool with_nominal = model.y_nominal.rows() > 0;
    const Identifier f = identifier(model, identification, weaker, care);
    Model weak = f(with_nominal ? departures(training, {model.u_nominal, model.y_nominal}) : training);
    weak.u_nominal = model.u_nominal;
    weak.y_nominal = model.y_nominal;
    change = functional(weak) - result.bootstrap.interval.estimate.col(0);
  } catch (const std::exception&) {  // also too few experiments for so little penalty
    result.findings.push_back({.kind = Finding::Kind::bounds_without_bias, .numbers = {{"smoothing", smoothing}}});
    return;
  }
  result.smoothing = smoothing;
  result.bias_squares = Vector::Zero(change.size());
  for (const PerStep& place : places) add_local_squares(change, place, result.bias_squares);
  widen(result.bootstrap.interval, result.bias_squares,
        statistics::student_quantile((1 + level) / 2, result.bootstrap.freedom));
}

}  // namespace

Ensemble training_part(const Model& model, const Ensemble& data, const IdentifyOptions& identification) {
  if (model.inputs != data.inputs() || model.outputs != data.outputs())
    throw std::invalid_argument(fmt::format("channels: {} inputs and {} outputs found, the model has {} and {}",
                                            data.inputs(), data.outputs(), model.inputs, model.outputs));
  check_samples(data);
  const UsedExperiments used = used_experiments(data);
  Corrected remaining = corrected(used.all(data) ? data : data.subset(used.rows), model.provenance.corrections);
  if (remaining.weights.minCoeff() < 1)
    throw std::invalid_argument(
        "outliers: downweight found in the options of the model, and experiments that count less than others. Bounds "
        "need experiments of equal weight. Identify with the option outliers drop or keep");
  Ensemble training = std::move(remaining.data);
  if (identification.hold_out > 0) training = split(training, identification.hold_out, identification.period).training;
  if (training.steps() > model.k_end())  // too few experiments may have reached the later steps
    if (Ensemble begin = begin_of(training, model.k_end()); has_seen(model.provenance, begin))
      training = std::move(begin);
  const Index recorded = model.provenance.experiments;
  if (recorded > 0 && recorded != training.experiments())
    throw std::invalid_argument(
        fmt::format("experiments: {} found{}, the model was identified from {}: bounds need the ensemble of the "
                    "identification",
                    training.experiments(), identification.hold_out > 0 ? " without those held out" : "", recorded));
  if (training.steps() != model.k_end())
    throw std::invalid_argument(
        fmt::format("steps: {} found, the model ends with step {}: bounds need the ensemble of the identification",
                    training.steps(), model.k_end() - 1));
  return training;
}

Findings findings_of_data(const Model& model, const Ensemble& training) {
  if (has_seen(model.provenance, training)) return {};
  return {{.kind = Finding::Kind::bounds_of_other_data}};
}

Replication replicate(const Model& model, const Ensemble& training, const IdentifyOptions& identification,
                      const Functional& functional, const std::vector<PerStep>& places,
                      const ConfidenceOptions& options, Care care) {
  BootstrapOptions o;
  o.level = options.level;
  o.replicates = options.replicates;
  o.seed = options.seed;
  o.nominal = model.y_nominal.rows() > 0;
  o.period = model.period;
  o.execution = options.execution;
  const bool em = by_em(model);
  if (em || model.provenance.choices) o.unknowns = unknowns_of_states(model, training.steps());
  const Identifier f = identifier(model, identification, 1.0, care);
  Replication result;
  result.bootstrap = em ? bootstrap(model, training, f, functional, o) : bootstrap(training, f, functional, o);
  if (result.bootstrap.replicates < options.replicates)
    result.findings.push_back({.kind = Finding::Kind::replicates_failed,
                               .numbers = {{"failed", double(options.replicates - result.bootstrap.replicates)},
                                           {"replicates", double(options.replicates)}}});
  if (!em && differ(functional(model), result.bootstrap.interval.estimate.col(0)))
    result.findings.push_back({.kind = Finding::Kind::bounds_of_other_model});
  result.scatter = result.bootstrap.interval.deviation.col(0);
  add_bias(model, training, identification, functional, places, options.level, care, result);
  return result;
}

}  // namespace uncertainty

FunctionBounds function_bounds(const Model& model, const Ensemble& data, const Functional& function,
                               const ConfidenceOptions& options, Index steps) {
  uncertainty::check_level(options.level);
  const IdentifyOptions identification = identify_options(model.provenance);
  const Ensemble training =
      with_remark_on_unused(data, [&] { return uncertainty::training_part(model, data, identification); });
  const Index entries = function(model).size();
  if (entries == 0) throw std::invalid_argument("function: no values found, at least one needed");
  if (steps < 1 || entries % steps != 0)
    throw std::invalid_argument(
        fmt::format("steps: {} found, a divisor of the {} entries of the function needed", steps, entries));
  const std::vector<uncertainty::PerStep> places{{0, steps, entries / steps}};
  uncertainty::Replication found =
      uncertainty::replicate(model, training, identification, function, places, options, uncertainty::Care::thorough);
  FunctionBounds result;
  result.interval = std::move(found.bootstrap.interval);
  result.replicates = found.bootstrap.replicates;
  result.freedom = found.bootstrap.freedom;
  result.smoothing = found.smoothing;
  result.findings = uncertainty::findings_of_data(model, training);
  append(result.findings, std::move(found.findings));
  return result;
}

}  // namespace tokid
