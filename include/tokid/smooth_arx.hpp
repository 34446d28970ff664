// Windows → GTV-ARX model of all steps in one regression, with coefficients coupled over time: for noise and few
// experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/gtv_arx.hpp"

namespace tokid {

// The allowed variation of a model over time: free, slow, periodic or none.
struct TimeVariation {
  // λ of the penalty  λ N Σ_k ‖(M_{k+1} - M_k) diag(rms of the regressors)‖²  on the residual sum of squares. N is the
  // mean number of experiments of a step; with a period, of rows of a phase. 0: each step uses its own data only.
  // Infinity: all steps have the same coefficients.
  double smoothing = 0.0;
  Index period = 0;  // P: the steps k and k+P share one model; 1: all steps; 0: no period

  Index groups(Index steps) const { return period > 0 && period < steps ? period : steps; }
  Index group(Index k) const { return period > 0 ? k % period : k; }  // group of step k: the steps that share its model
};

struct SmoothArxOptions {
  Index lags = 1;                                   // p
  InitialState initial_state = InitialState::zero;  // zero: lags before k = 0 are zero; unknown: only steps k ≥ p
  bool feedthrough = true;                          // false: D_k = 0 is known
  TimeVariation variation = {};
  Execution execution = {};
};

// Minimises Σ_k ‖Y_k - W_k M_kᵀ‖² + penalty. A step without a complete experiment gets its coefficients from its
// neighbours. The result has `lags`, `rows`, `coefficients`, `output_rms` and `residual_cov` (EᵀE / rows) of each step,
// but no noise shapes. \throws std::invalid_argument for a lag order below 1 or beyond the data, a negative smoothing
// or period
GtvArx smooth_arx(const Windows& windows, const SmoothArxOptions& options = {});

// The choice of p and λ by cross-validation over the experiments, by one-step errors.
struct SmoothingTrial {
  Index lags = 0;
  double smoothing = 0.0;
  double error = 0.0;  // relative RMS one-step error in cross-validation, geometric mean over the outputs
};
struct SmoothingChoice {
  std::vector<SmoothingTrial> trials;  // in the order of the search
  Index lags = 0;
  double smoothing = 0.0;
  double error = 0.0;
};
struct SmoothingOptions {
  Index folds = 5;                       // F; more than N counts as N
  std::vector<Index> lags;               // the orders to choose from, ascending
  std::optional<double> smoothing = {};  // λ; empty: chosen between 0 and infinity
  InitialState initial_state = InitialState::zero;
  bool feedthrough = true;  // as in SmoothArxOptions
  Index period = 0;
  bool centred = false;  // departures from a mean motion; see fold()
  // Ensembles without a period and with more steps are tested on four stretches. Each stretch has a quarter of this
  // length, but at least twice the largest lag order.
  Index steps = 256;
  Execution execution = {};
};
// A local search: goes from one trial to the better of its neighbours in λ (half decades) and p, until no neighbour is
// better.
// \throws std::invalid_argument for fewer than two experiments or no lag order
SmoothingChoice choose_smoothing(const Ensemble& ensemble, const SmoothingOptions& options);

// Fold f of F: the held-out experiments n = f, f+F, f+2F … and the training experiments. `centred`: both parts become
// departures from the mean motion of the training part. This is necessary because the held-out experiments contributed
// to the mean motion that was removed before.
Split fold(const Ensemble& ensemble, Index f, Index folds, bool centred);
// F for an ensemble of this size: N for up to 10 experiments, else 5.
Index fold_count(Index experiments);

}  // namespace tokid
