// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "statistics.hpp"

namespace tokid {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
// Innovations below this share of the outputs are errors of arithmetic, which no test of noise applies to.
constexpr double arithmetic = 1e-9;

// Calls use(y, ŷ, k) for every sample of output j that is both measured and computed.
template <class Use>
void for_each_pair(const Ensemble& measured, const Ensemble& computed, Index j, Use&& use) {
  for (Index k = 0; k < measured.steps(); ++k)
    for (Index n = 0; n < measured.experiments(); ++n) {
      const double y = measured.y(n, k, j), y_hat = computed.y(n, k, j);
      if (!std::isnan(y) && !std::isnan(y_hat)) use(y, y_hat, k);
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
    for_each_pair(measured, computed, j, [&](double y, double y_hat, Index) {
      sum += y;
      error += (y - y_hat) * (y - y_hat);
      ++count;
    });
    result.samples = std::min(result.samples, count);
    if (count == 0) continue;
    const double mean = sum / double(count);
    for_each_pair(measured, computed, j, [&](double y, double, Index k) {
      const double reference = k < y_nominal.rows() ? y_nominal(k, j) : mean;
      spread += (y - reference) * (y - reference);
    });
    result.rmse(j) = std::sqrt(error / double(count));
    result.fit(j) = spread > 0 ? 100 * (1 - std::sqrt(error / spread)) : error > 0 ? nan : 100.0;
  }
  return result;
}

namespace {

// Orthonormal basis, over the given experiments, of what their centred innovations span.
Matrix centred_basis(const Matrix& innovations, const std::vector<Index>& rows) {
  Matrix centred = innovations(rows, Eigen::all);
  centred.rowwise() -= Eigen::RowVectorXd(centred.colwise().mean());
  const linalg::Svd d = linalg::svd(centred);
  return d.u.leftCols((d.s.array() > 1e-12 * d.s(0)).count());
}

// The innovations of one step over the experiments that have all of them.
struct StepInnovations {
  std::vector<Index> rows;
  Matrix basis;
};

StepInnovations step_innovations(const Matrix& innovations) {
  StepInnovations step;
  for (Index n = 0; n < innovations.rows(); ++n)
    if (innovations.row(n).allFinite()) step.rows.push_back(n);
  if (static_cast<Index>(step.rows.size()) > innovations.cols() + 2) step.basis = centred_basis(innovations, step.rows);
  return step;
}

}  // namespace

double whiteness_p(const std::vector<Matrix>& innovations, Index lags) {
  std::vector<StepInnovations> step;
  step.reserve(innovations.size());
  for (const Matrix& e : innovations) step.push_back(step_innovations(e));

  double excess = 0.0, variance = 0.0;
  const auto add = [&](const Matrix& a, const Matrix& b, size_t experiments) {
    const double p = double(a.cols()), q = double(b.cols()), nu = double(experiments) - 1;
    excess += (a.transpose() * b).squaredNorm() - p * q / nu;  // Pillai's trace less its mean
    variance += 2 * p * q * (nu - p) * (nu - q) / (nu * nu * (nu - 1) * (nu + 2));
  };
  for (size_t k = 1; k < step.size(); ++k)
    for (size_t j = 1; j <= std::min(size_t(lags), k); ++j) {
      const StepInnovations &now = step[k], &before = step[k - j];
      if (now.basis.cols() == 0 || before.basis.cols() == 0) continue;
      if (now.rows == before.rows) {
        add(now.basis, before.basis, now.rows.size());
        continue;
      }
      std::vector<Index> both;
      std::set_intersection(now.rows.begin(), now.rows.end(), before.rows.begin(), before.rows.end(),
                            std::back_inserter(both));
      if (static_cast<Index>(both.size()) > innovations[k].cols() + 2)
        add(centred_basis(innovations[k], both), centred_basis(innovations[k - j], both), both.size());
    }
  return variance > 0 ? statistics::normal_tail(excess / std::sqrt(variance)) : nan;
}

Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (std::min(model.k_end(), data.steps()) <= model.k_begin)
    throw std::invalid_argument(
        fmt::format("data: {} steps found, the model begins at step {}", data.steps(), model.k_begin));
  Validation result;
  PredictOptions one_step{1, options.initial_state}, ahead{options.horizon, options.initial_state};
  const InitialState initial = options.initial_state.value_or(data.initial_state.value_or(model.initial_state));

  const Prediction prediction = predict(model, data, one_step);
  result.one_step = fit(data, prediction.y, model.y_nominal);
  result.horizon = options.horizon == 1 ? result.one_step : fit(data, predict(model, data, ahead).y, model.y_nominal);

  // A simulation needs an initial state: the known one, or the one that the first samples tell.
  if (starts_from_zero(model, initial)) {
    result.simulation = fit(data, simulate(model, data), model.y_nominal);
  } else {
    const Index start = model.full_begin(), window = estimation_window(model);
    Ensemble simulated = prediction.y;
    for (Index k = 0; k < data.steps(); ++k) simulated.output(k).setConstant(nan);
    if (start + window <= std::min(model.k_end(), data.steps()))
      simulated = simulate(from_step(model, start), data, estimate_state(model, data, start, window));
    result.simulation = fit(data, simulated, model.y_nominal);
  }

  double innovation = 0.0, output = 0.0;
  bool any = false;
  for (Index k = 0; k < data.steps(); ++k) {
    const Matrix& e = prediction.innovations[size_t(k)];
    const bool predicted = (e.array() == e.array()).any();
    if (!predicted) continue;
    if (!any) result.first_predicted = k;
    any = true;
    for (Index j = 0; j < e.cols(); ++j)
      for (Index n = 0; n < e.rows(); ++n) {
        if (std::isnan(e(n, j))) continue;
        const double y = data.y(n, k, j) - (k < model.y_nominal.rows() ? model.y_nominal(k, j) : 0.0);
        innovation += e(n, j) * e(n, j);
        output += y * y;
      }
  }
  result.whiteness_p =
      innovation > arithmetic * arithmetic * output ? whiteness_p(prediction.innovations, options.whiteness_lags) : nan;
  if (!any)
    result.warnings.push_back(
        fmt::format("no step could be predicted: the model covers steps {} to {}, and {} steps are "
                    "needed to find an unknown initial state",
                    model.k_begin, model.k_end() - 1, estimation_window(model)));
  if (options.horizon > 1 && result.horizon.samples == 0)
    result.warnings.push_back(fmt::format("no step could be predicted {} steps ahead", options.horizon));
  if (!result.simulation.rmse.allFinite() && result.simulation.samples > 0)
    result.warnings.push_back("the simulation overflows: the model is unstable over its steps");
  return result;
}

}  // namespace tokid
