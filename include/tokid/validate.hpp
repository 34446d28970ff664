// Validation of a model on data: fit of simulation and prediction, tests of the innovations.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "tokid/conclusion.hpp"
#include "tokid/innovations.hpp"
#include "tokid/model.hpp"

namespace tokid {

struct ValidateOptions {
  Index horizon = 1;                               // H of the H-step fit
  Index whiteness_lags = test_lags;                // lags of the innovation tests; 0: no tests
  std::optional<InitialState> initial_state = {};  // as in PredictOptions
  // Known outliers: labels of experiments (Ensemble::experiment_label()). Their samples are not reported as outlying.
  std::vector<std::string> misfits = {};
  // The fits compare from this step on, so that models that begin at different steps can be compared. The tests
  // take all steps.
  Index first_step = 0;
};

// Fit of output j: 100·(1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%], over all experiments and steps where both y and ŷ are known. ȳ is
// the nominal trajectory if the model has one, else the mean over experiments and steps. NaN if nothing can be
// compared.
struct Fit {
  Vector fit;         // (m) [%]
  Vector rmse;        // (m) in the unit of the output
  Index samples = 0;  // samples compared per output, the smallest number over the outputs
};
// Steps before first_step are not compared.
Fit fit(const Ensemble& measured, const Ensemble& computed, const Matrix& y_nominal = {}, Index first_step = 0);

// Outlying samples of one output of one experiment. Their one-step prediction errors exceed the usual error of the
// experiments at these steps by 6 standard deviations of a normal distribution, or more if the errors have heavier
// tails. The cause is a sensor fault, or a motion that differs from those of the other experiments.
struct OutlyingSamples {
  Index experiment = 0, output = 0;
  std::vector<Index> steps;
  double error = 0.0, usual = 0.0;  // largest error, and median error at its step; in the unit of the output
  std::string name;                 // name of the experiment; empty where the data give none
  // Weight in the identification: 1: as any other, 0: counted as missing. In between: moved towards the prediction, to
  // this share of the error.
  double weight = 1.0;
};

struct Validation {
  Fit simulation, one_step, horizon;
  bool noisy = false;  // true: innovations exceed rounding errors
  // Tests of the innovations; NaN and empty if the innovations are rounding errors or too few.
  double whiteness_p = std::numeric_limits<double>::quiet_NaN();  // whiteness.p
  Whiteness whiteness;
  Independence independence;  // from past and present inputs, lags 0 … whiteness_lags
  Independence feedback;  // from later inputs, lags -whiteness_lags … -1; a small p does not mean a fault of the model
  NormalisedSquares squares;
  InputGains gains;
  std::vector<OutlyingSamples> outlying;  // only for noisy data
  Index first_predicted = 0;              // first step of the fit of the predictions
  Index first_simulated = 0;              // first step of the fit of the simulation
  Findings findings;
};
// Validates a model on data. The findings don't compare sample times, names and units: differences() of model.hpp does
// so, and verdict() of report.hpp draws the conclusion whether the model can be trusted.
// \throws std::invalid_argument where channels disagree, for an infinite sample, if no step of the data has a model, or
// if the first step of the fits is outside these steps
Validation validate(const Model& model, const Ensemble& data, const ValidateOptions& options = {});
// Validates without copies. The findings name the experiments that are left out.
Validation validate_distinct(const Model& model, const Ensemble& data, const ValidateOptions& options = {});

// Fits and errors of each of N experiments alone. NaN where nothing can be compared.
struct ExperimentFits {
  using Counts = Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic>;

  // (N × m) [%] as in Fit, but ȳ is the mean over the steps of the experiment if the model has no nominal trajectory
  Matrix simulation_fit, one_step_fit;
  Matrix simulation_rmse, one_step_rmse;        // (N × m) in the units of the outputs
  Counts simulation_samples, one_step_samples;  // (N × m) compared samples
  // (N × m) RMS error one step ahead, as a multiple of its median over the experiments. NaN if the median is zero.
  Matrix over_median;
  // (N) RMS errors over steps and outputs, each relative to the spread of its output: the RMS of the samples of all
  // experiments and steps around ȳ of Fit
  Vector simulation_error, one_step_error;
  // Limits of these errors: 10 times their median over the experiments, and 0.05 at least. NaN if no error is finite.
  double simulation_limit = std::numeric_limits<double>::quiet_NaN();
  double one_step_limit = std::numeric_limits<double>::quiet_NaN();
  Vector excess;                   // (N) the larger one of both errors over their limits
  std::vector<Index> worst_first;  // the rows in falling order of `excess`; those without one come last
  // (N) the output with the largest part of the error that gives `excess`; without an error there is none
  std::vector<std::optional<Index>> worst_output;

  Index experiments() const { return excess.size(); }
  // The errors of experiment n are much larger than the usual ones. Of fewer than three experiments, this is true only
  // of one whose errors overflow beside another one.
  bool outlying(Index n) const { return excess(n) > 1; }
};
// All experiments count, copies too. \throws as validate()
ExperimentFits experiment_fits(const Model& model, const Ensemble& data, const ValidateOptions& options = {});

// The conclusion of each test of the innovations, for the tool, the page and Python.
Conclusions conclusions(const Validation& validation, const Channels& names);

}  // namespace tokid
