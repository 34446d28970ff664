// Finds a change of an outlier's samples that would make it fit, and describes it in words.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "diagnose/outliers/sketch.hpp"

namespace tokid {

// Tries to swap channels, to change signs, to scale, offset or shift channels in time, and looks for a stuck channel.
// Otherwise names the output that has nearly all of the residual. Empty if there is none.
std::string explanation(const Ensemble& ensemble, const Sketch& sketch, Index experiment);

}  // namespace tokid
