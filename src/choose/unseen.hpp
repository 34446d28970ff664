// Ensemble and plan → innovations of each experiment by a model that was identified without this experiment.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/innovations.hpp"
#include "tokid/plan.hpp"

namespace tokid {

struct Unseen {
  Innovations innovations;  // T matrices of N × m, NaN where there is none
  Matrix response;          // (N × m) RMS of the simulated outputs, as departures from the mean motion
};

// Divides the experiments into folds of every fold_count(N)-th one. Identifies a model for each fold from the
// experiments outside it, with the choices of the plan and without EM. The model predicts and simulates the experiments
// of its fold. Experiments with 1 in `out` (N) are in folds too, but no model is identified from them. `measured`: with
// their mean motion. Without a value if the experiments outside a fold are too few for this plan.
std::optional<Unseen> unseen(const Ensemble& measured, const Plan& plan, const std::vector<char>& out,
                             const Execution& execution = {});
// The same by one model of all experiments.
Unseen seen(const Ensemble& measured, Model model, const Plan& plan);

}  // namespace tokid
