// Regressions of many steps at once, one step in each lane of the vector instructions. This pays for small windows,
// where one factorisation alone is mostly overhead.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// Below this condition number the rank is certainly full. A rank-revealing factorisation with pivots is then not
// needed.
inline constexpr double certain_rank = 1e10;

// Solves a batch of least-squares problems right = left · x of the same shape, by Householder reflections. `left` and
// `right` are the numbers of columns. The samples of problem l begin `offset`·l entries after the samples of problem 0.
// Columns have `rows` entries and are `stride` apart. The left columns come first.
class LaneRegression {
 public:
  LaneRegression(Index rows, Index left, Index right);
  LaneRegression(const LaneRegression&) = delete;
  LaneRegression& operator=(const LaneRegression&) = delete;

  static Index lanes();                   // number of problems in a batch
  static constexpr Index most_lanes = 8;  // with any instruction set
  static Index most_columns();            // largest left + right

  void run(const double* samples, Index stride, Index offset);

  // Entries of problem l of the last batch.
  // R = [R_ll R_lr; 0 R_rr], i ≤ j
  double factor(Index l, Index i, Index j) const { return value(r_, packed(i, j), l); }
  // R_ll⁻¹, i ≤ j. `condition` is ‖R_ll‖_F ‖R_ll⁻¹‖_F for left columns of norm 1. For a rank-deficient problem,
  // `condition` is not finite.
  double inverse(Index l, Index i, Index j) const { return value(inverse_, packed(i, j), l); }
  double condition(Index l) const { return value(condition_, 0, l); }
  double x(Index l, Index i, Index j) const { return value(x_, j * left_ + i, l); }

 private:
  static Index packed(Index i, Index j) { return j * (j + 1) / 2 + i; }
  double value(const double* list, Index entry, Index l) const { return list[entry * lanes_ + l]; }

  Index rows_, left_, right_, lanes_, piece_;
  double *work_ = nullptr, *r_ = nullptr, *inverse_ = nullptr, *condition_ = nullptr, *x_ = nullptr;
  LaneMemory memory_;
};

}  // namespace tokid::linalg
