// How good are the models that a way of identification makes of such data? Every experiment is judged by a model that
// has not seen it.
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
  // Empty: experiment n is in fold n mod K, so that all folds represent an ordered campaign. Else in random order.
  std::optional<std::uint64_t> seed = {};
};

struct Fold {
  std::vector<Index> experiments;             // row numbers of those that were kept back
  std::vector<std::string> experiment_names;  // of the same, empty where the data give none
  Index states = 0, lags = 0;                 // of the model of the others
  Fit simulation, one_step, horizon;
  Findings findings;  // of the identification
};

struct CrossValidation {
  std::vector<Fold> folds;
  // Over all experiments, as computed in their folds; ȳ is the mean motion of all experiments if any fold has removed
  // one.
  Fit simulation, one_step, horizon;
  Vector simulation_spread, one_step_spread, horizon_spread;  // (m) standard deviation of the fits of the folds [%]
  Findings findings;                                          // of the experiments of all folds together
};

// Identifies once per fold on the other experiments, leaving to each identification all choices that the options leave
// open: a choice made with all experiments in sight would know those of the fold. No further experiments are held out.
// \throws std::invalid_argument for a number of folds that the ensemble can't be cut into, and as identify() with the
// fold in which it happened
CrossValidation cross_validate(const Ensemble& ensemble, const IdentifyOptions& identify_options = {},
                               const CrossValidateOptions& options = {});

// The warnings of the folds, each of them once.
Findings remarks(const CrossValidation& cross);

}  // namespace tokid
