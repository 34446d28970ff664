// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/lane_regression.hpp"

#include <algorithm>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/lane_regression.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

// Copies rows × cols entries of every lane to x, one vector for each entry. A column of x has `room` rows. The rows
// after `rows` become zero.
void gather(const double* samples, size_t stride, size_t offset, size_t rows, size_t cols, size_t room, double* x) {
  const Tag tag;
  for (size_t j = 0; j < cols; ++j) {
    const double* from = samples + j * stride;
    double* to = x + j * room * lanes;
    size_t i = 0;
    for (; i + lanes <= rows; i += lanes) transpose(from + i, offset, to + i * lanes);
    for (; i < rows; ++i)
      for (size_t l = 0; l < lanes; ++l) to[i * lanes + l] = from[i + l * offset];
    for (; i < room; ++i) store(hn::Zero(tag), to, i);
  }
}

void Regress(const double* samples, size_t stride, size_t offset, size_t rows, size_t left, size_t right, size_t room,
             double* x, double* r, double* inverse, double* condition, double* solution) {
  const Tag tag;
  const size_t cols = left + right;
  for (size_t i = 0; i < cols * (cols + 1) / 2; ++i) store(hn::Zero(tag), r, i);
  for (size_t begin = 0; begin < rows; begin += room) {
    const size_t count = std::min(room, rows - begin), even = count + count % 2;
    gather(samples + begin, stride, offset, count, cols, even, x);
    absorb(x, even, cols, r);
  }
  // Computes R_ll⁻¹ column by column, and the condition of R_ll with columns of norm 1. With the norms c of the columns
  // of R_ll, this is ‖R_ll diag(1/c)‖_F ‖diag(c) R_ll⁻¹‖_F.
  Vec total = hn::Zero(tag), inverse_total = hn::Zero(tag);
  for (size_t j = 0; j < left; ++j) {
    Vec square = hn::Zero(tag);
    for (size_t i = 0; i <= j; ++i) {
      const Vec a = load(r, packed(i, j));
      square = plus(square, a, a);
    }
    store(square, x, j);
    total = hn::Add(total, hn::IfThenElse(hn::Eq(square, hn::Zero(tag)), hn::Zero(tag), hn::Set(tag, 1.0)));
  }
  for (size_t i = 0; i < left; ++i) store(hn::Div(hn::Set(tag, 1.0), load(r, packed(i, i))), x, left + i);
  for (size_t j = 0; j < left; ++j)
    for (size_t i = j + 1; i-- > 0;) {
      Vec sum = i == j ? hn::Set(tag, 1.0) : hn::Zero(tag);
      for (size_t k = i + 1; k <= j; ++k) sum = minus(sum, load(r, packed(i, k)), load(inverse, packed(k, j)));
      sum = hn::Mul(sum, load(x, left + i));
      store(sum, inverse, packed(i, j));
      inverse_total = plus(inverse_total, hn::Mul(sum, sum), load(x, i));
    }
  store(hn::Sqrt(hn::Mul(total, inverse_total)), condition, 0);
  for (size_t j = 0; j < right; ++j)
    for (size_t i = left; i-- > 0;) {
      Vec sum = load(r, packed(i, left + j));
      for (size_t k = i + 1; k < left; ++k) sum = minus(sum, load(r, packed(i, k)), load(solution, j * left + k));
      store(hn::Mul(sum, load(x, left + i)), solution, j * left + i);
    }
}

size_t Lanes() { return lanes; }

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

namespace {
// The number of entries of one lane that are absorbed at once. The entries of eight lanes take 32 KiB. The number is
// the same on every machine, so that the sums have the same order everywhere.
constexpr Index piece_entries = 512;

// The number of rows of every piece. It is even, because absorb() takes rows in pairs.
Index piece_of(Index rows, Index cols) {
  const Index most = std::max<Index>(8, piece_entries / cols), pieces = std::max<Index>(1, (rows + most - 1) / most);
  const Index piece = (rows + pieces - 1) / pieces;
  return piece + piece % 2;
}
}  // namespace

Index LaneRegression::lanes() { return Index(TOKID_KERNEL(Lanes)()); }

// A piece of 32 columns has 16 rows. With more columns a piece has fewer rows, and a reflection absorbs too little.
Index LaneRegression::most_columns() { return 32; }

LaneRegression::LaneRegression(Index rows, Index left, Index right)
    : rows_(rows),
      left_(left),
      right_(right),
      lanes_(lanes()),
      piece_(piece_of(rows, left + right)),
      memory_(lanes_, {{&work_, std::max(piece_ * (left + right), 2 * left)},
                       {&r_, (left + right) * (left + right + 1) / 2},
                       {&inverse_, left * (left + 1) / 2},
                       {&condition_, 1},
                       {&x_, left * right}}) {}

void LaneRegression::run(const double* samples, Index stride, Index offset) {
  TOKID_KERNEL(Regress)
  (samples, size_t(stride), size_t(offset), size_t(rows_), size_t(left_), size_t(right_), size_t(piece_), work_, r_,
   inverse_, condition_, x_);
}

}  // namespace tokid::linalg
#endif
