// Simulation and prediction for callers that need one step at a time. The functions pass each step to `use` and store
// no step.
#pragma once

#include <functional>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// Calls use(k, y_k) with the outputs (N × m) as departures from the nominal trajectory. The simulation starts from the
// states x (N × n_k) at step k, and ends at the last step of model and inputs. Outputs after a missing input are NaN.
void simulate_each(const Model& model, const Ensemble& inputs, Index k, Matrix x,
                   const std::function<void(Index, const Matrix&)>& use);

// Calls use(k, y_k) for the steps of simulate_data(), with the same outputs.
void simulate_data_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                        const std::function<void(Index, const Matrix&)>& use);

// Calls use(k, y_k - ŷ_k) for the steps of predict(), with the same innovations (N × m): rows of NaN where there is no
// prediction.
void predict_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                  const std::function<void(Index, const Matrix&)>& use);

// Predictions of all horizons in one pass of the observer. Calls use(i, k, ŷ_k) with the outputs (N × m) of step k as
// departures, predicted horizons[i] steps ahead. The horizons ascend, and the first is 1. Longer predictions begin at
// the steps s where begins(s). Rows are NaN where there is no prediction.
void predict_ahead_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                        const std::vector<Index>& horizons, const std::function<bool(Index)>& begins,
                        const std::function<void(Index, Index, const Matrix&)>& use);

}  // namespace tokid
