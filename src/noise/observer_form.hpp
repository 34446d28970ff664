// GTV-ARX model → the state-space model in observer form that makes the same predictions. It has p·m states.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

// The state at step k has p blocks. Block i is what the samples before step k contribute to y_{k+i-1}, so that
//   y_k = [I 0 ⋯ 0] x_k + D_k u_k + e_k ,   x_{k+1}: block i+1 of x_k + h̄¹_{k+i,k} u_k - h̄²_{k+i,k} y_k ,
// with the coefficients (15). The model begins with the regressions. Beyond the last step, the coefficients of the last
// step count. \throws std::invalid_argument for fewer than p + P steps
Model observer_form(const Windows& windows, const GtvArx& arx, const TimeVariation& variation);

// The same from step 0 on, where initial states are unknown and steps share no model. Step k < p has the regression of
// k lags. The state of the observer at step 0 is zero by definition: there are no samples before it.
// `options`: those of the regressions.
Model observer_form_from_start(const Ensemble& departures, const GtvArx& arx, const SmoothArxOptions& options);

}  // namespace tokid
