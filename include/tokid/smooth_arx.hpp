// Ensemble → GTV-ARX model of all steps at once, its coefficients coupled over time: for noise and few experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/gtv_arx.hpp"

namespace tokid {

// How a model may vary with time: freely, slowly, periodically, not at all.
struct TimeVariation {
  // λ of the penalty  λ N Σ_k ‖(M_{k+1} - M_k) diag(rms of the regressors)‖²  on the residual sum of squares, N the
  // experiments of a step: 0 leaves each step to its own data, infinity makes all steps one.
  double smoothing = 0.0;
  Index period = 0;  // P: the steps k and k+P share one model; 1: all steps; 0: no period

  Index groups(Index steps) const { return period > 0 && period < steps ? period : steps; }
  Index group(Index k) const { return period > 0 ? k % period : k; }  // of step k: the steps that share its model
};

struct SmoothArxOptions {
  Index lags = 1;                                   // p
  InitialState initial_state = InitialState::zero;  // zero: lags before k = 0 are zero; unknown: k ≥ p only
  TimeVariation variation = {};
  Execution execution = {};
};

// min Σ_k ‖Y_k - W_k M_kᵀ‖² + penalty. Steps that no experiment has whole take their coefficients from their
// neighbours. Of the result's steps `lags`, `rows`, `coefficients`, `output_rms` and `residual_cov` (EᵀE / rows) are
// filled, and noise shapes not stored. \throws std::invalid_argument for a lag order below 1 or beyond the data, a
// negative smoothing or period
GtvArx smooth_arx(const Ensemble& ensemble, const SmoothArxOptions& options = {});

// p and λ by cross-validation over the experiments: one-step errors on experiments left out.
struct SmoothingTrial {
  Index lags = 0;
  double smoothing = 0.0;
  double error = 0.0;  // relative RMS one-step error, geometric mean over the outputs
};
struct SmoothingChoice {
  std::vector<SmoothingTrial> trials;  // in the order in which they were made
  Index lags = 0;
  double smoothing = 0.0;
  double error = 0.0;
};
struct SmoothingOptions {
  Index folds = 5;          // N where there are no more than 10 experiments
  std::vector<Index> lags;  // the orders to choose from, ascending
  double smoothing = -1.0;  // λ where it is given, else chosen between 0 and infinity
  InitialState initial_state = InitialState::zero;
  Index period = 0;
  bool centred = false;  // departures from a mean motion: see fold()
  Index steps = 256;     // longer ensembles are judged by four stretches of a quarter of this length each
  Execution execution = {};
};
// Climbs from one trial to the better of its neighbours in λ (half decades) and p, until none is better.
// \throws std::invalid_argument for fewer than two experiments or no lag order
SmoothingChoice choose_smoothing(const Ensemble& ensemble, const SmoothingOptions& options);

// The experiments of fold f of F: n = f, f+F, f+2F … and the others. `centred`: both as departures from the mean motion
// of the others, as those left out have had their part in the one that was removed before.
Split fold(const Ensemble& ensemble, Index f, Index folds, bool centred);
// F for an ensemble of so many experiments: 5, or N up to 10.
Index fold_count(Index experiments);

}  // namespace tokid
