// Errors of the models of the folds → the regression that predicts best.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "choose/regression_errors.hpp"

namespace tokid {

// The regression that was chosen by errors one step ahead, and what may be compared with it. EM starts from few lags,
// so that the choice does not reach all orders that the samples determine.
struct Rivals {
  SmoothingOptions options;       // `lags`: the orders that the samples determine, and p of the choice
  Index lags = 0;                 // p and λ of the choice
  double smoothing = 0.0;         // infinite: one model for all steps
  std::vector<Index> jumps = {};  // of the choice, in the steps of the selection; its rivals have none
  bool stated = false;  // something is stated that a rival would change: the regression of the choice has none
  bool more_lags = false;  // the samples determine larger orders, too, which would take too long
};

// The regression with the smallest errors: the chosen one, or one with more lags, one model for all steps, or variation
// where one model for all steps was chosen. `errors`: of regressions with these options. `chosen`: the chosen one.
// `of_models`: for each fold of the errors. A regression is given up after the first fold if that leaves it no chance
// against the models.
RegressionErrors::Found best_regression(const Rivals& rivals, const RegressionErrors& errors,
                                        RegressionErrors::Found chosen, const std::vector<Squares>& of_models);

// Does the regression predict better by one standard error, and by `most_uncertain`, since it has many states?
bool surely_smaller(const HeldOutError& regression, const HeldOutError& model);

// By far more than that: by a factor too.
bool far_smaller(const HeldOutError& regression, const HeldOutError& model);

// Does the regression predict the same experiments about as well if it is fitted to more of the others? Where these are
// as many as its unknowns, regressions predict far worse than from fewer or from more experiments.
bool holds_with_nearly_all(const RegressionErrors::Found& regression, const RegressionErrors& errors,
                           const Ensemble& selection, const SmoothingOptions& options);

}  // namespace tokid
