// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <numeric>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// ⌈a/b⌉ for a ≥ 0, b > 0
inline Index ceil_div(Index a, Index b) { return (a + b - 1) / b; }

// The candidate of an order after i: 1, 2, 3, 4, 6, 8, 12, 16, 24 …
inline Index next_of_grid(Index i) { return i < 4 ? i + 1 : (i & (i - 1)) == 0 ? i / 2 * 3 : i / 3 * 4; }

// begin, begin + 1 … end - 1
inline std::vector<Index> range(Index begin, Index end) {
  std::vector<Index> result(size_t(end - begin));
  std::iota(result.begin(), result.end(), begin);
  return result;
}

}  // namespace tokid
