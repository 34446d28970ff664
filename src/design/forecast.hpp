// Forecasts the results of planned inputs for a known system.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/design.hpp"

namespace tokid::design {

// The departures that inputs (N × T·r) cause without noise, from the zero state at k_begin. They are zero before the
// model begins.
Ensemble response(const Model& model, const Matrix& inputs);

struct NoisyRegression {
  double floor = 0.0;  // RMS of the best one-step error of p lags over the RMS of the outputs, noise included in both
  // The expected RMS error of D_k and h_{k,k-1} … h_{k,k-p}, divided by their RMS value and multiplied by √(N - L - 1).
  double markov_error = 0.0;
};
// Means over the steps k ≥ first. The covariance of the noise is added to the second moments of the regressors.
NoisyRegression noisy_regression(const Model& model, const Ensemble& response, Index lags, Index first,
                                 const NoiseLevel& noise);

}  // namespace tokid::design
