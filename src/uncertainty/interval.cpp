// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/interval.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace tokid::uncertainty {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
// Limits for eigenvalues. `near` is the distance of neighbours relative to the sum of their standard errors.
// `arithmetic` and `fixed` are relative to the norm of the matrix: rounding errors, and the deviation up to which an
// eigenvalue counts as not moving.
constexpr double near = 0.5, arithmetic = 1e-9, fixed = 1e-6;
}  // namespace

void check_level(double level) {
  if (!(level > 0 && level < 1))
    throw std::invalid_argument(fmt::format("level: {} found, 0 < level < 1 needed", level));
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
