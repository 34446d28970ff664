// Finds the possible cause of an outlier: a change of its samples that would make it fit.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnose/outliers/sketch.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// Tries to swap channels, to change signs, to scale, offset or shift channels in time, and looks for a stuck channel.
// If none of these fits, returns the output that has nearly all of the residual. Empty if no output has.
std::optional<Explanation> explanation(const Ensemble& ensemble, const Sketch& sketch, Index experiment);

}  // namespace tokid
