// Units in which an identification computes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// Sizes of the channels as powers of two. Samples and matrices change their units without rounding errors.
struct Units {
  Vector input, output;  // (r), (m)
};

// The units in which the samples of each channel have a root mean square between 1/2 and 1.
Units units_of(const Ensemble& ensemble);

// The samples and free responses of `ensemble` in these units.
Ensemble in_units(Ensemble ensemble, const Units& units);

// The model of the same states, but of samples in their own units, from the model of samples in `units`. Nominal
// trajectories stay as they are.
Model out_of_units(Model model, const Units& units);

}  // namespace tokid
