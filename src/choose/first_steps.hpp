// Subspace model from unknown initial states → a model of all steps from 0 on, with the distribution of x_0.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

// A subspace model cannot predict the first samples if the initial states are unknown. Here, its first matrices also
// serve the steps before. EM with known matrices estimates the noise and the distribution of x_0, so that predictions
// begin at step 0. Returns the given model if it knows x_0, if the initial states are zero, without noise, if EM fails,
// or if the predictions of the first steps of the given model would become far worse.
Model with_first_steps(const Model& late, const Ensemble& departures, InitialState initial, int threads);

}  // namespace tokid
