// Finds out whether a signal is an exact combination of a few others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/finding.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

// A residual below this share of the signal counts as zero. Files in single precision, or with six digits, have this
// accuracy.
inline constexpr double nothing_left = 1e-6;

struct Combination {
  struct Term {
    Index column;
    double factor;
  };
  std::vector<Term> terms;  // target = Σ factor · column + constant, with no more terms than necessary
  bool constant = false;    // the sum contains a constant
};

// Orthogonal matching pursuit. Adds the column that leaves the smallest residual until no residual is left, and then
// removes columns that are not needed. `centred`: the combination may contain a constant. Empty if no combination of
// the columns gives the target, or if the target does not vary. Also empty if there are hardly more rows than columns,
// because any target would then fit.
std::optional<Combination> combination(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred);

// Residual of the target after its best combination of the columns, as a share of the size of the target; 0 if the
// target does not vary.
double unexplained(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred);

// Are both sums of the same samples, with factors in the same ratios to within a thousandth?
bool same_sum(const std::vector<Finding::Term>& a, const std::vector<Finding::Term>& b);

}  // namespace tokid
