// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "tokid/types.hpp"

namespace tokid {

// Copies numbers so that equal ones have equal bits: both zeros get one pattern, and all NaN get one pattern.
inline void copy_canonical(const double* from, Index count, double* to) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  std::transform(from, from + count, to, [](double x) { return std::isnan(x) ? none : x + 0.0; });
}

}  // namespace tokid
