// What lqr and info print of a controller.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "common.hpp"

namespace tokid::app {

void add_weights_rows(Page& page, const CostWeights& weights);
// `rates`: are there weights on input rates?
void add_cost_rows(Page& page, const ExpectedCost& cost, bool rates);

Json json_of(const ExpectedCost& cost);

}  // namespace tokid::app
