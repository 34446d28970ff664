// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/lane_svd.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/lane_svd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

// Rotates the columns p and q (n entries) so that they become orthogonal. Returns the lanes in which they were not
// orthogonal before.
HWY_INLINE hn::Mask<Tag> rotate(double* p, double* q, size_t n, Vec tolerance) {
  const Tag tag;
  const Vec one = hn::Set(tag, 1.0);
  Vec square_p = hn::Zero(tag), square_q = square_p, product = square_p;
  for (size_t i = 0; i < n; ++i) {
    const Vec a = load(p, i), b = load(q, i);
    square_p = plus(square_p, a, a);
    square_q = plus(square_q, b, b);
    product = plus(product, a, b);
  }
  // With norms below this product, the squares have lost digits. The columns are not rotated, and run() then marks the
  // matrix as not found.
  constexpr double least = 1e-260;
  const Vec norms = hn::Mul(hn::Sqrt(square_p), hn::Sqrt(square_q));
  const auto turn = hn::And(hn::Gt(hn::Abs(product), hn::Mul(tolerance, norms)), hn::Gt(norms, hn::Set(tag, least)));
  if (hn::AllFalse(tag, turn)) return turn;
  // The rotation angle φ: tan 2φ = 2 product / (square_q - square_p), the smaller of the two solutions. Lanes with
  // orthogonal columns do not change.
  const Vec zeta = hn::Div(hn::Sub(square_q, square_p), hn::Mul(hn::Set(tag, 2.0), product));
  const Vec size = hn::Abs(zeta), root = hn::Sqrt(plus(one, zeta, zeta));
  const Vec tangent = hn::CopySign(hn::Div(one, hn::Add(size, root)), zeta);
  const Vec cosine = hn::Div(one, hn::Sqrt(plus(one, tangent, tangent))), sine = hn::Mul(cosine, tangent);
  for (size_t i = 0; i < n; ++i) {
    const Vec a = load(p, i), b = load(q, i);
    store(hn::IfThenElse(turn, minus(hn::Mul(cosine, a), sine, b), a), p, i);
    store(hn::IfThenElse(turn, plus(hn::Mul(cosine, b), sine, a), b), q, i);
  }
  return turn;
}

// Decomposes A = U Σ Vᵀ of every lane. a: Aᵀ (even × rows); r: packed triangle with `count` valid rows; l: L (rows ×
// count), which becomes U Σ; norm: Σ, or NaN if the rotations do not converge
void Decompose(double* a, size_t even, size_t rows, size_t count, double* r, double* l, double* norm) {
  const Tag tag;
  for (size_t i = 0; i < rows * (rows + 1) / 2; ++i) store(hn::Zero(tag), r, i);
  absorb(a, even, rows, r);
  for (size_t j = 0; j < count; ++j)
    for (size_t i = 0; i < rows; ++i) store(i < j ? hn::Zero(tag) : load(r, packed(j, i)), l, j * rows + i);
  // The rounding error of the product of two columns of norm 1. No rotation can make the product smaller.
  const Vec tolerance = hn::Set(tag, double(std::max<size_t>(rows, 4)) * std::numeric_limits<double>::epsilon());
  constexpr int most_sweeps = 40;  // five or six are mostly enough
  // A lane with orthogonal columns does not change while other lanes are rotated. Thus its result does not depend on
  // them.
  const auto none = hn::Lt(tolerance, tolerance);
  auto turned = none;
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    turned = none;
    for (size_t p = 0; p + 1 < count; ++p)
      for (size_t q = p + 1; q < count; ++q)
        turned = hn::Or(turned, rotate(l + p * rows * lanes, l + q * rows * lanes, rows, tolerance));
    if (hn::AllFalse(tag, turned)) break;
  }
  for (size_t j = 0; j < count; ++j) {
    Vec square = hn::Zero(tag);
    for (size_t i = 0; i < rows; ++i) {
      const Vec x = load(l, j * rows + i);
      square = plus(square, x, x);
    }
    store(hn::IfThenElse(turned, hn::NaN(tag), hn::Sqrt(square)), norm, j);
  }
}

size_t SvdLanes() { return lanes; }

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

Index LaneSvd::lanes() { return Index(TOKID_KERNEL(SvdLanes)()); }

Index LaneSvd::most_rows() { return 192; }

LaneSvd::LaneSvd(Index rows, Index cols)
    : rows_(rows),
      cols_(cols),
      count_(std::min(rows, cols)),
      even_(cols + cols % 2),
      lanes_(lanes()),
      memory_(lanes_, {{&a_, rows * even_}, {&r_, rows * (rows + 1) / 2}, {&l_, rows * count_}, {&norm_, count_}}),
      found_(size_t(lanes_)),
      left_(count_) {}

void LaneSvd::run() {
  if (even_ > cols_)
    for (Index i = 0; i < rows_; ++i)
      for (Index l = 0; l < lanes_; ++l) entry(l, i, cols_) = 0.0;
  TOKID_KERNEL(Decompose)(a_, size_t(even_), size_t(rows_), size_t(count_), r_, l_, norm_);
  // Between these bounds, squares of the singular values and squares of their rounding errors are normal numbers.
  constexpr double least = 1e-130, most = 1e150;
  for (Index l = 0; l < lanes_; ++l) {
    bool found = true;
    for (Index j = 0; j < count_; ++j) found = found && norm_[j * lanes_ + l] > least && norm_[j * lanes_ + l] < most;
    found_[size_t(l)] = found;
  }
}

void LaneSvd::take(Index l, Matrix& u, Vector& s) {
  u.resize(rows_, count_);
  s.resize(count_);
  for (Index j = 0; j < count_; ++j) left_(j) = norm_[j * lanes_ + l];
  for (Index c = 0; c < count_; ++c) {  // in decreasing order
    Index largest = 0;
    s(c) = left_.maxCoeff(&largest);
    left_(largest) = -1.0;
    for (Index i = 0; i < rows_; ++i) u(i, c) = l_[(largest * rows_ + i) * lanes_ + l] / s(c);
  }
}

}  // namespace tokid::linalg
#endif
