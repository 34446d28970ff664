// A signal as an exact combination of a few others, and the words for it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

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

// "u1 - 2 u3" of names and factors, which are divided by the first one.
std::string sum_text(const std::vector<std::pair<std::string, double>>& terms);

// Do they have the same names and, to a thousandth, the same factors?
bool same_sum(const std::vector<std::pair<std::string, double>>& a,
              const std::vector<std::pair<std::string, double>>& b);

}  // namespace tokid
