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
  SmoothingOptions options;  // `lags`: the orders that the samples determine
  Index lags = 0;            // p and λ of the choice
  double smoothing = 0.0;    // infinite: one model for all steps
  Index reached = 0;         // the largest order among which p was chosen
  bool stated = false;       // p, λ or one model for all steps is stated: the regression of the choice has no rival
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

// Is the regression itself to be the model, with all its p·m states? It must predict better than a model of so many
// states, the more so the fewer these are, and also if it is fitted to nearly all experiments: where the experiments
// are as many as its unknowns, regressions predict far worse than from fewer or from more experiments.
bool replaces_model(const RegressionErrors::Found& regression, const HeldOutError& model, Index states,
                    const Ensemble& selection, const SmoothingOptions& options);

}  // namespace tokid
