// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Rows, `stride` numbers apart, have one entry for each column. Entry j of row i is copied to columns[j][i].
void transpose(const double* from, Index rows, Index stride, const std::vector<double*>& columns);

}  // namespace tokid::linalg
