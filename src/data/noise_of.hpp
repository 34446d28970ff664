// Do the outputs follow from the samples before them, within rounding?
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "data/scales.hpp"
#include "tokid/ensemble.hpp"

namespace tokid {

enum class Noise { none, visible, unknown };

// By regressions over the given independent experiments (rows) at some steps, with an intercept for a mean motion: on
// all inputs so far, as of experiments from rest, and on windows of several lag orders. There is no noise where those
// of one kind leave nothing but rounding at every step. Too few experiments for systems of some states leave it
// unknown: from initial states that nobody knows, noise looks like states that the windows don't show.
Noise noise_of(const Ensemble& ensemble, const std::vector<Index>& rows, const Scales& scales);

}  // namespace tokid
