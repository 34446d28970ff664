// The states that explain the samples of a window best.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid::observer {

// Samples of successive steps, as departures from the nominal trajectory. Rows are experiments with the same missing
// outputs, which are NaN. No input is missing.
struct Window {
  Index k = 0;               // first step
  std::vector<Matrix> u, y;  // (window) of N × r and N × m
};

// The states (N × n_k) at the first step of the window, by least squares as for estimate_state(). A row depends on no
// other row, to the last bit. All rows are NaN if the samples do not determine all of the state, unless the
// rest of the state has no effect after the window. The estimate of this rest is zero.
Matrix estimate(const Model& model, const Window& window);

}  // namespace tokid::observer
