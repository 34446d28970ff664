// Intervals from estimates and their variances.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// \throws std::invalid_argument unless 0 < level < 1
void check_level(double level);

// t with P(|T| ≤ t) = level for Student's T. The quantiles are stored in a table, because intervals need one for each
// entry.
class StudentT {
 public:
  explicit StudentT(double level);
  double operator()(double freedom) const;  // freedom > 0, or infinity; the result is infinite otherwise

 private:
  double level_;
  std::vector<double> log_quantile_;  // over 1/freedom, evenly spaced from 0 to 1
};

// A sum of independent variances, entry by entry. Each variance is estimated with its own degrees of freedom.
struct Variance {
  Variance(Index rows, Index cols) : sum(Matrix::Zero(rows, cols)), spread(Matrix::Zero(rows, cols)) {}
  Matrix sum;     // Σ v
  Matrix spread;  // Σ v²/ν; the sum has sum²/spread degrees of freedom (Welch, Satterthwaite)
};

Interval interval(Matrix estimate, const Variance& variance, const StudentT& t);

// Decides which eigenvalues of Ā'_k are clearly simple, and makes the bounds of the other eigenvalues infinite. `norm`
// is the norm of Ā'_k. An eigenvalue is not simple if a neighbour is within half the sum of the two standard errors. A
// stricter rule would accept few eigenvalues, and mostly those whose standard errors are too small. The zeros of a
// deadbeat observer do not move and do not count as neighbours. The interval of every real part is widened by rounding
// errors.
void find_simple(SpectrumBounds::Step& step, double norm);

}  // namespace tokid::uncertainty
