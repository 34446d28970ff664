// GTV-ARX model → state-space model, with the method, n, the weighting, and EM as far as it helps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "choose/regression.hpp"

namespace tokid {

struct Realised {
  Model model;  // in the coordinates of its realisation
  Plan plan;    // all of it
  OrderScores order_scores;
  RefinementChoice refinement;
  Findings findings;
};

// `judged`: see judging_samples(). \throws as realise() and refine()
Realised realised(const Ensemble& departures, const Ensemble& judged, const Plan& plan, GtvArx arx,
                  const IdentifyOptions& options);

// The model of a plan that has been decided, with as much EM as it says. \throws as above
Model realised_as(const Ensemble& departures, GtvArx arx, const Plan& plan, const Execution& execution);

}  // namespace tokid
