// Departures → their GTV-ARX model, with p, λ, P and the initial state: of each step alone where the experiments
// suffice and show no noise, else of all steps coupled.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "tokid/finding.hpp"
#include "tokid/options.hpp"

namespace tokid {

struct Regressed {
  Plan plan;  // all but the method, n, and what comes after them
  GtvArx arx;
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;   // of each step alone
  SmoothingChoice smoothing_choice;  // of coupled steps
  Findings findings;
};

// `judged`: the samples that choices are judged by, see judging_samples(). `nominal`: a mean motion was removed.
// \throws std::invalid_argument for too few experiments, steps or windows without a gap
Regressed regressed(const Ensemble& departures, const Ensemble& judged, bool nominal, const IdentifyOptions& options);

// The regression of a plan that has been decided. \throws std::invalid_argument as above
GtvArx regressed_as(const Ensemble& departures, const Plan& plan, const Execution& execution);

// The experiments; or, of long ones, a stretch in the middle; or, where they are too few and their steps share a model,
// stretches of them. Refers to the data where it is all of them.
std::shared_ptr<const Ensemble> judging_samples(const Ensemble& data, const IdentifyOptions& options);

// Windows of p+1 steps without a gap are less than half of those that there would be without missing samples.
bool windows_are_scarce(const Ensemble& data, Index lags);

// Has a mean motion been removed that every experiment had its part in?
bool is_centred(const Plan& plan);

// N_min at this p; `nominal`: with the experiment that the mean motion costs
Index experiments_for(const Ensemble& data, Index lags, bool nominal);

}  // namespace tokid
