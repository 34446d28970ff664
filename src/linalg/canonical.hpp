// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Numbers that are equal get equal bits: one pattern for both zeros, and one for whatever is not a number.
void copy_canonical(const double* from, Index count, double* to);

}  // namespace tokid::linalg
