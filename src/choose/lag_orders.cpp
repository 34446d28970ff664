// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/lag_orders.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "data/check.hpp"
#include "data/output_weights.hpp"
#include "linalg/orthonormal.hpp"

namespace tokid {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

// Leave-one-out errors of one step for the lag orders 1 … p_max, as logarithms of the ratio of squared errors to
// squared outputs y, averaged over the outputs with their weights.
Vector step_errors(const Ensemble& ensemble, Index k, Index p_max, const LagOrderOptions& options) {
  const Index d = ensemble.channels(), m = ensemble.outputs(), r = options.feedthrough ? ensemble.inputs() : 0;
  const Vector weights = weights_of(options.output_weights, m);
  const std::vector<Index> rows = ensemble.complete_rows(k, p_max);
  const Index count = static_cast<Index>(rows.size());
  Vector error = Vector::Constant(p_max, inf);
  const Index p_tested = std::min(p_max, (count - 1 - r) / d);  // at least one degree of freedom
  if (p_tested < 1) return error;

  Matrix w(count, r + p_tested * d);  // newest lag first
  const bool all = count == ensemble.experiments();
  const auto put = [&](const auto& samples, Index at) {
    if (all)
      w.middleCols(at, samples.cols()) = samples;
    else
      w.middleCols(at, samples.cols()) = samples(rows, Eigen::all);
  };
  if (options.feedthrough) put(ensemble.input(k), 0);
  for (Index j = 1; j <= p_tested; ++j) put(ensemble.samples().middleCols((k - j) * d, d), r + (j - 1) * d);
  w *= linalg::inverse_norms(w).asDiagonal();
  const Matrix y = ensemble.output(k)(rows, Eigen::all);
  linalg::orthonormalise(w);

  Matrix residual = y;
  Vector left = Vector::Ones(count);  // 1 - leverage
  Index used = 0;
  const auto use = [&](Index columns) {
    const auto part = w.middleCols(used, columns);
    residual -= part * (part.transpose() * residual);
    left -= part.rowwise().squaredNorm();
    used += columns;
  };
  use(r);
  for (Index p = 1; p <= p_tested; ++p) {
    use(d);
    double sum = 0.0;
    for (Index j = 0; j < m; ++j) {
      const double scale = y.col(j).squaredNorm();
      // An experiment that alone determines a coefficient (leverage 1) can't be predicted from the others.
      const double loo = (residual.col(j).array() / left.array().max(1e-12)).square().sum();
      sum += scale > 0 ? weights(j) * std::log(std::max(loo / scale, options.exact * options.exact)) : 0.0;
    }
    error(p - 1) = sum / weights.sum();
  }
  return error;
}

}  // namespace

LagOrderErrors lag_order_errors(const Ensemble& ensemble, const LagOrderOptions& options) {
  if (ensemble.experiments() == 0 || ensemble.inputs() == 0 || ensemble.outputs() == 0)
    throw std::invalid_argument(
        fmt::format("ensemble: {} experiments with {} inputs and {} outputs found, at least one of each needed",
                    ensemble.experiments(), ensemble.inputs(), ensemble.outputs()));
  check_samples(ensemble);
  const Index p_max = std::min(options.p_max, ensemble.steps() - 1);
  LagOrderErrors result;
  result.best = std::max<Index>(1, options.p_min);
  if (p_max < 1) return result;

  const Index available = ensemble.steps() - p_max;
  const Index count = std::min(available, std::max<Index>(1, options.steps));
  for (Index s = 0; s < count; ++s) result.steps.push_back(p_max + (2 * s + 1) * available / (2 * count));
  result.error.resize(count, p_max);
  parallel_for(0, count, options.execution, [&](Index begin, Index end) {
    for (Index s = begin; s < end; ++s)
      result.error.row(s) = step_errors(ensemble, result.steps[static_cast<size_t>(s)], p_max, options).transpose();
  });
  // Missing samples may leave too few experiments at some steps. `largest` is the largest order that at least half of
  // the steps can test. All orders are compared at the steps that can test the order `largest`.
  const auto testing_steps = [&](Index p) { return (result.error.col(p - 1).array() < inf).count(); };
  Index largest = p_max;
  while (largest > 1 && 2 * testing_steps(largest) < count) --largest;
  std::vector<Index> rows;
  for (Index s = 0; s < count; ++s)
    if (result.error(s, largest - 1) < inf) rows.push_back(s);
  const Matrix error = result.error(rows, Eigen::all);
  result.mean.setConstant(p_max, inf);
  if (!rows.empty()) result.mean.head(largest) = error.leftCols(largest).colwise().mean().transpose();

  // A smaller order is chosen if its mean error exceeds the smallest one by at most one standard error. This is the
  // standard error of the difference between both orders, over the steps.
  const Index first = std::clamp<Index>(options.p_min, 1, p_max);
  Index smallest = first;
  for (Index p = first; p <= p_max; ++p)
    if (result.mean(p - 1) < result.mean(smallest - 1)) smallest = p;
  result.best = std::max(options.p_min, smallest);
  if (!std::isfinite(result.mean(smallest - 1))) return result;
  for (Index p = first; p < smallest; ++p) {
    const Vector difference = error.col(p - 1) - error.col(smallest - 1);
    const double mean = difference.mean(), steps = double(difference.size());
    const double variance = (difference.array() - mean).square().sum() / std::max(1.0, steps - 1);
    if (mean <= std::sqrt(variance / steps)) {
      result.best = p;
      break;
    }
  }
  return result;
}

}  // namespace tokid
