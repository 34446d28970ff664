// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/lane_random_walk.hpp"

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/lane_random_walk.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {
namespace random_walk {

// Applies I - [1; v] τ [1; v]ᵀ to columns [upper; x]. Neighbouring entries of `upper`, and neighbouring columns x, are
// `stride` vectors apart.
template <size_t columns>
HWY_INLINE void reflect(const double* v, size_t rows, Vec tau, size_t stride, double* upper, double* x) {
  Vec product[columns];
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c) product[c] = load(upper, c * stride);
  for (size_t k = 0; k < rows; ++k) {
    const Vec v_k = load(v, k);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c) product[c] = plus(product[c], v_k, load(x, c * stride + k));
  }
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c) {
    product[c] = hn::Mul(tau, product[c]);
    store(hn::Sub(load(upper, c * stride), product[c]), upper, c * stride);
  }
  for (size_t k = 0; k < rows; ++k) {
    const Vec v_k = load(v, k);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c) store(minus(load(x, c * stride + k), v_k, product[c]), x, c * stride + k);
  }
}

HWY_INLINE void reflect_all(const double* v, size_t rows, Vec tau, size_t stride, double* upper, double* x,
                            size_t count) {
  size_t c = 0;
  for (; c + 4 <= count; c += 4) reflect<4>(v, rows, tau, stride, upper + c * stride * lanes, x + c * stride * lanes);
  for (; c < count; ++c) reflect<1>(v, rows, tau, stride, upper + c * stride * lanes, x + c * stride * lanes);
}

// Turns [pivot; v] into [β; 0]. v is scaled to the vector of the reflection. \return τ, or 0 if v is zero
HWY_INLINE Vec make_reflection(double* pivot, double* v, size_t rows) {
  const Tag tag;
  const Vec zero = hn::Zero(tag), one = hn::Set(tag, 1.0), alpha = load(pivot, 0);
  Vec square = zero;
  for (size_t k = 0; k < rows; ++k) square = plus(square, load(v, k), load(v, k));
  const auto none = hn::Eq(square, zero);
  const Vec norm = hn::Sqrt(plus(square, alpha, alpha));
  const Vec beta = hn::IfThenElse(hn::Gt(alpha, zero), hn::Neg(norm), norm);
  const Vec scale = hn::IfThenElse(none, zero, hn::Div(one, hn::Sub(alpha, beta)));
  for (size_t k = 0; k < rows; ++k) store(hn::Mul(load(v, k), scale), v, k);
  store(hn::IfThenElse(none, alpha, beta), pivot, 0);
  return hn::IfThenElse(none, zero, hn::Sub(one, hn::Div(alpha, beta)));
}

// The QR factorisations of a step
//   [  R   0  z ]     [ U  V  w  ]             [ R_{g+1}  z_{g+1} ]     [ R  z ]
//   [ -I   I  0 ] = Q [ 0  B  b  ]    and then [    B        b    ] = Q [ 0  * ]
// `stored` holds a step in each l × (l+2) block, as described in the header. `below` holds [-I 0] and then [B b],
// l × (l+1) each. The zeros are kept: reflection j of the first one involves the rows 0 … j of its lower block.
void Eliminate(size_t steps, size_t l, double* stored, double* below) {
  const Tag tag;
  const Vec zero = hn::Zero(tag), one = hn::Set(tag, 1.0);
  double *const a = below, *const b = below + l * (l + 1) * lanes;
  for (size_t g = 0; g < steps; ++g) {
    double* const now = stored + g * l * (l + 2) * lanes;
    const auto entry = [&](size_t i, size_t j) { return now + (j * l + i) * lanes; };
    for (size_t j = 0; j < l; ++j)
      for (size_t i = j; i < l; ++i) store(zero, entry(i, j), 0);
    if (g > 0)
      for (size_t j = 0; j < l; ++j) {
        double* const v = b + j * l * lanes;
        const Vec tau = make_reflection(entry(j, j + 1), v, l);
        reflect_all(v, l, tau, l, entry(j, j + 2), v + l * lanes, l - j);
      }
    if (g + 1 == steps) break;
    for (size_t j = 0; j <= l; ++j)
      for (size_t i = 0; i < l; ++i) {
        const Vec s = i == j ? one : zero;
        store(hn::Neg(s), a, j * l + i);
        store(s, b, j * l + i);
      }
    for (size_t j = 0; j < l; ++j) {
      double* const v = a + j * l * lanes;
      const Vec tau = make_reflection(entry(j, j + 1), v, j + 1);
      reflect_all(v, j + 1, tau, l, entry(j, j + 2), v + l * lanes, l - j);
      reflect_all(v, j + 1, tau, l, entry(j, 0), b, j + 1);
    }
    for (size_t i = 0; i < l; ++i) store(load(a, l * l + i), b, l * l + i);
  }
}

void Substitute(size_t steps, size_t l, double* stored) {
  for (size_t g = steps - 1; g-- > 0;) {
    double *const now = stored + g * l * (l + 2) * lanes, *const x = now + l * (l + 1) * lanes;
    const double* const next = x + l * (l + 2) * lanes;
    for (size_t j = l; j-- > 0;) {
      Vec sum = load(x, j);
      for (size_t c = 0; c <= j; ++c) sum = minus(sum, load(now, c * l + j), load(next, c));
      for (size_t c = j + 1; c < l; ++c) sum = minus(sum, load(now, (c + 1) * l + j), load(x, c));
      store(hn::Div(sum, load(now, (j + 1) * l + j)), x, j);
    }
  }
}

size_t Lanes() { return lanes; }

}  // namespace random_walk
}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

Index LaneRandomWalk::lanes() { return Index(TOKID_KERNEL(random_walk::Lanes)()); }

LaneRandomWalk::LaneRandomWalk(Index steps, Index regressors)
    : steps_(steps),
      l_(regressors),
      lanes_(lanes()),
      memory_(lanes_, {{&stored_, steps * l_ * (l_ + 2)}, {&below_, 2 * l_ * (l_ + 1)}}) {}

void LaneRandomWalk::eliminate() {
  TOKID_KERNEL(random_walk::Eliminate)
  (size_t(steps_), size_t(l_), stored_, below_);
}

Matrix LaneRandomWalk::last(Index lane) {
  Matrix rows = Matrix::Zero(l_, l_ + 1);
  for (Index i = 0; i < l_; ++i) {
    for (Index j = i; j < l_; ++j) rows(i, j) = value(steps_ - 1, i, j + 1, lane);
    rows(i, l_) = z(steps_ - 1, i, lane);
  }
  return rows;
}

void LaneRandomWalk::substitute() { TOKID_KERNEL(random_walk::Substitute)(size_t(steps_), size_t(l_), stored_); }

}  // namespace tokid::linalg
#endif
