// How well a stretch of a model predicts and simulates the samples of the steps it is kept for, as sums that add up
// over stretches.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "model/error_sums.hpp"

namespace tokid::stream {

// `data` are departures, as the model is one of departures; `initial` says what is known of the states at step 0 of the
// stretch, which begins `first` of all. The simulation of a later stretch starts at step `begin`, from the state that
// the samples before tell.
ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first);

}  // namespace tokid::stream
