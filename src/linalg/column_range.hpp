// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Says whether all numbers are finite (neither NaN nor infinite), and gives their range if so.
struct ColumnRange {
  bool finite = true;
  double min = 0.0, max = 0.0;
};
ColumnRange column_range(const double* values, Index count);

}  // namespace tokid::linalg
