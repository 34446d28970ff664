// GTV-ARX model that assumes zero initial states → a test of this assumption by the residuals of the first steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid {

// The initial state that the options state. If the options state none, the initial state that the data state. Empty if
// neither options nor data state one.
std::optional<InitialStateTest> stated_initial_state(const Ensemble& data, const IdentifyOptions& options);

// F test of the residuals at each step k < p and output against the residuals of later steps. The initial state does
// not affect the later steps. `freedom`: (T) degrees of freedom of the residuals of each step.
InitialStateTest test_initial_state(const GtvArx& arx, Index lags, const std::vector<Index>& freedom);

}  // namespace tokid
