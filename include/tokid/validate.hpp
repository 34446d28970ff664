// How good is a model on data: fit of simulation and prediction, whiteness of the innovations.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

struct ValidateOptions {
  Index horizon = 1;                               // H of the H-step fit
  Index whiteness_lags = 5;                        // lags j = 1 … of the correlation of ε_k with ε_{k-j}
  std::optional<InitialState> initial_state = {};  // as in PredictOptions
};

// Fit of output j: 100·(1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%], over all experiments and steps where both are known; ȳ is the
// nominal trajectory where the model has one, else the mean over experiments and steps. NaN where nothing could be
// compared.
struct Fit {
  Vector fit;         // (m) [%]
  Vector rmse;        // (m) in the unit of the output
  Index samples = 0;  // compared per output, the smallest over outputs
};
Fit fit(const Ensemble& measured, const Ensemble& computed, const Matrix& y_nominal = {});

struct Validation {
  Fit simulation, one_step, horizon;
  // Probability of innovations as correlated as these if they were white; NaN where the innovations are at rounding
  // level or fewer than m + 3 experiments are there.
  double whiteness_p = 0.0;
  Index first_predicted = 0;  // first step with a prediction
  std::vector<std::string> warnings;
};
// \throws std::invalid_argument where channels disagree or no step of the data has a model
Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options = {});

// Whiteness across the ensemble: for each step k and lag j the canonical correlation (Pillai's trace) over experiments
// of ε_k with ε_{k-j}. Experiments are independent, so the traces are uncorrelated with known mean and variance under
// whiteness, and their standardised sum is referred to the normal distribution (one-sided).
double whiteness_p(const std::vector<Matrix>& innovations, Index lags);

}  // namespace tokid
