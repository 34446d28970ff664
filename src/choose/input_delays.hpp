// Experiments → the dead times of their inputs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

// (r) Steps of dead time of each input, by cross-validation of regressions with few lags; empty if there are none. Dead
// times below these few lags count as none, because the states of a model explain them as well.
std::vector<Index> find_delays(const Ensemble& departures, const Execution& execution);

}  // namespace tokid
