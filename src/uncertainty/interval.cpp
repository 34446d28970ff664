// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/interval.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/statistics.hpp"

namespace tokid::uncertainty {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr size_t cells = 512;  // of the table; interpolation changes a quantile by less than 1e-5 of its value
// Limits for eigenvalues. `near` is the distance of neighbours relative to the sum of their standard errors.
// `arithmetic` and `fixed` are relative to the norm of the matrix: rounding errors, and the deviation up to which an
// eigenvalue counts as not moving.
constexpr double near = 0.5, arithmetic = 1e-9, fixed = 1e-6;
constexpr double most = 1e7;  // more degrees of freedom than this do not change the quantile

// T² has the F distribution with (1, freedom) degrees.
double quantile(double level, double freedom) {
  return std::sqrt(statistics::f_quantile(level, 1.0, std::min(freedom, most)));
}

}  // namespace

void check_level(double level) {
  if (!(level > 0 && level < 1))
    throw std::invalid_argument(fmt::format("level: {} found, 0 < level < 1 needed", level));
}

StudentT::StudentT(double level) : level_(level) {
  check_level(level);
  for (size_t i = 0; i <= cells; ++i)
    log_quantile_.push_back(std::log(quantile(level, i > 0 ? double(cells) / double(i) : most)));
}

double StudentT::operator()(double freedom) const {
  if (!(freedom >= 1)) return freedom > 0 ? quantile(level_, freedom) : inf;
  const double at = double(cells) / freedom;
  const size_t cell = std::min(size_t(at), cells - 1);
  const double share = at - double(cell);
  return std::exp((1 - share) * log_quantile_[cell] + share * log_quantile_[cell + 1]);
}

Interval interval(Matrix estimate, const Variance& variance, const StudentT& t) {
  Interval result;
  result.deviation = variance.sum.cwiseSqrt();
  result.lower = result.upper = estimate;
  for (Index j = 0; j < estimate.cols(); ++j)
    for (Index i = 0; i < estimate.rows(); ++i) {
      const double v = variance.sum(i, j);
      if (v == 0) continue;
      const double width = std::isfinite(v) ? t(v * (v / variance.spread(i, j))) * result.deviation(i, j) : v;
      result.lower(i, j) -= width;
      result.upper(i, j) += width;
    }
  result.estimate = std::move(estimate);
  return result;
}

void find_simple(SpectrumBounds::Step& step, double norm) {
  const Index n = step.eigenvalues.size();
  Vector deviation(n);
  for (Index i = 0; i < n; ++i) deviation(i) = std::hypot(step.real.deviation(i), step.imaginary.deviation(i));
  const auto distance = [&](Index i, Index j) { return std::abs(step.eigenvalues(i) - step.eigenvalues(j)); };
  const auto moves = [&](Index i) { return !(deviation(i) <= fixed * norm); };
  step.simple.resize(n);
  for (Index i = 0; i < n; ++i) {
    step.simple(i) = std::isfinite(deviation(i));
    for (Index j = 0; j < n && step.simple(i) && moves(i); ++j)
      step.simple(i) = j == i || !moves(j) || distance(i, j) > near * (deviation(i) + deviation(j));
    step.real.lower(i) -= arithmetic * norm;
    step.real.upper(i) += arithmetic * norm;
    if (step.simple(i)) continue;
    for (Interval* part : {&step.real, &step.imaginary}) {
      part->deviation(i) = part->upper(i) = inf;
      part->lower(i) = -inf;
    }
  }
}

}  // namespace tokid::uncertainty
