// Cross-validation of an identification. Every experiment is predicted and simulated by a model that was identified
// without this experiment.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tokid/identify.hpp"

namespace tokid {

struct CrossValidateOptions {
  Index folds = 5;    // K, 2 ≤ K ≤ N; K = N leaves one experiment out at a time
  Index horizon = 1;  // H of the H-step fit
  // Empty: experiment n is in fold n mod K. If the conditions drift from the first to the last experiment, each fold
  // then contains all conditions. A seed: the folds are random.
  std::optional<std::uint64_t> seed = {};
  Index first_step = 0;  // of the fits, as in ValidateOptions
};

struct Fold {
  std::vector<Index> experiments;             // rows of the held-out experiments
  std::vector<std::string> experiment_names;  // names of the held-out experiments; empty where the data give none
  Index states = 0, lags = 0;                 // n and p of the model from the other folds
  Fit simulation, one_step, horizon;
  Findings findings;  // findings of the identification
};

struct CrossValidation {
  std::vector<Fold> folds;
  // Fits over all experiments; each experiment is computed by the model that was identified without its fold. In the
  // fit, ȳ is the mean motion of all experiments if the identification of any fold removed a mean motion.
  Fit simulation, one_step, horizon;
  Vector simulation_spread, one_step_spread, horizon_spread;  // (m) standard deviation of the fits of the folds [%]
  Findings findings;                                          // findings about all experiments together
};

// For each fold, identifies a model from the experiments of the other folds. Each identification makes again all
// choices that the options leave open, because choices from all experiments would depend on the held-out experiments.
// `hold_out` is ignored.
// \throws std::invalid_argument if the ensemble can't be divided into this number of folds. \throws as identify(); the
// message then names the fold
CrossValidation cross_validate(const Ensemble& ensemble, const IdentifyOptions& identify_options = {},
                               const CrossValidateOptions& options = {});

// The warnings of all folds, without repetition.
Findings remarks(const CrossValidation& cross);

}  // namespace tokid
