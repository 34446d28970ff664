// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "data/subjects.hpp"
#include "model/channels.hpp"
#include "model/comparison.hpp"
#include "model/continuation.hpp"
#include "model/error_sums.hpp"
#include "model/outlying_samples.hpp"
#include "model/step_by_step.hpp"
#include "tokid/copies.hpp"

namespace tokid {

Fit fit(const Ensemble& measured, const Ensemble& computed, const Matrix& y_nominal, Index first_step) {
  if (measured.experiments() != computed.experiments() || measured.steps() != computed.steps() ||
      measured.outputs() != computed.outputs())
    throw std::invalid_argument(
        fmt::format("fit: {} x {} x {} measured and {} x {} x {} computed outputs found, equal sizes needed",
                    measured.experiments(), measured.steps(), measured.outputs(), computed.experiments(),
                    computed.steps(), computed.outputs()));
  check_first_step(first_step, measured.steps());
  ErrorCollector errors(measured, y_nominal, first_step);
  for (Index k = first_step; k < measured.steps(); ++k) errors.simulated(k, measured.output(k) - computed.output(k));
  return fit_of(errors.totals.simulation, y_nominal.rows() > 0);
}

namespace {

// Divides the innovations by their standard deviations, so that innovations of different steps can be pooled. Tests
// over the experiments give the same result with and without this scaling.
Innovations standardised(const Model& model, Innovations innovations) {
  for (size_t s = 0; model.has(&Step::has_innovation_cov) && s < model.step.size(); ++s) {
    const size_t k = size_t(model.k_begin) + s;
    const Vector variance = model.step[s].innovation_cov().diagonal();
    if (k < innovations.size() && variance.minCoeff() > 0)
      innovations[k] *= variance.cwiseSqrt().cwiseInverse().asDiagonal();
  }
  return innovations;
}

// Computes the validation from the errors of all steps. It calls innovations() only if they are tested. `tested` gets
// the innovations of the tests, if it is not null.
template <class OneStepErrors>
Validation validation(const Model& model, const Ensemble& data, const ValidateOptions& options,
                      const ErrorCollector& errors, OutlyingSampleCollector& outlying, OneStepErrors&& innovations,
                      Innovations* tested = nullptr) {
  const bool departures = model.y_nominal.rows() > 0;
  Validation result;
  result.one_step = result.horizon = fit_of(errors.totals.one_step, departures);
  result.simulation = fit_of(errors.totals.simulation, departures);
  if (options.horizon != 1) result.horizon = horizon_fit(model, data, options);
  result.first_predicted = errors.first_predicted.value_or(options.first_step);
  result.first_simulated = errors.first_simulated.value_or(data.steps() - 1);
  const Vector untested = Vector::Constant(model.inputs, nan);
  result.gains = {untested, untested, untested};
  // Tests of noise do not apply if the innovations are only rounding errors.
  result.noisy = errors.totals.noisy();
  if (result.noisy) result.outlying = outlying.found();
  if (result.noisy && options.whiteness_lags > 0) {
    {
      Innovations e = model_innovations(model, data, options.initial_state);
      result.squares = normalised_squares(model, e);
      e = standardised(model, std::move(e));
      result.whiteness = whiteness(e, options.whiteness_lags);
      // Without feedthrough, an input may respond to the output of its own step.
      const Index first = has_feedthrough(model.provenance) ? 0 : 1;
      result.independence = independence(e, data, first, options.whiteness_lags);
      result.feedback = independence(e, data, -options.whiteness_lags, first - 1);
      if (tested) *tested = std::move(e);
    }
    result.gains = input_gains(model, data, innovations());
  }
  result.whiteness_p = result.whiteness.p;
  if (!errors.any_predicted)
    result.findings.push_back({.kind = Finding::Kind::nothing_predicted,
                               .numbers = {{"begin", double(model.k_begin)},
                                           {"end", double(model.k_end() - 1)},
                                           {"needed", double(estimation_window(model))}}});
  append(result.findings, findings_of_end(model, data));
  if (options.horizon > 1 && result.horizon.samples == 0)
    result.findings.push_back(
        {.kind = Finding::Kind::nothing_predicted_ahead, .numbers = {{"horizon", double(options.horizon)}}});
  if (!result.simulation.rmse.allFinite() && result.simulation.samples > 0)
    result.findings.push_back({.kind = Finding::Kind::simulation_overflows});
  return result;
}

void name_outlying(Validation& validation, const Channels& channels) {
  append(validation.findings, findings_of(validation.outlying, channels));
}

}  // namespace

void check_first_step(Index first_step, Index end) {
  if (first_step < 0 || first_step >= std::max<Index>(end, 1))
    throw std::invalid_argument(fmt::format(
        "first_step: {} found, 0 to {} needed. That is the last step that can be compared", first_step, end - 1));
}

void check_steps(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (std::min(model.k_end(), data.steps()) <= model.k_begin)
    throw std::invalid_argument(
        fmt::format("data: {} steps found, the model begins at step {}", data.steps(), model.k_begin));
  check_first_step(options.first_step, std::min(model.k_end(), data.steps()));
}

Fit horizon_fit(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  return fit(data, predict(model, data, {options.horizon, options.initial_state}).y, model.y_nominal,
             options.first_step);
}

Comparison compare(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return compare(continued(model, data.steps()), data, options);
  check_steps(model, data, options);
  Comparison compared;
  compared.prediction = predict(model, data, {1, options.initial_state});
  compared.simulated = simulate_data(model, data, options.initial_state);
  ErrorCollector errors(data, model.y_nominal, options.first_step);
  OutlyingSampleCollector outlying(model, data, options);
  for (Index k = 0; k < data.steps(); ++k) {
    outlying.add(k, compared.prediction.innovations[size_t(k)]);
    errors.predicted(k, compared.prediction.innovations[size_t(k)]);
    errors.simulated(k, data.output(k) - compared.simulated.output(k));
  }
  compared.validation = validation(
      model, data, options, errors, outlying,
      [&compared]() -> const Innovations& { return compared.prediction.innovations; }, &compared.tested);
  compared.experiments =
      experiment_fits(model, data, compared.prediction.innovations, compared.simulated, options.first_step);
  return compared;
}

Validation validate_in_numbers(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return validate_in_numbers(continued(model, data.steps()), data, options);
  check_steps(model, data, options);
  ErrorCollector errors(data, model.y_nominal, options.first_step);
  OutlyingSampleCollector outlying(model, data, options);
  predict_each(model, data, options.initial_state, [&](Index k, const Matrix& innovation) {
    outlying.add(k, innovation);
    errors.predicted(k, innovation);
  });
  Matrix error;
  simulate_data_each(model, data, options.initial_state, [&](Index k, const Matrix& y) {
    error = data.output(k) - y;
    subtract_nominal(model.y_nominal, k, error);
    errors.simulated(k, error);
  });
  return validation(model, data, options, errors, outlying, [&] {
    Innovations all(size_t(data.steps()), Matrix::Constant(data.experiments(), model.outputs, nan));
    predict_each(model, data, options.initial_state,
                 [&](Index k, const Matrix& innovation) { all[size_t(k)] = innovation; });
    return all;
  });
}

Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  Validation result = validate_in_numbers(model, data, options);
  name_outlying(result, data.names);
  return result;
}

Validation validate_distinct(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  check_channels(model, data, true);  // messages then name the caller's rows, not those of the part
  const UsedExperiments used = used_experiments(data);
  if (used.all(data)) return validate(model, data, options);
  const Ensemble part = data.subset(used.rows);
  Validation result = validate_in_numbers(model, part, options);
  result.outlying = outlying_in(data, part, 0, std::move(result.outlying));
  name_outlying(result, data.names);
  const Findings dropped = findings_of(used, data);
  result.findings.insert(result.findings.begin(), dropped.begin(), dropped.end());
  return result;
}

}  // namespace tokid
