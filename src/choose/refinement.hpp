// Models of the folds without EM → the number of states, the jumps, λ and the iterations of EM, by cross-validation.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "base/search_progress.hpp"
#include "choose/held_out_error.hpp"
#include "data/rows.hpp"
#include "tokid/choices.hpp"
#include "tokid/em.hpp"

namespace tokid {

// After so many iterations, no further stage of EM begins.
inline constexpr Index most_iterations = 480;
// Goes on with EM from the end of one stage to that of another, in the same stages as cross-validation has. `from`,
// `to`: iterations.
Model refined(Model model, const Ensemble& data, Index from, Index to, const RefineOptions& options);
// The number of steps that EM uses: all, unless the steps share their matrices and a part has enough samples for these.
Index refined_steps(const Ensemble& data, Index period);
// The iterations at the end of the next stage.
Index next_stage_end(Index iterations);
// Was EM best after so few iterations that more are not tried?
bool stopped_early(Index iterations, const RefineOptions& options);

// The models of the folds that EM begins with, with so many states.
using FoldStarts = std::function<std::vector<Model>(Index states)>;

struct RefinementSettings {
  RefineOptions em;                   // period, initial state (needed), feedthrough and jumps, as in Plan
  double smoothing = 1.0;             // a search for λ begins near this one
  std::optional<double> stated = {};  // λ, if it is stated
  Vector output_weights;              // (m), needed
  Ahead ahead;                        // `from`: where the observers have settled
  std::vector<const Split*> data;     // departures of the folds that have models
  Index folds = 1;                    // of all experiments
  int threads = 1;
};

struct RefinementOfFolds {
  RefinementChoice choice;
  std::vector<Model> models;  // of the folds, by EM if it is used
};

// `models`: of the folds, with so many states and without EM, which predict from step 0 on.
// `or_fewer`: fewer states are used if the likelihood is hardly lower and the errors are at most `most_uncertain`
// larger. The interval between numbers that do and do not suffice is halved. In the end, neither one nor two fewer
// suffice. `work` counts iterations of one fold.
RefinementOfFolds choose_refinement(Index states, std::vector<Model> models, bool or_fewer, const FoldStarts& starts,
                                    const RefinementSettings& settings, SearchProgress& work);

}  // namespace tokid
