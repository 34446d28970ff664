// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <numeric>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// ⌈a/b⌉ for a ≥ 0, b > 0
inline Index ceil_div(Index a, Index b) { return (a + b - 1) / b; }

// begin, begin + 1 … end - 1
inline std::vector<Index> range(Index begin, Index end) {
  std::vector<Index> result(size_t(end - begin));
  std::iota(result.begin(), result.end(), begin);
  return result;
}

}  // namespace tokid
