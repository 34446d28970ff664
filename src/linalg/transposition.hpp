// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Copies entry j of row i to columns[j][i]. The rows are `stride` numbers apart, with one entry for each column.
void transpose(const double* from, Index rows, Index stride, const std::vector<double*>& columns);

}  // namespace tokid::linalg
