// The bias that smoothing over time causes, from the change of the estimates with weaker smoothing.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// A list of values with `size` entries for each of `steps` steps, from entry `begin` on.
struct PerStep {
  Index begin = 0, steps = 0, size = 0;
};

// The squares of the changes, averaged for each entry over the neighbouring steps: a single change is as random as the
// noise. NaN changes do not count.
void add_local_squares(const Vector& change, const PerStep& place, Vector& squares);

// Adds the squares of a bias (entries) to the variances of intervals (entries × 1). `t`: the quantile of the intervals.
void widen(Interval& interval, const Vector& squares, double t);

}  // namespace tokid::uncertainty
