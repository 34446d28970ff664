// SPDX-License-Identifier: BSD-3-Clause
#include "report/model_comparison.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/nan.hpp"

namespace tokid::report {

namespace {

// The outputs that a model computes in three ways.
struct ComputedOutputs {
  Ensemble simulation, one_step, ahead;
};

Known known_to(const Model& model, const Ensemble& whole, const Tested& tested) {
  const Tested own = report::tested(model, whole, {});
  if (own.options.evaluation == Evaluation::given) return Known::not_seen;
  if (own.options.evaluation == Evaluation::training) return Known::training;
  const bool all = std::includes(own.rows.begin(), own.rows.end(), tested.rows.begin(), tested.rows.end());
  return all ? Known::held_out : Known::partly;
}

// The first step with an output of any experiment; the number of steps if there is none.
Index first_step(const Ensemble& computed) {
  for (Index k = 0; k < computed.steps(); ++k)
    if (!computed.output(k).array().isNaN().all()) return k;
  return computed.steps();
}

// Makes the samples NaN that lie before a step, or that one of the models does not compute.
void keep_common(std::vector<ComputedOutputs>& all, Ensemble ComputedOutputs::*kind, Index from) {
  Ensemble& first = all.front().*kind;
  for (Index k = 0; k < first.steps(); ++k) {
    Matrix missing = Matrix::Zero(first.experiments(), first.outputs());
    if (k < from) missing.setConstant(nan);
    for (const ComputedOutputs& computed : all) missing += 0 * (computed.*kind).output(k);
    for (ComputedOutputs& computed : all) (computed.*kind).output(k) += missing;
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
  std::vector<const Model*> models{&model};
  result.models.push_back({options.model_name.empty() ? "this model" : options.model_name,
                           model.states(),
                           known_to(model, whole, tested),
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
    ComputedOutputs& own = computed.back();
    result.models[i].simulated = own.simulation;
    for (const Ensemble* outputs : {&own.simulation, &own.one_step, &own.ahead})
      result.from = std::max(result.from, first_step(*outputs));
  }
  for (Ensemble ComputedOutputs::*kind :
       {&ComputedOutputs::simulation, &ComputedOutputs::one_step, &ComputedOutputs::ahead})
    keep_common(computed, kind, result.from);
  for (size_t i = 0; i < models.size(); ++i) {
    ComparedModel& one = result.models[i];
    one.simulation = fit(data, computed[i].simulation, model.y_nominal);
    one.one_step = fit(data, computed[i].one_step, model.y_nominal);
    one.ahead = fit(data, computed[i].ahead, model.y_nominal);
  }
  return result;
}

}  // namespace tokid::report
