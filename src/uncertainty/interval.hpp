// Intervals from estimates and their variances.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// \throws std::invalid_argument unless 0 < level < 1
void check_level(double level);

// t with P(|T| ≤ t) = level for Student's T. Intervals ask for it once per entry, so it is tabulated.
class StudentT {
 public:
  explicit StudentT(double level);
  double operator()(double freedom) const;  // freedom from 1 on, infinity included

 private:
  double level_;
  std::vector<double> log_quantile_;  // over 1/freedom, evenly spaced from 0 to 1
};

// A sum of independent variances, each estimated with its own degrees of freedom, entry by entry.
struct Variance {
  Variance(Index rows, Index cols) : sum(Matrix::Zero(rows, cols)), spread(Matrix::Zero(rows, cols)) {}
  Matrix sum;     // Σ v
  Matrix spread;  // Σ v²/ν, so that sum²/spread are the degrees of freedom of the sum (Welch, Satterthwaite)
};

Interval interval(Matrix estimate, const Variance& variance, const StudentT& t);

// Says which eigenvalues of Ā'_k, of norm `norm`, are clearly simple, and takes the bounds from the others: those that
// have a neighbour within half the standard errors of both together. A stricter rule would let through those whose
// standard errors came out too small, and little else. The zeros of a deadbeat observer do not move and
// are no such neighbours. Every interval is at least as wide as rounding asks for.
void judge(SpectrumBounds::Step& step, double norm);

}  // namespace tokid::uncertainty
