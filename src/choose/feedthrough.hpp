// Departures and the variation of their regression → does the model have feedthrough?
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/plan.hpp"

namespace tokid {

// Decides whether the outputs respond to the inputs of the same step, by two tests of noisy data. The regressions of
// the tests have the p, λ and P of the plan.
FeedthroughChoice choose_feedthrough(const Ensemble& departures, const Plan& plan, const Execution& execution);

// Warning if feedthrough and feedback within a step cannot be distinguished.
Findings findings_of(const FeedthroughChoice& choice, const Channels& names);

}  // namespace tokid
