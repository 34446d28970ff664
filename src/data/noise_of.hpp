// Decides whether the outputs follow from the samples before them, within rounding.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "data/scales.hpp"
#include "tokid/ensemble.hpp"

namespace tokid {

enum class Noise { none, visible, unknown };

// Decides by regressions over the given independent experiments (rows) at some steps, with an intercept for a mean
// motion. One kind uses all inputs so far, for experiments from rest. The other kind uses windows of several lag
// orders. There is no noise where one kind leaves only rounding at every step. With too few experiments the answer is
// unknown. The reason is that with unknown initial states noise looks like states that the windows do not show.
Noise noise_of(const Ensemble& ensemble, const std::vector<Index>& rows, const Scales& scales);

}  // namespace tokid
