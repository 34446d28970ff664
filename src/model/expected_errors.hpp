// The errors of an exact model, from its stated covariances. Larger errors show that the model is wrong.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// Variances (T × m) of y_k minus its simulation by simulate_data() without missing samples; NaN at steps without a
// simulation. `covariances` (S) are those of the innovations. `initial` says how the initial state is known.
Matrix expected_simulation_errors(const Model& model, const std::vector<Matrix>& covariances, InitialState initial,
                                  Index steps);

// Variances (H × m) of y_k minus its prediction h = 1 … H steps ahead, by an observer with all outputs. They are means
// over the starting steps begin … end-h. For long records, the mean is over some of these steps.
Matrix expected_prediction_errors(const Model& model, const std::vector<Matrix>& covariances, Index begin, Index end,
                                  Index horizons);

}  // namespace tokid
