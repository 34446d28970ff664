// Experiments and the choice of p and λ → a regression that may predict better than the models of this choice.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "choose/held_out_error.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

// Of the regressions that the choice of p and λ does not reach (more lags than EM starts from, one model for all steps,
// variation where one model for all steps was chosen), the one that predicts best.
struct Rival {
  Index lags = 0;
  double smoothing = 0.0;            // infinite: one model for all steps
  Squares squares;                   // of its predictions of the held-out experiments, joined()
  std::vector<Index> horizons = {};  // of these predictions, ascending
  Index from = 0;                    // first step of these predictions
};

// `choice`: p and λ, infinite for one model for all steps. `options.lags`: the orders that the samples determine.
// `reached`: the largest order among which p was chosen. `folds`: of the folds of the ensemble, so many are held out.
// Without a value if no other regression is possible.
std::optional<Rival> rival_of(const Ensemble& ensemble, const SmoothingOptions& options, Index lags, double smoothing,
                              Index reached, Index folds);

}  // namespace tokid
