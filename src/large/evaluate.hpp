// Computes the errors of predictions and simulations over the kept steps of a stretch, as sums that add up over
// stretches.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "model/error_sums.hpp"

namespace tokid::stream {

// `data`: departures, because the model is one of departures. `initial`: states at step 0 of the stretch. `first`: this
// stretch is the first one. The simulation of a later stretch starts at step `begin`, from the state that the earlier
// samples determine.
ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first);

}  // namespace tokid::stream
