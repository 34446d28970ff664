// Inputs whose windows a preliminary model expects to be well conditioned.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/design.hpp"

namespace tokid::design {

// Improves inputs (N × T·r) by descent within |u| ≤ amplitude (r). The windows are those of the steps k ≥ first, of
// min(p, k - k_begin) lags.
Matrix optimise(const Model& model, const Matrix& start, const Vector& amplitude, Index lags, Index first,
                Index iterations, const Execution& execution);

}  // namespace tokid::design
