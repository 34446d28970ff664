// Simulation and prediction that pass each step to a function and store none, for callers that need one step at a time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "tokid/model.hpp"

namespace tokid {

// Calls use(k, y_k) with the outputs (N × m) as departures from the nominal trajectory. It starts from the states x (N
// × n_k) at step k, and ends at the last step of model and inputs. NaN after a missing input.
void simulate_each(const Model& model, const Ensemble& inputs, Index k, Matrix x,
                   const std::function<void(Index, const Matrix&)>& use);

// Calls use(k, y_k) for the steps of simulate_data(), with the same outputs.
void simulate_data_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                        const std::function<void(Index, const Matrix&)>& use);

// Calls use(k, y_k - ŷ_k) for the steps of predict(), with the same innovations (N × m): rows of NaN where there is no
// prediction.
void predict_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                  const std::function<void(Index, const Matrix&)>& use);

}  // namespace tokid
