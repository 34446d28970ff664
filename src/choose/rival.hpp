// Errors of the models of the folds → the regression beside the chosen one that predicts best.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "choose/regression_errors.hpp"

namespace tokid {

// The regressions beside the one that was chosen: more lags, one model for all steps, or variation where one model for
// all steps was chosen. The choice compares one step ahead only, and EM starts from few lags.
struct Rivals {
  SmoothingOptions options;       // `lags`: the orders that the samples determine, and p of the choice
  Index lags = 0;                 // p and λ of the choice
  double smoothing = 0.0;         // infinite: one model for all steps
  Index reached = 0;              // the largest order among which p was chosen
  std::vector<Index> jumps = {};  // of the choice, in the steps of the selection; its rivals have none
  bool stated = false;  // something is stated that a rival would change: the regression of the choice has none
};

// The rival with the smallest errors. `errors`: of regressions with these options. `of_models`: for each fold of the
// errors. A regression is given up after the first fold if that leaves it no chance against the models, and the next
// ones of its kind after two such regressions.
std::optional<RegressionErrors::Found> best_rival(const Rivals& rivals, const RegressionErrors& errors,
                                                  const std::vector<Squares>& of_models);

// Does the regression predict better by two standard errors? It often predicts as well as a model, and a second search
// takes much time.
bool surely_smaller(const HeldOutError& regression, const HeldOutError& model);

// By far more than that: by a factor too.
bool far_smaller(const HeldOutError& regression, const HeldOutError& model);

// Does the regression predict the same experiments about as well if it is fitted to more of the others? Where these are
// as many as its unknowns, regressions predict far worse than from fewer or from more experiments.
bool holds_with_nearly_all(const RegressionErrors::Found& regression, const RegressionErrors& errors,
                           const Ensemble& selection, const SmoothingOptions& options);

}  // namespace tokid
