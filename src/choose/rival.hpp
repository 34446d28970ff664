// Errors of the models of the folds → a regression that predicts better than these models, if there is one.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "choose/regression_errors.hpp"

namespace tokid {

// The regressions that the choice of p and λ does not reach: more lags than EM starts from, one model for all steps, or
// variation where one model for all steps was chosen.
struct Rivals {
  SmoothingOptions options;  // `lags`: the orders that the samples determine
  Index lags = 0;            // p and λ of the choice
  double smoothing = 0.0;    // infinite: one model for all steps
  Index reached = 0;         // the largest order among which p was chosen
};

struct Rival {
  Index lags = 0;
  double smoothing = 0.0;  // infinite: one model for all steps
};

// `errors`: of regressions with these options. `of_models`: for each fold of the errors. A regression is given up after
// the first fold if that leaves it no chance, and the next ones of its kind after two such regressions. Without a value
// if no regression predicts better by two standard errors.
std::optional<Rival> better_rival(const Rivals& rivals, const RegressionErrors& errors,
                                  const std::vector<Squares>& of_models);

}  // namespace tokid
