// A signal as an exact combination of a few others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/finding.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

// What is left of a signal by its best combination of others counts as nothing below this share of their sizes: as many
// digits as files of numbers in single precision, or of six digits, have.
inline constexpr double nothing_left = 1e-6;

struct Combination {
  struct Term {
    Index column;
    double factor;
  };
  std::vector<Term> terms;  // target = Σ factor · column + constant, no more of them than that takes
  bool constant = false;    // a constant is part of it
};

// Orthogonal matching pursuit: the column that explains most, and the next one, until nothing is left; then those that
// are not needed go. `centred`: but for a constant. Empty where the columns do not make up the target, where there are
// hardly more rows than columns, so that any target would do, or where the target does not vary.
std::optional<Combination> combination(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred);

// What is left of the target by its best combination of the columns, as a share of its size; 0 where it does not vary.
double unexplained(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred);

// Are they sums of the same samples with, to a thousandth, factors in the same ratios?
bool same_sum(const std::vector<Finding::Term>& a, const std::vector<Finding::Term>& b);

}  // namespace tokid
