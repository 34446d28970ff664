// The gains of the Kalman filter of a model in innovations form whose states have noise beyond the innovations.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// What the regressions on states leave unexplained is process noise: the gain of the innovations form is right without
// it; with it the Kalman filter's is, which keeps the observer stable however noisy the regression for the gain was.
//   w = -G ε + w',  v = ε:   P⁺ = Ā (P - P Cᵀ S⁻¹ C P) Āᵀ + Q',  S = C P Cᵀ + Σ,  G⁺ = (G Σ - A P Cᵀ) S⁻¹
// Replaces G and innovation_cov, Σ, of every step; noise: Q' of every step (n_{k+1} × n_{k+1}). A periodic model gets
// the gains that the filter settles on.
void filter_gains(Model& model, const std::vector<Matrix>& noise);

}  // namespace tokid
