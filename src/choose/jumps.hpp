// Experiments and the choice of p and λ → the steps at which the matrices of the system jump.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/choices.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

// Ascending steps of the ensemble. A jump is found where a regression whose coefficients may change fast predicts
// held-out experiments significantly better one step ahead. `lags`, `smoothing`: the choice without jumps; λ is
// positive and finite.
std::vector<Jump> find_jumps(const Ensemble& ensemble, const SmoothingOptions& options, Index lags, double smoothing);

}  // namespace tokid
