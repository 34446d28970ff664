// SPDX-License-Identifier: BSD-3-Clause
#include "report/model_comparison.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "base/nan.hpp"

namespace tokid::report {

namespace {

// The outputs that a model computes in three ways.
struct ComputedOutputs {
  Ensemble simulation, one_step, ahead;
};

using Kind = Ensemble ComputedOutputs::*;
constexpr Kind kinds[] = {&ComputedOutputs::simulation, &ComputedOutputs::one_step, &ComputedOutputs::ahead};

Known known_to(const Model& other, const Ensemble& whole, const Tested& tested) {
  const Tested own = report::tested(other, whole, {});
  if (own.options.evaluation == Evaluation::given) return Known::not_seen;
  if (own.options.evaluation == Evaluation::training) return Known::training;
  const auto is_held_out = [&](Index row) { return std::binary_search(own.rows.begin(), own.rows.end(), row); };
  const Index held_out = std::count_if(tested.rows.begin(), tested.rows.end(), is_held_out);
  if (held_out == Index(tested.rows.size())) return Known::held_out;
  return held_out == 0 ? Known::training : Known::partly;
}

// The model of the page: its evaluation was found, or stated, before.
Known known_to_own(const Tested& tested) {
  switch (tested.options.evaluation) {
    case Evaluation::training:
      return Known::training;
    case Evaluation::held_out:
      return Known::held_out;
    default:
      return Known::not_seen;
  }
}

// The first step with an output of any experiment; empty if there is none.
std::optional<Index> first_computed(const Ensemble& computed) {
  for (Index k = 0; k < computed.steps(); ++k)
    if (!computed.output(k).array().isNaN().all()) return k;
  return std::nullopt;
}

// After an overflow, the outputs can be the difference of two infinities, which is NaN as a missing output is. They
// become infinite here, so that they count as errors. Squares of outputs overflow from `huge` on.
void keep_overflows(Ensemble& computed) {
  const double huge = std::sqrt(std::numeric_limits<double>::max());
  std::vector<bool> over(size_t(computed.experiments()), false);
  for (Index k = 0; k < computed.steps(); ++k)
    for (Index n = 0; n < computed.experiments(); ++n) {
      for (Index j = 0; j < computed.outputs(); ++j)
        over[size_t(n)] = over[size_t(n)] || std::abs(computed.y(n, k, j)) > huge;
      for (Index j = 0; over[size_t(n)] && j < computed.outputs(); ++j)
        if (std::isnan(computed.y(n, k, j))) computed.y(n, k, j) = std::numeric_limits<double>::infinity();
    }
}

// Makes the samples NaN that one of the models does not compute. A model without any sample does not count.
void keep_common(std::vector<ComputedOutputs>& all, Kind kind) {
  std::vector<Ensemble*> present;
  for (ComputedOutputs& computed : all)
    if (first_computed(computed.*kind)) present.push_back(&(computed.*kind));
  for (Index k = 0; !present.empty() && k < present.front()->steps(); ++k) {
    Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> missing = present.front()->output(k).array().isNaN();
    for (const Ensemble* computed : present) missing = missing || computed->output(k).array().isNaN();
    for (Ensemble* computed : present) {
      const Matrix kept = missing.select(nan, computed->output(k));
      computed->output(k) = kept;
    }
  }
}

ComputedOutputs computed_by(const Model& model, const Ensemble& data, Index horizon,
                            std::optional<InitialState> initial_state) {
  return {simulate_data(model, data, initial_state), predict(model, data, {1, initial_state}).y,
          predict(model, data, {horizon, initial_state}).y};
}

}  // namespace

ModelComparison compare_models(const Model& model, const Ensemble& whole, const Tested& tested) {
  const ReportOptions& options = tested.options;
  ModelComparison result;
  if (options.compare.empty()) return result;
  const Ensemble& data = tested.data;
  result.horizon = std::clamp<Index>(options.horizon, 1, std::max<Index>(1, data.steps() - 1));
  result.from = options.first_step;
  std::vector<const Model*> models{&model};
  result.models.push_back({options.model_name.empty() ? "this model" : options.model_name,
                           model.states(),
                           known_to_own(tested),
                           {},
                           {},
                           {},
                           {}});
  for (const NamedModel& other : options.compare) {
    if (other.model.inputs != model.inputs || other.model.outputs != model.outputs)
      throw std::invalid_argument(fmt::format("compare: {} inputs and {} outputs found in {}, the model has {} and {}",
                                              other.model.inputs, other.model.outputs, other.name, model.inputs,
                                              model.outputs));
    models.push_back(&other.model);
    result.models.push_back({other.name, other.model.states(), known_to(other.model, whole, tested), {}, {}, {}, {}});
  }
  std::vector<ComputedOutputs> computed;
  for (size_t i = 0; i < models.size(); ++i) {
    computed.push_back(computed_by(*models[i], data, result.horizon, options.initial_state));
    result.models[i].simulated = computed.back().simulation;
    for (const Kind kind : kinds) {
      keep_overflows(computed.back().*kind);
      result.from = std::max(result.from, first_computed(computed.back().*kind).value_or(0));
    }
  }
  for (const Kind kind : kinds) keep_common(computed, kind);
  for (size_t i = 0; i < models.size(); ++i) {
    ComparedModel& one = result.models[i];
    one.simulation = fit(data, computed[i].simulation, model.y_nominal, result.from);
    one.one_step = fit(data, computed[i].one_step, model.y_nominal, result.from);
    one.ahead = fit(data, computed[i].ahead, model.y_nominal, result.from);
  }
  return result;
}

}  // namespace tokid::report
