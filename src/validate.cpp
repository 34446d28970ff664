// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "em/smoother.hpp"
#include "judged.hpp"
#include "nan.hpp"
#include "regressions.hpp"
#include "tokid/remarks.hpp"

namespace tokid {

namespace {

// Calls use(y, ŷ, k) with arrays of the samples of output j that are both measured and computed, step by step.
template <class Use>
void for_each_pair(const Ensemble& measured, const Ensemble& computed, Index j, Use&& use) {
  Vector y, y_hat;
  for (Index k = 0; k < measured.steps(); ++k) {
    const auto all = measured.output(k).col(j);
    const auto all_hat = computed.output(k).col(j);
    if (std::isfinite((all - all_hat).sum())) {
      use(all.array(), all_hat.array(), k);
      continue;
    }
    y.resize(all.size());
    y_hat.resize(all.size());
    Index count = 0;
    for (Index n = 0; n < all.size(); ++n)
      if (!std::isnan(all(n)) && !std::isnan(all_hat(n))) {
        y(count) = all(n);
        y_hat(count++) = all_hat(n);
      }
    use(y.head(count).array(), y_hat.head(count).array(), k);
  }
}

}  // namespace

Fit fit(const Ensemble& measured, const Ensemble& computed, const Matrix& y_nominal) {
  if (measured.experiments() != computed.experiments() || measured.steps() != computed.steps() ||
      measured.outputs() != computed.outputs())
    throw std::invalid_argument(fmt::format("fit: {} x {} x {} measured and {} x {} x {} computed outputs",
                                            measured.experiments(), measured.steps(), measured.outputs(),
                                            computed.experiments(), computed.steps(), computed.outputs()));
  const Index m = measured.outputs();
  Fit result{Vector::Constant(m, nan), Vector::Constant(m, nan), std::numeric_limits<Index>::max()};
  for (Index j = 0; j < m; ++j) {
    double sum = 0.0, error = 0.0, spread = 0.0;
    Index count = 0;
    for_each_pair(measured, computed, j, [&](const auto& y, const auto& y_hat, Index) {
      sum += y.sum();
      error += (y - y_hat).square().sum();
      count += y.size();
    });
    result.samples = std::min(result.samples, count);
    if (count == 0) continue;
    const double mean = sum / double(count);
    for_each_pair(measured, computed, j, [&](const auto& y, const auto&, Index k) {
      spread += (y - (k < y_nominal.rows() ? y_nominal(k, j) : mean)).square().sum();
    });
    result.rmse(j) = std::sqrt(error / double(count));
    result.fit(j) = spread > 0 ? 100 * (1 - std::sqrt(error / spread)) : error > 0 ? nan : 100.0;
  }
  return result;
}

Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  if (ends_early(model, data.steps())) return simulate_data(continued(model, data.steps()), data, initial_state);
  const InitialState initial = initial_state.value_or(data.initial_state.value_or(model.initial_state));
  if (starts_from_zero(model, initial))
    return simulate(model, data, Matrix::Zero(model.state_dim.front(), data.experiments()));
  if (has_initial_estimate(model, initial) && Index(model.Q.size()) == model.steps() &&
      Index(model.R.size()) == model.steps())
    return simulate(
        model, data,
        em::smoothed_first_states(model, em::samples_of(model, data, em::Tail::drop, estimation_window(model))));
  const Index start = model.full_begin(), window = estimation_window(model);
  if (start + window <= std::min(model.k_end(), data.steps()))
    return simulate(from_step(model, start), data, estimate_state(model, data, start, window));
  Ensemble unknown = simulate(model, data);
  for (Index k = 0; k < data.steps(); ++k) unknown.output(k).setConstant(nan);
  return unknown;
}

namespace {

// Divided by their standard deviations, so that those of different steps may be pooled; tests over the experiments are
// blind to it.
Innovations standardised(const Model& model, Innovations innovations) {
  for (size_t s = 0; s < model.innovation_cov.size(); ++s) {
    const size_t k = size_t(model.k_begin) + s;
    const Vector variance = model.innovation_cov[s].diagonal();
    if (k < innovations.size() && variance.minCoeff() > 0)
      innovations[k] *= variance.cwiseSqrt().cwiseInverse().asDiagonal();
  }
  return innovations;
}

}  // namespace

Judged judge(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return judge(continued(model, data.steps()), data, options);
  if (std::min(model.k_end(), data.steps()) <= model.k_begin)
    throw std::invalid_argument(
        fmt::format("data: {} steps found, the model begins at step {}", data.steps(), model.k_begin));
  PredictOptions one_step{1, options.initial_state}, ahead{options.horizon, options.initial_state};
  Judged judged;
  judged.prediction = predict(model, data, one_step);
  judged.simulated = simulate_data(model, data, options.initial_state);
  Validation& result = judged.validation;
  const Prediction& prediction = judged.prediction;
  result.one_step = fit(data, prediction.y, model.y_nominal);
  result.horizon = options.horizon == 1 ? result.one_step : fit(data, predict(model, data, ahead).y, model.y_nominal);

  result.simulation = fit(data, judged.simulated, model.y_nominal);
  while (result.first_simulated + 1 < data.steps() &&
         judged.simulated.output(result.first_simulated).array().isNaN().all())
    ++result.first_simulated;

  double innovation = 0.0, output = 0.0;
  bool any = false;
  for (Index k = 0; k < data.steps(); ++k) {
    const Matrix& e = prediction.innovations[size_t(k)];
    bool predicted = false;
    for (Index j = 0; j < e.cols(); ++j) {
      const double nominal = k < model.y_nominal.rows() ? model.y_nominal(k, j) : 0.0;
      const auto all = e.col(j).array();
      const auto y = data.output(k).col(j).array() - nominal;
      if (std::isfinite(all.sum())) {
        predicted = predicted || all.size() > 0;
        innovation += all.square().sum();
        output += y.square().sum();
        continue;
      }
      for (Index n = 0; n < e.rows(); ++n) {
        if (std::isnan(all(n))) continue;
        predicted = true;
        innovation += all(n) * all(n);
        output += y(n) * y(n);
      }
    }
    if (predicted && !any) result.first_predicted = k;
    any = any || predicted;
  }
  const Vector untested = Vector::Constant(model.inputs, nan);
  result.gains = {untested, untested, untested};
  // No test of noise applies to errors of arithmetic.
  result.noisy = innovation > rounding_share * rounding_share * output;
  if (result.noisy && options.whiteness_lags > 0) {
    const Innovations e = model_innovations(model, data, options.initial_state);
    const Innovations scaled = standardised(model, e);
    result.whiteness = whiteness(scaled, options.whiteness_lags);
    result.independence = independence(scaled, data, 0, options.whiteness_lags);
    result.feedback = independence(scaled, data, -options.whiteness_lags, -1);
    result.squares = normalised_squares(model, e);
    result.gains = input_gains(model, data, prediction.innovations);
  }
  result.whiteness_p = result.whiteness.p;
  if (!any)
    result.warnings.push_back(
        fmt::format("no step could be predicted: the model covers steps {} to {}, and {} steps are "
                    "needed to find an unknown initial state",
                    model.k_begin, model.k_end() - 1, estimation_window(model)));
  if (auto beyond = steps_beyond(model, data)) result.warnings.push_back(*std::move(beyond));
  if (options.horizon > 1 && result.horizon.samples == 0)
    result.warnings.push_back(fmt::format("no step could be predicted {} steps ahead", options.horizon));
  if (!result.simulation.rmse.allFinite() && result.simulation.samples > 0)
    result.warnings.emplace_back("the simulation overflows: the model is unstable over its steps");
  return judged;
}

Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  return judge(model, data, options).validation;
}

}  // namespace tokid
