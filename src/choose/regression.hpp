// Departures → their GTV-ARX model. Chooses p, λ, P and the initial state. If the experiments suffice and are free of
// noise, each step has its own regression. Otherwise one regression couples all steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "choose/rival.hpp"
#include "tokid/choices.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/plan.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

struct Regressed {
  Plan plan;  // without the method, n, and later choices
  GtvArx arx;
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;   // from regressions of each step alone
  SmoothingChoice smoothing_choice;  // from coupled steps
  std::vector<Jump> jumps;           // of coupled steps
  std::optional<Rivals> rivals;      // of coupled steps without a period above 1, if the choices are cross-validated
  Findings findings;
};

// The samples for cross-validation: all experiments, or a stretch in the middle of long ones, or some of very many. If
// steps share a model and the experiments are few, the experiments are cut into pieces.
struct Selection {
  std::shared_ptr<const Ensemble> samples;  // refers to the data if all samples are used
  Index begin = 0;                          // step of the data at which the samples begin
  bool from_start = true;                   // all experiments begin with step 0 of the data
};
Selection selection_samples(const Ensemble& data, const IdentifyOptions& options);

// The jumps within the selected samples, in their steps.
std::vector<Index> jumps_within(const std::vector<Index>& jumps, const Selection& selection);

// `nominal`: a mean motion was removed.
// \throws std::invalid_argument for too few experiments, steps or windows without a gap
Regressed regressed(const Ensemble& departures, const Selection& selection, bool nominal,
                    const IdentifyOptions& options);

// Takes p and λ of a rival, which is one of `rivals`.
Regressed regressed_as(const RegressionErrors::Found& rival, const Rivals& rivals, const Ensemble& departures,
                       const Selection& selection, bool nominal, const IdentifyOptions& options);

// Fits the regression of a decided plan. \throws std::invalid_argument as above
GtvArx regressed_as(const Ensemble& departures, const Plan& plan, const Execution& execution);

// Are fewer than half of all windows of p+1 steps free of missing samples?
bool windows_are_scarce(const Ensemble& data, Index lags);

// N_min at this lag order, plus one if a mean motion is subtracted, because estimating it uses one degree of freedom.
Index experiments_for(const Ensemble& data, Index lags, const Plan& plan);

}  // namespace tokid
