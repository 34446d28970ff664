// Householder reflections of the small matrices that most factorisations here are of: Eigen's general products take
// longer to begin than to run there.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <limits>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// I - τ [1; v] [1; v]ᵀ, which makes [β; 0] of a column [pivot; tail]. These become β and v; \return τ, or 0 where there
// is nothing to reflect.
inline double make_reflection(double& pivot, double* tail, Index length) {
  Eigen::Map<Vector> v(tail, length);
  const double squares = v.squaredNorm();
  if (squares <= std::numeric_limits<double>::min()) return 0.0;
  const double beta = -std::copysign(std::sqrt(pivot * pivot + squares), pivot);
  v /= pivot - beta;
  const double tau = (beta - pivot) / beta;
  pivot = beta;
  return tau;
}

// Columns whose first entries, and whose others, stand in places of their own.
struct Columns {
  double* first;
  Index first_stride;
  double* rest;
  Index rest_stride;
};

// `count` neighbours at once, so that v is read once for all of them.
template <int count>
void reflect_together(const double* v, Index length, double tau, const Columns& columns) {
  using Pair = Eigen::Array2d;
  std::array<double*, count> rest{};
  std::array<Pair, count> sums;
  for (int c = 0; c < count; ++c) {
    rest[c] = columns.rest + c * columns.rest_stride;
    sums[c].setZero();
  }
  const Index even = length - length % 2;
  for (Index i = 0; i < even; i += 2) {
    const Pair two = Eigen::Map<const Pair>(v + i);
    for (int c = 0; c < count; ++c) sums[c] += two * Eigen::Map<const Pair>(rest[c] + i);
  }
  std::array<double, count> factor{};
  for (int c = 0; c < count; ++c) {
    double& first = columns.first[c * columns.first_stride];
    double product = first + sums[c].sum();
    if (even < length) product += v[even] * rest[c][even];
    factor[c] = tau * product;
    first -= factor[c];
  }
  for (Index i = 0; i < even; i += 2) {
    const Pair two = Eigen::Map<const Pair>(v + i);
    for (int c = 0; c < count; ++c) Eigen::Map<Pair>(rest[c] + i) -= factor[c] * two;
  }
  if (even < length)
    for (int c = 0; c < count; ++c) rest[c][even] -= factor[c] * v[even];
}

inline void reflect(const double* v, Index length, double tau, Columns columns, Index count) {
  const auto move = [&](Index by) {
    columns.first += by * columns.first_stride;
    columns.rest += by * columns.rest_stride;
    count -= by;
  };
  for (; count >= 4; move(4)) reflect_together<4>(v, length, tau, columns);
  for (; count > 0; move(1)) reflect_together<1>(v, length, tau, columns);
}

}  // namespace tokid::linalg
