// Times → the even grid begin + k dt on which they lie.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <vector>

namespace tokid::io {

struct EvenTimes {
  double begin = 0.0, dt = 1.0;  // [s]
  bool shows_dt = false;         // dt follows from the times; false: it was stated, or there is only one time
  std::optional<size_t> wrong;   // the first time that is not on the grid

  double step(double time) const { return std::round((time - begin) / dt); }
};

// Times may lie beside the grid by 1e-6 of a step, or by their rounding in double or single precision. `stated`: the sample time [s].
// Without it, the smallest distance of two times is one step, and also the usual one of successive times. \pre finite times, at least one; 0 < stated < ∞
EvenTimes even_times(const std::vector<double>& times, std::optional<double> stated = {});

}  // namespace tokid::io
