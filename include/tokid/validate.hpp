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

// Are the innovations of successive steps correlated? For each step k and lag j the canonical correlation (Pillai's
// trace) over experiments of ε_k with ε_{k-j}. Experiments are independent, so the traces are uncorrelated with known
// mean and variance under whiteness, and their standardised sum is referred to the normal distribution (one-sided).
struct Whiteness {
  double p = 0.0;      // probability of innovations as correlated as these if they were white; NaN where no step has
                       // more than m + 2 experiments
  Vector z;            // (lags) the standardised sum of each lag alone
  Matrix correlation;  // (lags × m): of every output with itself j steps before, mean over the steps of the
                       // correlation over experiments
  Vector bound;        // (lags): 99 % of the entries of `correlation` are smaller in size if the innovations are white
};
Whiteness whiteness(const std::vector<Matrix>& innovations, Index lags);

struct Validation {
  Fit simulation, one_step, horizon;
  bool noisy = false;  // innovations beyond rounding errors
  // Probability of innovations as correlated as these if they were white; NaN where the innovations are at rounding
  // level or fewer than m + 3 experiments are there.
  double whiteness_p = 0.0;
  Whiteness whiteness;        // lag by lag; empty where the innovations are at rounding level
  Index first_predicted = 0;  // first step with a prediction
  std::vector<std::string> warnings;
};
// \throws std::invalid_argument where channels disagree or no step of the data has a model
Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options = {});

// The simulation that is judged: outputs for the inputs of the data alone, from the known initial state or, where that
// is unknown, from the one that the first samples tell; NaN where there is none.
Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state = {});

// whiteness(innovations, lags).p
double whiteness_p(const std::vector<Matrix>& innovations, Index lags);

}  // namespace tokid
