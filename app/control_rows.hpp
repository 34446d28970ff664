// What lqr and info print of a controller.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "common.hpp"

namespace tokid::app {

void add_weights_rows(Page& page, const CostWeights& weights);
// `rates`: are there weights on input rates? `nominal`: the cost with the nominal inputs alone, if known.
void add_cost_rows(Page& page, const ExpectedCost& cost, bool rates, const std::optional<ExpectedCost>& nominal);

Json json_of(const ExpectedCost& cost);

}  // namespace tokid::app
