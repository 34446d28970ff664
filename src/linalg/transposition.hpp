// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Rows, `stride` numbers apart, with an entry for each of the columns: entry j of row i goes to columns[j][i].
void transpose(const double* from, Index rows, Index stride, const std::vector<double*>& columns);

}  // namespace tokid::linalg
