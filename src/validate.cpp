// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "judged.hpp"
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

// The innovations of one step over the given experiments, less their mean: columns of norm 1, and an orthonormal basis
// of what they span.
struct Centred {
  Matrix columns, basis;
};

Centred centred(const Matrix& innovations, const std::vector<Index>& rows) {
  Centred c;
  c.columns = innovations(rows, Eigen::all);
  c.columns.rowwise() -= Eigen::RowVectorXd(c.columns.colwise().mean());
  const linalg::Svd d = linalg::svd(c.columns);
  c.basis = d.u.leftCols((d.s.array() > 1e-12 * d.s(0)).count());
  for (auto column : c.columns.colwise())
    if (const double norm = column.norm(); norm > 0) column /= norm;
  return c;
}

// The innovations of one step over the experiments that have all of them.
struct StepInnovations {
  std::vector<Index> rows;
  Centred over;
};

StepInnovations step_innovations(const Matrix& innovations) {
  StepInnovations step;
  for (Index n = 0; n < innovations.rows(); ++n)
    if (innovations.row(n).allFinite()) step.rows.push_back(n);
  if (static_cast<Index>(step.rows.size()) > innovations.cols() + 2) step.over = centred(innovations, step.rows);
  return step;
}

// Sums over the steps for one lag.
struct LagSum {
  double excess = 0.0, variance = 0.0;  // Pillai's traces less their means, and their variances
  Vector correlation;                   // (m)
  double correlation_variance = 0.0;
  Index steps = 0;

  void add(const Centred& now, const Centred& before) {
    const double p = double(now.basis.cols()), q = double(before.basis.cols()), nu = double(now.columns.rows()) - 1;
    excess += (now.basis.transpose() * before.basis).squaredNorm() - p * q / nu;
    variance += 2 * p * q * (nu - p) * (nu - q) / (nu * nu * (nu - 1) * (nu + 2));
    correlation += now.columns.cwiseProduct(before.columns).colwise().sum().transpose();
    correlation_variance += 1 / nu;
    ++steps;
  }
};

}  // namespace

Whiteness whiteness(const std::vector<Matrix>& innovations, Index lags) {
  std::vector<StepInnovations> step;
  step.reserve(innovations.size());
  for (const Matrix& e : innovations) step.push_back(step_innovations(e));
  const Index m = innovations.empty() ? 0 : innovations.front().cols();

  std::vector<LagSum> sums(size_t(lags), LagSum{0.0, 0.0, Vector::Zero(m), 0.0, 0});
  for (size_t k = 1; k < step.size(); ++k)
    for (size_t j = 1; j <= std::min(size_t(lags), k); ++j) {
      const StepInnovations &now = step[k], &before = step[k - j];
      if (now.over.basis.cols() == 0 || before.over.basis.cols() == 0) continue;
      if (now.rows == before.rows) {
        sums[j - 1].add(now.over, before.over);
        continue;
      }
      std::vector<Index> both;
      std::set_intersection(now.rows.begin(), now.rows.end(), before.rows.begin(), before.rows.end(),
                            std::back_inserter(both));
      if (static_cast<Index>(both.size()) > innovations[k].cols() + 2)
        sums[j - 1].add(centred(innovations[k], both), centred(innovations[k - j], both));
    }

  constexpr double two_sided_99 = 2.5758293035489;  // quantile of the normal distribution
  Whiteness result{nan, Vector::Constant(lags, nan), Matrix::Constant(lags, m, nan), Vector::Constant(lags, nan)};
  double excess = 0.0, variance = 0.0;
  for (Index j = 0; j < lags; ++j) {
    const LagSum& sum = sums[size_t(j)];
    excess += sum.excess;
    variance += sum.variance;
    if (sum.variance > 0) result.z(j) = sum.excess / std::sqrt(sum.variance);
    if (sum.steps == 0) continue;
    result.correlation.row(j) = sum.correlation.transpose() / double(sum.steps);
    result.bound(j) = two_sided_99 * std::sqrt(sum.correlation_variance) / double(sum.steps);
  }
  if (variance > 0) result.p = statistics::normal_tail(excess / std::sqrt(variance));
  return result;
}

double whiteness_p(const std::vector<Matrix>& innovations, Index lags) { return whiteness(innovations, lags).p; }

Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  const InitialState initial = initial_state.value_or(data.initial_state.value_or(model.initial_state));
  if (starts_from_zero(model, initial)) return simulate(model, data);
  const Index start = model.full_begin(), window = estimation_window(model);
  if (start + window <= std::min(model.k_end(), data.steps()))
    return simulate(from_step(model, start), data, estimate_state(model, data, start, window));
  Ensemble unknown = simulate(model, data);
  for (Index k = 0; k < data.steps(); ++k) unknown.output(k).setConstant(nan);
  return unknown;
}

Judged judge(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (std::min(model.k_end(), data.steps()) <= model.k_begin)
    throw std::invalid_argument(
        fmt::format("data: {} steps found, the model begins at step {}", data.steps(), model.k_begin));
  PredictOptions one_step{1, options.initial_state}, ahead{options.horizon, options.initial_state};
  Judged judged{{}, predict(model, data, one_step), simulate_data(model, data, options.initial_state)};
  Validation& result = judged.validation;
  const Prediction& prediction = judged.prediction;
  result.one_step = fit(data, prediction.y, model.y_nominal);
  result.horizon = options.horizon == 1 ? result.one_step : fit(data, predict(model, data, ahead).y, model.y_nominal);

  result.simulation = fit(data, judged.simulated, model.y_nominal);

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
  result.whiteness_p = nan;
  result.noisy = innovation > arithmetic * arithmetic * output;
  if (result.noisy) {
    result.whiteness = whiteness(prediction.innovations, options.whiteness_lags);
    result.whiteness_p = result.whiteness.p;
  }
  if (!any)
    result.warnings.push_back(
        fmt::format("no step could be predicted: the model covers steps {} to {}, and {} steps are "
                    "needed to find an unknown initial state",
                    model.k_begin, model.k_end() - 1, estimation_window(model)));
  if (options.horizon > 1 && result.horizon.samples == 0)
    result.warnings.push_back(fmt::format("no step could be predicted {} steps ahead", options.horizon));
  if (!result.simulation.rmse.allFinite() && result.simulation.samples > 0)
    result.warnings.push_back("the simulation overflows: the model is unstable over its steps");
  return judged;
}

Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  return judge(model, data, options).validation;
}

}  // namespace tokid
