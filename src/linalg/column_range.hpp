// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Of numbers that may be missing (NaN) or infinite: whether there is none of either, and where that holds the range.
struct ColumnRange {
  bool finite = true;
  double min = 0.0, max = 0.0;
};
ColumnRange column_range(const double* values, Index count);

}  // namespace tokid::linalg
