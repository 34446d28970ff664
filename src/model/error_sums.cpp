// SPDX-License-Identifier: BSD-3-Clause
#include "model/error_sums.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/nan.hpp"
#include "base/rounding.hpp"

namespace tokid {

namespace {

// The sums of an output, without those of its errors. They are empty if a sample is missing.
ErrorSums sums_of_all(const Eigen::Ref<const Vector>& y) {
  ErrorSums s;
  const double sum = y.sum();
  if (std::isnan(sum) || y.size() == 0) return s;
  s.count = y.size();
  s.mean = sum / double(s.count);
  s.spread = (y.array() - s.mean).square().sum();
  return s;
}

// The sums of one output at one step, over the experiments that have both a sample and an error. If all experiments
// have both, the sums of y are reused.
ErrorSums sums_of_both(const Eigen::Ref<const Vector>& y, const Eigen::Ref<const Vector>& error,
                       const ErrorSums& of_all) {
  ErrorSums s = of_all;
  s.error = error.squaredNorm();
  if (s.count > 0 && !std::isnan(s.error)) return s;
  s = {};
  for (Index n = 0; n < y.size(); ++n)
    if (!std::isnan(error(n))) s.mean += y(n), s.error += error(n) * error(n), ++s.count;
  if (s.count > 0) s.mean /= double(s.count);
  for (Index n = 0; n < y.size(); ++n)
    if (!std::isnan(error(n))) s.spread += (y(n) - s.mean) * (y(n) - s.mean);
  return s;
}

}  // namespace

void ErrorSums::add(const ErrorSums& later) {
  if (later.count == 0) return;
  const double total = double(count + later.count), gap = later.mean - mean;
  spread += later.spread + gap * gap * double(count) * double(later.count) / total;
  mean += gap * double(later.count) / total;
  error += later.error;
  count += later.count;
}

void ErrorTotals::add(const ErrorTotals& later) {
  if (one_step.empty()) one_step.resize(later.one_step.size()), simulation.resize(later.simulation.size());
  for (size_t j = 0; j < one_step.size(); ++j) {
    one_step[j].add(later.one_step[j]);
    simulation[j].add(later.simulation[j]);
  }
  innovation += later.innovation;
  output += later.output;
}

bool ErrorTotals::noisy() const { return innovation > rounding_share * rounding_share * output; }

Fit fit_of(const std::vector<ErrorSums>& sums, bool departures) {
  const Index m = Index(sums.size());
  Fit result{Vector::Constant(m, nan), Vector::Constant(m, nan), std::numeric_limits<Index>::max()};
  for (Index j = 0; j < m; ++j) {
    const ErrorSums& s = sums[size_t(j)];
    result.samples = std::min(result.samples, s.count);
    if (s.count == 0) continue;
    const double spread = s.spread + (departures ? double(s.count) * s.mean * s.mean : 0.0);
    result.rmse(j) = std::sqrt(s.error / double(s.count));
    result.fit(j) = spread > 0 ? 100 * (1 - std::sqrt(s.error / spread)) : s.error > 0 ? nan : 100.0;
  }
  return result;
}

ErrorCollector::ErrorCollector(const Ensemble& data, const Matrix& y_nominal, Index first_step)
    : data_(data), y_nominal_(y_nominal), first_step_(first_step) {
  totals.one_step.resize(size_t(data.outputs()));
  totals.simulation.resize(size_t(data.outputs()));
}

void ErrorCollector::predicted(Index k, const Matrix& error) {
  for (Index j = 0; j < error.cols(); ++j) {
    const ErrorSums s = sums_of(k, error, j);
    any_predicted = any_predicted || s.count > 0;
    if (k >= first_step_) {
      if (s.count > 0 && !first_predicted) first_predicted = k;
      totals.one_step[size_t(j)].add(s);
    }
    totals.innovation += s.error;
    totals.output += s.spread + double(s.count) * s.mean * s.mean;
  }
}

void ErrorCollector::simulated(Index k, const Matrix& error) {
  if (k < first_step_) return;
  for (Index j = 0; j < error.cols(); ++j) {
    const ErrorSums s = sums_of(k, error, j);
    if (s.count > 0 && !first_simulated) first_simulated = k;
    totals.simulation[size_t(j)].add(s);
  }
}

ErrorSums ErrorCollector::sums_of(Index k, const Matrix& error, Index j) {
  const auto departure = [&](Index i) -> const Vector& {
    y_ = data_.output(k).col(i);
    if (k < y_nominal_.rows()) y_.array() -= y_nominal_(k, i);
    return y_;
  };
  if (k != step_) {
    step_ = k;
    outputs_.clear();
    for (Index i = 0; i < data_.outputs(); ++i) outputs_.push_back(sums_of_all(departure(i)));
  }
  return sums_of_both(departure(j), error.col(j), outputs_[size_t(j)]);
}

}  // namespace tokid
