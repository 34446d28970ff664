// Sizes from which on a result of a test counts against a model; below them it is beyond chance at most.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid::counts {

inline constexpr double correlation = 0.2;    // of innovations, in time or with inputs
inline constexpr double overconfident = 2.0;  // normalised innovations squared, over their number
inline constexpr double gain = 0.2;           // error of an input's effect, as a share of the simulated output
inline constexpr double gain_unknown = 0.5;   // the same of its 99 % interval

}  // namespace tokid::counts
