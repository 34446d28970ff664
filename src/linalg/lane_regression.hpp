// Regressions of many steps at once, one in each lane of the vector instructions. It is for small windows, where most
// of the time of a single factorisation is overhead.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// Up to this condition number the rank is certain, without the pivots of a rank-revealing factorisation.
inline constexpr double certain_rank = 1e10;

// Solves least-squares problems of one shape, right = left · x, by Householder reflections. The samples of problem l of
// a batch begin `offset`·l entries after those of problem 0. Columns have `rows` entries and are `stride` apart, the
// left ones first.
class LaneRegression {
 public:
  LaneRegression(Index rows, Index left, Index right);
  LaneRegression(const LaneRegression&) = delete;
  LaneRegression& operator=(const LaneRegression&) = delete;

  static Index lanes();         // problems of a batch
  static Index most_columns();  // left and right together

  void run(const double* samples, Index stride, Index offset);

  // Entries of problem l of the last batch.
  // R = [R_ll R_lr; 0 R_rr], i ≤ j
  double factor(Index l, Index i, Index j) const { return value(r_, packed(i, j), l); }
  // R_ll⁻¹, i ≤ j. `condition` is ‖R_ll‖_F ‖R_ll⁻¹‖_F for left columns of norm 1; it is not finite for a rank-deficient
  // problem.
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
