// Quick check of the noise study: how close models come to the Kalman filter of the true system.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "noisy.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

// One-step errors over those of the exact Kalman filter, from many experiments to fewer than there are unknowns.
struct Size {
  Index experiments;
  double limit;     // what is promised
  double expected;  // the median of five seeds that was measured
};

class OscillatorWithNoise : public ::testing::TestWithParam<Size> {};

TEST_P(OscillatorWithNoise, IsPredictedNearlyAsWellAsByTheKalmanFilter) {
  const Model system = oscillator(60);
  const Identification result = identify(noisy_experiments(system, GetParam().experiments, 1));
  const double ratio = ratio_to_kalman(result.model, system, 1001);
  EXPECT_LE(ratio, GetParam().limit);
  // Seeds differ by less than a third of the excess.
  EXPECT_LE(ratio - 1, 1.35 * (GetParam().expected - 1));
  EXPECT_EQ(result.model.method, "em");
  EXPECT_TRUE(result.plan.noisy);
  EXPECT_EQ(result.model.k_begin, 0);
  EXPECT_EQ(result.model.k_end(), 60);
  EXPECT_GT(result.plan.choices.variation.smoothing, 0.0);
  EXPECT_GT(result.refinement.iterations, 0);
}

INSTANTIATE_TEST_SUITE_P(Experiments, OscillatorWithNoise,
                         ::testing::Values(Size{15, 1.15, 1.115}, Size{50, 1.06, 1.04}, Size{100, 1.03, 1.023}),
                         [](const auto& test) { return "N" + std::to_string(test.param.experiments); });

}  // namespace
}  // namespace tokid::testing
