// Rows of experiments: those of a fold, all others, and their marks.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// The experiments of fold f of F: f, f + F, f + 2F …
inline std::vector<Index> fold_rows(Index experiments, Index f, Index folds) {
  std::vector<Index> rows;
  for (Index n = f; n < experiments; n += folds) rows.push_back(n);
  return rows;
}

// (N) 1 for the experiments in `rows`, 0 for the others.
inline std::vector<char> marks_of(Index experiments, const std::vector<Index>& rows) {
  std::vector<char> marks(size_t(experiments), 0);
  for (const Index n : rows) marks[size_t(n)] = 1;
  return marks;
}

// The experiments that are not in `rows`.
inline std::vector<Index> other_rows(Index experiments, const std::vector<Index>& rows) {
  const std::vector<char> marks = marks_of(experiments, rows);
  std::vector<Index> others;
  for (Index n = 0; n < experiments; ++n)
    if (!marks[size_t(n)]) others.push_back(n);
  return others;
}

}  // namespace tokid
