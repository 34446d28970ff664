// The tests and errors that decide the choices of an identification from noisy data.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/options.hpp"

namespace tokid {

// Test of the initial state. An initial state that is not zero enlarges the one-step errors of the steps k < p, but not
// those of later steps. The test compares their variances. The errors are residuals if each step has its own
// regression, and those of held-out experiments if the steps are coupled.
struct InitialStateTest {
  double statistic = 0.0;  // error variance of a step k < p over that of the later steps; largest over k and outputs
  double threshold = 0.0;
  InitialState decision = InitialState::zero;
  std::string reason;
};

// Errors of the model of each candidate state dimension n. Filled if n was chosen from noisy data.
struct OrderScores {
  std::vector<Index> horizons;  // (H) steps ahead, ascending; the first is 1
  std::vector<Index> states;    // the candidates
  // (candidates × H) Log of the RMS error over the RMS of the departures, mean over the outputs with their weights. Of
  // more than one step, it is at most 0, the error of predicting no departure.
  Matrix errors;
  bool cross_validated = false;  // true: cross-validation errors (subspace); false: errors on the training data (TVERA)
  double smoothing = 0.0;        // λ of the regressions on states, used for these errors
  Weighting weighting = Weighting::one_step;
  double price = 0.0;  // errors on the training data: penalty for each state, 2/3 (r+m) / (N m)
  double smallest = std::numeric_limits<double>::infinity();  // smallest mean()
  // Standard error, over the experiments, of the difference between mean() and its smallest value. Empty for errors on
  // the training data.
  std::vector<double> uncertainty;
  // The smallest n whose mean() exceeds the smallest mean() by no more than a margin. The margin is the entry of
  // `uncertainty`, but at least 0.5 % and at most 2 %.
  Index best = 0;

  void add(Index n, const Vector& errors_of_horizons);
  // The mean over the horizons, plus the penalty for the states.
  double mean(size_t i) const;
  void choose();
};

// One trial in the cross-validation of EM.
struct RefinementTrial {
  Index states = 0;        // n
  double smoothing = 0.0;  // λ of EM
  Index iterations = 0;    // most iterations of EM; 0: the subspace model without EM
  double error = 0.0;      // mean() of the logs of its errors, as in OrderScores
  // Mean over the held-out experiments. NaN without EM; -∞ if EM failed.
  double log_likelihood = std::numeric_limits<double>::quiet_NaN();
};
// A step at which the matrices jump.
struct Jump {
  Index step = 0;
  // Found by cross-validation: by how many standard errors the error of the held-out experiments is larger without this
  // jump. Empty if the jump was stated.
  std::optional<double> loss = {};
};
// How large the errors of predictions are, `horizon` steps ahead, on held-out experiments. NaN: not known.
struct AheadCertainty {
  static constexpr Index horizon = 10;
  double ratio = std::numeric_limits<double>::quiet_NaN();  // their RMS over what the model says
  // The least share of their variance that comes from the model: by how much the models of different folds differ.
  double model_share = std::numeric_limits<double>::quiet_NaN();
};
// The choice between all trials, by the log-likelihood of the held-out experiments. If steps share their matrices, the
// errors decide. Filled if EM was tried.
struct RefinementChoice {
  std::vector<RefinementTrial> trials;
  // n: OrderScores::best, or fewer states that suffice with EM. The first trial is the subspace model with
  // OrderScores::best.
  Index states = 0;
  double smoothing = 0.0;
  Index iterations = 0;  // most iterations of EM; 0: no refinement
  double error = 0.0;
  double one_step = 0.0;                             // log of the one-step error alone; set if there are iterations
  std::vector<Jump> jumps = {};                      // ascending
  AheadCertainty ahead = {}, ahead_without_em = {};  // of the chosen models of the folds, and of the subspace models
};

// Errors of predictions of held-out experiments, for each of H horizons: the RMS of each output's errors over that of
// its departures from the mean motion, mean over the outputs with their weights. Where a horizon has no value: NaN.
struct HeldOutErrors {
  Vector error, standard_error;  // (H), the latter over the experiments
};
// The errors of the models of the folds beside those of the regression that predicts best, on the same experiments.
struct RegressionComparison {
  std::vector<Index> horizons;  // (H) steps ahead, ascending; the first is 1
  Index experiments = 0;        // held out, each once
  Index first_step = 0;         // the first that is predicted
  HeldOutErrors model, regression;
  Index lags = 0;          // p and λ of the regression
  double smoothing = 0.0;  // infinite: one regression for all steps
};
}  // namespace tokid
