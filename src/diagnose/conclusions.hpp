// A significant test result counts against a model if its size is at least one of these limits.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid::counts {

inline constexpr double correlation = 0.2;    // of innovations, in time or with inputs
inline constexpr double overconfident = 2.0;  // sum of the normalised innovations squared, divided by their number
inline constexpr double gain = 0.2;           // error of an input's effect, as a share of the simulated output
inline constexpr double gain_unknown = 0.5;  // half the 99 % interval of this error, as a share of the simulated output

}  // namespace tokid::counts
