// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/types.hpp"

namespace tokid {

// ⌈a/b⌉ for a ≥ 0, b > 0
inline Index ceil_div(Index a, Index b) { return (a + b - 1) / b; }

}  // namespace tokid
