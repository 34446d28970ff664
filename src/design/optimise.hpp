// Optimises inputs so that a preliminary model expects well-conditioned windows.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/design.hpp"

namespace tokid::design {

struct Windows {
  Index lags = 0, first = 0;  // windows of the steps k ≥ first, of min(p, k - k_begin) lags
  bool centred = false;       // windows are evaluated without their mean over the experiments
};

// Improves inputs (N × T·r) by descent within their limits |u| ≤ amplitude (r).
Matrix optimise(const Model& model, const Matrix& start, const Vector& amplitude, const Windows& windows,
                Index iterations, const Execution& execution);

}  // namespace tokid::design
