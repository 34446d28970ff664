// SPDX-License-Identifier: BSD-3-Clause
#include "noise/em/anderson.hpp"

namespace tokid::em {

namespace {

constexpr double damping = 1e-8;

}  // namespace

std::optional<Vector> Anderson::next(const Vector& x, const Vector& g) {
  f_.emplace_back(g - x);
  g_.push_back(g);
  if (f_.size() > depth_ + 1) f_.pop_front(), g_.pop_front();
  const Index pairs = Index(f_.size()) - 1;
  if (pairs < 1) return std::nullopt;
  Matrix difference(g.size(), pairs);
  for (Index i = 0; i < pairs; ++i) difference.col(i) = f_[size_t(i) + 1] - f_[size_t(i)];
  // The normal equations are accurate enough: they are small, and their rounding errors affect only the speed of the
  // iteration.
  Matrix gram = difference.transpose() * difference;
  const double lift = damping * gram.trace();
  if (!(lift > 0)) return std::nullopt;
  gram.diagonal().array() += lift;
  const Vector gamma = linalg::minimum_norm(gram, difference.transpose() * f_.back(), 1e-15).x;
  Vector result = g;
  for (Index i = 0; i < pairs; ++i) result -= gamma(i) * (g_[size_t(i) + 1] - g_[size_t(i)]);
  return result;
}

}  // namespace tokid::em
