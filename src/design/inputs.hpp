// Makes inputs without a model, within ±1, column by column across the experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/random.hpp"
#include "tokid/design.hpp"

namespace tokid::design {

// Sizes of the inputs: N × T·r samples, columns k·r … k·r+r-1 for step k, in windows of p + 1 steps.
struct InputSizes {
  Index experiments, steps, states, inputs, outputs, lags;
};

Matrix gaussian_inputs(const InputSizes& sizes, RandomNumbers& random);
Matrix binary_inputs(const InputSizes& sizes, RandomNumbers& random);
Matrix multisine_inputs(const InputSizes& sizes, RandomNumbers& random);
// With `zero_mean`, every column sums to zero over the experiments. With hold = 0, a rule chooses `hold`.
Matrix orthogonal_inputs(const InputSizes& sizes, bool zero_mean, Index hold, RandomNumbers& random);

}  // namespace tokid::design
