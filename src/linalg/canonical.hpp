// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Copies numbers so that equal ones have equal bits: both zeros get one pattern, and all NaN get one pattern.
void copy_canonical(const double* from, Index count, double* to);

}  // namespace tokid::linalg
