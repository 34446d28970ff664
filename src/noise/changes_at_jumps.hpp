// Jumps of the matrices → the steps at which the coefficients of a regression change fast.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

#include "tokid/linalg.hpp"

namespace tokid {

// The steps from `before` steps before each jump to `after` steps after it, relative to `begin`: ascending, from 1 on.
inline std::vector<Index> changes_at_jumps(const std::vector<Index>& jumps, Index before, Index after, Index begin) {
  std::vector<Index> result;
  for (const Index jump : jumps) {
    const Index next = result.empty() ? Index{1} : result.back() + 1;
    for (Index k = std::max(jump - before - begin, next); k <= jump + after - begin; ++k) result.push_back(k);
  }
  return result;
}

}  // namespace tokid
