// Householder reflections of small matrices. Eigen's general products have more overhead than work for these sizes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tokid/types.hpp"

namespace tokid::linalg {

// Computes the reflection I - τ [1; v] [1; v]ᵀ that turns a column [pivot; tail] into [β; 0]. pivot becomes β, and tail
// becomes v.
// \return τ, or 0 if the tail is zero.
inline double make_reflection(double& pivot, double* tail, Index length) {
  Eigen::Map<Vector> v(tail, length);
  double scale = 1.0, squares = v.squaredNorm();
  // Squares below `least` lose digits, and squares above `most` may overflow. In both cases the column is scaled by a
  // power of two.
  constexpr double least = std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon();
  constexpr double most = std::numeric_limits<double>::max() / 4;
  if (!(squares >= least && pivot * pivot + squares <= most) && !std::isnan(squares)) {
    const double largest = length > 0 ? v.lpNorm<Eigen::Infinity>() : 0.0;
    if (largest == 0.0) return 0.0;
    constexpr int highest = 1000;  // 2^1000 makes even the smallest numbers large enough
    scale = std::ldexp(1.0, std::min(highest, -std::ilogb(std::max(largest, std::abs(pivot)))));
    v *= scale;
    pivot *= scale;
    squares = v.squaredNorm();
  }
  const double beta = -std::copysign(std::sqrt(pivot * pivot + squares), pivot);
  v /= pivot - beta;
  const double tau = (beta - pivot) / beta;
  pivot = beta / scale;
  return tau;
}

// Columns whose first entry is stored apart from the other entries.
struct Columns {
  double* first;
  Index first_stride;
  double* rest;
  Index rest_stride;
};

// Reflects `count` neighbouring columns at once, so that v is read once for all of them.
template <size_t count>
void reflect_together(const double* v, Index length, double tau, const Columns& columns) {
  using Pair = Eigen::Array2d;
  std::array<double*, count> rest{};
  std::array<Pair, count> sums;
  for (size_t c = 0; c < count; ++c) {
    rest[c] = columns.rest + Index(c) * columns.rest_stride;
    sums[c].setZero();
  }
  const Index even = length - length % 2;
  for (Index i = 0; i < even; i += 2) {
    const Pair two = Eigen::Map<const Pair>(v + i);
    for (size_t c = 0; c < count; ++c) sums[c] += two * Eigen::Map<const Pair>(rest[c] + i);
  }
  std::array<double, count> factor{};
  for (size_t c = 0; c < count; ++c) {
    double& first = columns.first[Index(c) * columns.first_stride];
    double product = first + sums[c].sum();
    if (even < length) product += v[even] * rest[c][even];
    factor[c] = tau * product;
    first -= factor[c];
  }
  for (Index i = 0; i < even; i += 2) {
    const Pair two = Eigen::Map<const Pair>(v + i);
    for (size_t c = 0; c < count; ++c) Eigen::Map<Pair>(rest[c] + i) -= factor[c] * two;
  }
  if (even < length)
    for (size_t c = 0; c < count; ++c) rest[c][even] -= factor[c] * v[even];
}

inline void reflect(const double* v, Index length, double tau, Columns columns, Index count) {
  while (count > 0) {
    const Index together = count >= 4 ? 4 : 1;
    if (together == 4)
      reflect_together<4>(v, length, tau, columns);
    else
      reflect_together<1>(v, length, tau, columns);
    columns.first += together * columns.first_stride;
    columns.rest += together * columns.rest_stride;
    count -= together;
  }
}

// Reflects the columns of `a` one after the other, so that its upper triangle is the triangular factor. No column has
// entries more than `bandwidth` rows below the diagonal. The numbers below the diagonal are left undefined.
inline void triangularise(Eigen::Ref<Matrix> a, Index bandwidth) {
  const Index stride = a.outerStride();
  for (Index k = 0; k < std::min(a.rows(), a.cols()); ++k) {
    double* const pivot = &a(k, k);
    const Index below = std::min(bandwidth, a.rows() - k - 1), right = a.cols() - k - 1;
    const double tau = make_reflection(*pivot, pivot + 1, below);
    if (tau != 0.0 && right > 0)
      reflect(pivot + 1, below, tau, {pivot + stride, stride, pivot + stride + 1, stride}, right);
  }
}

}  // namespace tokid::linalg
