// What experiments must have in common for their windows to be merged.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/windows.hpp"

namespace tokid {

// Window factors without factors, sums and counted rows: sizes, names, dt and initial states alone.
WindowFactors kind_of(const Ensemble& ensemble, Index lags, InitialState initial_state);

// \throws std::invalid_argument that names what differs. Looks at their kinds alone
void check_alike(const WindowFactors& factors, const WindowFactors& others);

}  // namespace tokid
