// Computes the errors of predictions and simulations at the kept steps of a stretch. The results are sums, so the
// results of several stretches can be added.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "model/error_sums.hpp"

namespace tokid::stream {

// `data`: departures from the nominal trajectory, which the model describes. `initial`: the states at step 0 of the
// stretch. `first`: the stretch begins at step 0 of the record. In a later stretch, the simulation starts at step
// `begin`, from the state that follows from the samples before.
ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first);

}  // namespace tokid::stream
