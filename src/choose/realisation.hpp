// GTV-ARX model → state-space model. Chooses the method, n, the weighting, and the number of EM iterations.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "choose/regression.hpp"

namespace tokid {

// TVERA for uncoupled steps of data without noise from zero initial states, otherwise the subspace realisation.
Method automatic_method(const Plan& plan);

struct Realised {
  Model model;  // in the coordinates of its realisation
  Plan plan;    // complete
  OrderScores order_scores;
  RefinementChoice refinement;
  std::optional<RegressionComparison> comparison;  // of coupled steps without a period above 1
  Findings findings;
  bool instead = false;  // of another regression than the chosen one
};

// Gets the model before EM, if EM follows, and its plan.
using BeforeEm = std::function<void(const Model&, const Plan&)>;

// `selection`: see selection_samples(), may refer to `departures`. Frees the samples once they are not needed, because
// without noise a realisation takes the most memory. Uses up the coefficients of `regression`, which becomes that of
// the rival if the model does. \throws as realise() and refine()
Realised realised(Ensemble&& departures, const Selection& selection, Regressed& regression,
                  const IdentifyOptions& options, const BeforeEm& before_em = {});

// Returns the model of a decided plan, with the EM iterations of the plan. \throws as above
Model realised_as(const Ensemble& departures, GtvArx arx, const Plan& plan, const Execution& execution);

}  // namespace tokid
