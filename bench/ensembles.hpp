// The ensembles that the time of the stages is measured on.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "testing.hpp"
#include "tokid/example.hpp"

namespace tokid::bench {

// The paper's example, without noise.
inline Ensemble example(Index experiments_count, Index steps) {
  return experiments(oscillator(steps), {.experiments = experiments_count});
}

// A random system with a little noise on its outputs, so that windows have full rank at any lag order.
inline Ensemble noisy(const testing::SystemSize& size, Index experiments_count, Index steps) {
  return experiments(testing::random_system(size, steps, 0.95, 1),
                     {.experiments = experiments_count, .measurement_noise = 0.1});
}

}  // namespace tokid::bench
