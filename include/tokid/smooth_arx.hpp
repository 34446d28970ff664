// Windows → GTV-ARX model of all steps in one regression, with coefficients coupled over time. For noisy data and few
// experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/options.hpp"

namespace tokid {

struct SmoothArxOptions {
  Index lags = 1;                                   // p
  InitialState initial_state = InitialState::zero;  // zero: lags before k = 0 are zero; unknown: only steps k ≥ p
  bool feedthrough = true;                          // false: D_k = 0 is known
  TimeVariation variation = {};
  Execution execution = {};
};

// Minimises Σ_k ‖Y_k - W_k M_kᵀ‖² + penalty. A step without a complete experiment gets its coefficients from its
// neighbours. If the matrices of the system jump at step J, the coefficients change at the steps J to J+p, because the
// p past samples then come from both sides. The penalties on these p+1 changes are loose: see random_walk_regression().
// The result has `lags`, `rows`, `coefficients`, `output_rms` and `residual_cov` (EᵀE / rows) of each step, but no
// noise shapes. \throws std::invalid_argument for a lag order below 1 or beyond the data, a negative smoothing or
// period
GtvArx smooth_arx(const Windows& windows, const SmoothArxOptions& options = {});

// (T) By how much this minimum falls if the matrices may also jump at step k, in units of the residual covariance of
// all steps. For a model without a period, with a positive and finite smoothing. \throws std::invalid_argument as
// smooth_arx()
Vector jump_gains(const Windows& windows, const SmoothArxOptions& options);

// The choice of p and λ by cross-validation over the experiments, by one-step errors.
struct SmoothingTrial {
  Index lags = 0;
  double smoothing = 0.0;
  // Relative RMS one-step error in cross-validation, geometric mean over the outputs with `output_weights`.
  double error = 0.0;
};
struct SmoothingChoice {
  std::vector<SmoothingTrial> trials;  // in the order of the search
  Index lags = 0;
  double smoothing = 0.0;
  double error = 0.0;
};
struct SmoothingOptions {
  Index folds = 5;                       // F; a number above N means N
  std::vector<Index> lags;               // the orders to choose from, ascending
  std::optional<double> smoothing = {};  // λ; empty: chosen between 0 and infinity
  InitialState initial_state = InitialState::zero;
  bool feedthrough = true;  // as in SmoothArxOptions
  Index period = 0;
  bool centred = false;           // true: the data are departures from a mean motion; see fold()
  Vector output_weights = {};     // (m) weights of the outputs, 0 or more; empty: all outputs count alike
  std::vector<Index> jumps = {};  // as in TimeVariation
  // An ensemble without a period that has more steps is tested on four stretches only, if these are shorter together.
  // Each stretch has steps/4 steps, but at least twice the largest lag order.
  Index steps = 256;
  Execution execution = {};
};
// A local search over λ (in half decades) and p: it goes from a trial to a better neighbour until no neighbour is
// better.
// \throws std::invalid_argument for fewer than two experiments, no lag order or another number of weights than m
SmoothingChoice choose_smoothing(const Ensemble& ensemble, const SmoothingOptions& options);

// Fold f of F: the held-out experiments n = f, f+F, f+2F … and the training experiments. `centred`: both parts become
// departures from the mean motion of the training part. This is necessary because the mean motion that was removed
// before also depends on the held-out experiments.
Split fold(const Ensemble& ensemble, Index f, Index folds, bool centred);
// F for an ensemble of this size: N for up to 10 experiments, else 5.
Index fold_count(Index experiments);

}  // namespace tokid
