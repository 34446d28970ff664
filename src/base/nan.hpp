// The value of missing numbers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>

namespace tokid {

inline constexpr double nan = std::numeric_limits<double>::quiet_NaN();

}  // namespace tokid
