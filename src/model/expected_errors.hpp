// The errors that an exact model would leave, from the covariances that it states: what they are beyond is its fault.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// Variances (T × m) of y_k less the simulation of simulate_data(), where every sample is there; NaN where it computes
// none. `covariances` (S) are those of the innovations; the initial state is one that `initial` says.
Matrix expected_simulation_errors(const Model& model, const std::vector<Matrix>& covariances, InitialState initial,
                                  Index steps);

// Variances (H × m) of y_k less its prediction h = 1 … H steps ahead by an observer that has seen all, from the states
// of the steps begin … end-h on, in the mean. Of long records some starts stand for all.
Matrix expected_prediction_errors(const Model& model, const std::vector<Matrix>& covariances, Index begin, Index end,
                                  Index horizons);

}  // namespace tokid
