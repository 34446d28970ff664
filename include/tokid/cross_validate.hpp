// Cross-validation of an identification. Every experiment is predicted and simulated by a model that was identified
// without it.
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
  // Empty: experiment n is in fold n mod K, so that each fold represents an ordered campaign. A seed: the experiments
  // are assigned in random order.
  std::optional<std::uint64_t> seed = {};
};

struct Fold {
  std::vector<Index> experiments;             // rows of the held-out experiments
  std::vector<std::string> experiment_names;  // names of the held-out experiments; empty where the data give none
  Index states = 0, lags = 0;                 // n and p of the model of the other experiments
  Fit simulation, one_step, horizon;
  Findings findings;  // findings of the identification
};

struct CrossValidation {
  std::vector<Fold> folds;
  // Fits over all experiments, each computed by the model of its fold. ȳ is the mean motion of all experiments if any
  // fold has removed a mean motion.
  Fit simulation, one_step, horizon;
  Vector simulation_spread, one_step_spread, horizon_spread;  // (m) standard deviation of the fits of the folds [%]
  Findings findings;                                          // findings on the experiments of all folds together
};

// For each fold, identifies a model from the experiments of the other folds. Each identification makes all choices that
// the options leave open. Choices made from all experiments would use the held-out ones too. No further experiments are
// held out.
// \throws std::invalid_argument where the ensemble can't be divided into this number of folds, and as identify(), with
// the number of the fold in the message
CrossValidation cross_validate(const Ensemble& ensemble, const IdentifyOptions& identify_options = {},
                               const CrossValidateOptions& options = {});

// The warnings of all folds, without repetition.
Findings remarks(const CrossValidation& cross);

}  // namespace tokid
