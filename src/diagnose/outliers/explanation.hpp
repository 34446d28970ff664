// What, done to the samples of an experiment that does not fit, would make it as usual, in words.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "diagnose/outliers/sketch.hpp"

namespace tokid {

// Empty where nothing that is tried does: channels swapped, signs changed, one channel multiplied or moved by a
// constant, channels earlier or later, a channel that is stuck.
std::string explanation(const Ensemble& ensemble, const Sketch& sketch, Index experiment);

}  // namespace tokid
