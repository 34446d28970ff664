// A validation together with the outputs that it compared. Pages show these outputs, and a validation takes most of its
// time to compute them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/validate.hpp"

namespace tokid {

struct Comparison {
  Validation validation;
  Prediction prediction;  // one step ahead
  Ensemble simulated;     // simulate_data()
  ExperimentFits experiments;
  // The innovations that were tested, over their standard deviations. Empty if the data are free of noise.
  Innovations tested;
};
// The validation is that of validate_in_numbers(). \throws as validate()
Comparison compare(const Model& model, const Ensemble& data, const ValidateOptions& options);
// Validation::horizon alone: the fit of the predictions options.horizon steps ahead.
Fit horizon_fit(const Model& model, const Ensemble& data, const ValidateOptions& options);

// The fits of each experiment, from the innovations and the simulation of the model. Steps before first_step are not
// compared. `model` must have all steps of the data that are compared (continued()).
ExperimentFits experiment_fits(const Model& model, const Ensemble& data, const Innovations& innovations,
                               const Ensemble& simulated, Index first_step);
// The errors of an experiment are outlying if they are larger than this multiple of their median over the experiments,
// and than this share of the spread of the outputs.
inline constexpr double outlying_experiment = 10.0, least_outlying_error = 0.05;

// \throws std::invalid_argument unless 0 ≤ first_step < end
void check_first_step(Index first_step, Index end);
// \throws std::invalid_argument where the data end before the model begins, or options.first_step is out of range
void check_steps(const Model& model, const Ensemble& data, const ValidateOptions& options);

// validate() without findings on outlying samples. It is for callers that have the complete data and add these findings
// themselves.
Validation validate_in_numbers(const Model& model, const Ensemble& data, const ValidateOptions& options);

}  // namespace tokid
