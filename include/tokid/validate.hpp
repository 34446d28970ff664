// How good is a model on data: fit of simulation and prediction, tests of the innovations.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>

#include "tokid/innovations.hpp"
#include "tokid/model.hpp"

namespace tokid {

struct ValidateOptions {
  Index horizon = 1;                               // H of the H-step fit
  Index whiteness_lags = test_lags;                // of the tests of the innovations; 0: none of them
  std::optional<InitialState> initial_state = {};  // as in PredictOptions
  // Experiments that are known not to fit, by name, or by row where they have none: outlying samples are those of
  // others.
  std::vector<std::string> misfits = {};
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

// Samples of one output of one experiment that lie farther off their predictions one step ahead than 20 times the
// median over the experiments at that time, and than 5 % of the spread of the output: faults of a sensor, or another
// motion.
struct OutlyingSamples {
  Index experiment = 0, output = 0;
  std::vector<Index> steps;
  double error = 0.0, usual = 0.0;  // the largest, and the median there; in the unit of the output
  std::string name;                 // of the experiment; empty where the data give it none
};

struct Validation {
  Fit simulation, one_step, horizon;
  bool noisy = false;  // innovations beyond rounding errors
  // Tests of the innovations; NaN and empty where these are at rounding level or too few.
  double whiteness_p = std::numeric_limits<double>::quiet_NaN();  // whiteness.p
  Whiteness whiteness;
  Independence independence;  // of past and present inputs, lags 0 … whiteness_lags
  Independence feedback;      // of later inputs, lags -whiteness_lags … -1: a small p is no fault of the model
  NormalisedSquares squares;
  InputGains gains;
  std::vector<OutlyingSamples> outlying;  // of noisy data
  Index first_predicted = 0;              // first step with a prediction
  Index first_simulated = 0;              // and with a simulation
  Findings findings;
};
// \throws std::invalid_argument where channels disagree or no step of the data has a model
Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options = {});
// Judged by the experiments that tell something of their own: copies once, and no combinations of others, which the
// warnings name.
Validation validate_distinct(const Model& model, const Ensemble& data, const ValidateOptions& options = {});

// What a test of the innovations says against a model: nothing; something beyond chance that is too small to matter; or
// something that counts.
enum class TestResult { untested, nothing, negligible, against };
const char* to_string(TestResult result);  // "untested", "nothing", "negligible", "against"

// A test in words, the same for every reader.
struct Conclusion {
  TestResult result = TestResult::untested;
  std::string text;  // the probability, and what it means
};
struct Conclusions {
  Conclusion squares, whiteness, inputs, gains, feedback;
};
Conclusions conclusions(const Validation& validation, const Channels& names);

}  // namespace tokid
