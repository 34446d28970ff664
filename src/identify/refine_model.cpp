// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/refine_model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "data/extents.hpp"
#include "data/unused.hpp"
#include "model/channels.hpp"
#include "tokid/copies.hpp"
#include "tokid/identify.hpp"

namespace tokid {

namespace {

// If the model does not record λ, this number of folds chooses λ, with at most this number of iterations in each fold.
constexpr Index folds = 3, iterations = 20;

// All folds start from the same model. This model may have been identified from the held-out experiments, but the
// iterations do not use them.
void choose(const Model& model, const Ensemble& data, const RefineModelOptions& options, RefinedModel& result) {
  if (!options.smoothing && options.refine.period.value_or(model.period) == 1) {
    result.reason = "one model serving all steps";
  } else if (options.smoothing) {
    result.smoothing = *options.smoothing;
    result.reason = "as asked";
  } else if (model.provenance.refinement) {
    result.smoothing = model.provenance.refinement->smoothing;
    result.reason = "as the model was identified";
  } else if (data.experiments() < 2 * folds) {
    result.smoothing = 1.0;
    result.reason = "too few experiments to choose lambda";
  } else {
    RefineOptions trial = options.refine;
    trial.iterations = std::min(trial.iterations, iterations);
    result.choice = choose_smoothing(std::vector<Model>(size_t(folds), model), data, trial);
    result.smoothing = result.choice.best;
    result.reason = fmt::format("by the likelihood in cross-validation, {} folds", folds);
  }
}

// Compares both models on the samples that both can compute.
void compare(const Model& model, const Ensemble& data, std::optional<InitialState> initial, RefinedModel& result) {
  const Model& refined = result.refinement.model;
  const auto fits = [&](Ensemble own, Ensemble other, Fit RefinementFigures::*target) {
    for (Index k = 0; k < data.steps(); ++k) {
      const auto neither = (own.output(k).array().isNaN() || other.output(k).array().isNaN()).eval();
      own.output(k) = neither.select(nan, own.output(k)).eval();
      other.output(k) = neither.select(nan, other.output(k)).eval();
    }
    result.before.*target = fit(data, own, model.y_nominal);
    result.after.*target = fit(data, other, refined.y_nominal);
  };
  const PredictOptions one_step{1, initial};
  fits(predict(model, data, one_step).y, predict(refined, data, one_step).y, &RefinementFigures::one_step);
  fits(simulate_data(model, data, initial), simulate_data(refined, data, initial), &RefinementFigures::simulation);
  ValidateOptions validation;
  validation.initial_state = initial;
  result.before.whiteness_p = validate(model, data, validation).whiteness_p;
  result.after.whiteness_p = validate(refined, data, validation).whiteness_p;
}

}  // namespace

RefinedModel refine_model(const Model& model, const Ensemble& data, const RefineModelOptions& options) {
  check_channels(model, data, true);  // messages then name the caller's rows, not those of a part
  RefinedModel result;
  if (const UsedExperiments used = used_experiments(data); !used.all(data)) {  // copies would count twice
    result = with_remark_on_unused(data, [&] { return refine_model(model, data.subset(used.rows), options); });
    note_data(result.refinement.model.provenance, fingerprint(data));
    const Findings dropped = findings_of(used, data);
    result.findings.insert(result.findings.begin(), dropped.begin(), dropped.end());
    return result;
  }
  if (options.refine.period.value_or(model.period) == 0)
    if (const Extent steps = reached(data, fewest_at_a_step); steps.end < data.steps()) {
      result = refine_model(model, begin_of(data, steps.end), options);
      note_data(result.refinement.model.provenance, fingerprint(data));
      const Findings unused = findings_of_reach(data, range(0, data.experiments()), {0, steps.end}, fewest_at_a_step);
      result.findings.insert(result.findings.begin(), unused.begin(), unused.end());
      return result;
    }
  if (!options.refine.feedthrough)
    throw std::invalid_argument("refine.feedthrough: false found, true needed. State it by feedthrough of the options");
  RefineModelOptions part = options;
  part.refine.feedthrough = options.feedthrough.value_or(has_feedthrough(model.provenance));
  if (options.refine.jumps.empty() && model.provenance.choices && options.refine.period.value_or(model.period) == 0)
    for (const Index step : model.provenance.choices->variation.jumps)
      if (step < data.steps()) part.refine.jumps.push_back(step);
  part.refine.execution = share(options.refine.execution, 0.0, 0.5);
  choose(model, data, part, result);
  part.refine.execution = share(options.refine.execution, 0.5, 1.0);
  part.refine.smoothing = result.smoothing;
  if (std::isinf(result.smoothing)) part.refine.jumps.clear();
  result.refinement = refine(model, data, part.refine);
  Provenance& provenance = result.refinement.model.provenance;
  note_data(provenance, fingerprint(data));
  // EM also changes the states that held inputs.
  if (options.refine.estimate_matrices && provenance.choices) provenance.choices->delays.clear();
  provenance.refinement = {result.smoothing, result.refinement.iterations};
  if (options.feedthrough)
    provenance.feedthrough = {.present = *options.feedthrough, .reason = FeedthroughChoice::Reason::stated};
  provenance.version = version;
  compare(model, data, options.refine.initial_state, result);
  result.findings = differences(model, data);
  append(result.findings, result.refinement.findings);
  return result;
}

}  // namespace tokid
