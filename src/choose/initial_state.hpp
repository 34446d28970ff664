// GTV-ARX model that supposes zero initial states → whether they are, by the residuals of its first steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/options.hpp"

namespace tokid {

// As the options ask, or as the data say; nothing where neither does.
std::optional<InitialStateTest> stated_initial_state(const Ensemble& data, const IdentifyOptions& options);

// F test of the residuals of each step k < p and output against those of the steps after them, which an initial state
// does not reach. `freedom`: (T) degrees of freedom of the residuals of each step.
InitialStateTest test_initial_state(const GtvArx& arx, Index lags, const std::vector<Index>& freedom);

}  // namespace tokid
