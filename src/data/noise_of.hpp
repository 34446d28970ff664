// Decides whether the outputs follow from the samples before them, within rounding.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "data/scales.hpp"
#include "tokid/ensemble.hpp"

namespace tokid {

enum class Noise { none, visible, unknown };

// Decides by regressions over the given independent experiments (rows) at some steps, with an intercept for a mean
// motion. One kind of regression uses all inputs so far, which is enough for experiments from rest. The other kind uses
// windows of several lag orders. If one kind leaves only rounding errors at every step, there is no noise. The answer
// is `unknown` if there are too few experiments for long windows: states that short windows do not determine leave
// residuals like noise.
Noise noise_of(const Ensemble& ensemble, const std::vector<Index>& rows, const Scales& scales);

}  // namespace tokid
