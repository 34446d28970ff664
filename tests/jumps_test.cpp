// SPDX-License-Identifier: BSD-3-Clause
// Steps at which the matrices jump: found by regressions, and only there.
#include "choose/jumps.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"
#include "testing.hpp"

namespace tokid::testing::jumps {
namespace {

// A second-order system whose stiffness varies slowly, and falls to the share `rest` at step `at`. y = position.
Ensemble spring(Index experiments, Index steps, Index at, double rest, std::uint64_t seed) {
  RandomNumbers random(seed);
  Ensemble e(experiments, steps, 1, 1);
  for (Index n = 0; n < experiments; ++n) {
    double position = 0.0, speed = 0.0;
    for (Index k = 0; k < steps; ++k) {
      const double stiffness = (0.4 + 0.1 * std::sin(0.08 * double(k))) * (k < at ? 1.0 : rest);
      e.u(n, k, 0) = random.normal();
      e.y(n, k, 0) = position + 0.03 * random.normal();
      const double faster = 0.9 * speed - stiffness * position + e.u(n, k, 0);
      position += 0.3 * speed;
      speed = faster;
    }
  }
  return e;
}

SmoothingOptions options_of(std::optional<double> smoothing = {}) {
  SmoothingOptions o;
  o.lags = {1, 2, 3, 4, 6, 8};
  o.smoothing = smoothing;
  return o;
}

std::vector<Index> steps_found(const Ensemble& e) {
  const SmoothingOptions o = options_of();
  const SmoothingChoice choice = choose_smoothing(e, o);
  std::vector<Index> steps;
  for (const Jump& jump : find_jumps(e, o, choice.lags, choice.smoothing)) {
    EXPECT_GT(jump.loss.value_or(0), 2.5);
    steps.push_back(jump.step);
  }
  return steps;
}

// The stiffness of step k affects the speed at k+1 and the position at k+2.
TEST(FindJumps, FindsTheStepWhereTheStiffnessFalls) {
  for (const Index at : {20, 37})
    for (const std::uint64_t seed : {1, 2, 3}) {
      const std::vector<Index> found = steps_found(spring(30, 60, at, 0.3, seed));
      ASSERT_EQ(found.size(), 1u) << at << " " << seed;
      EXPECT_GE(found.front(), at) << seed;
      EXPECT_LE(found.front(), at + 2) << seed;
    }
}

TEST(FindJumps, FindsNoneWhereTheMatricesVarySlowly) {
  for (const std::uint64_t seed : {4, 5, 6, 7, 8, 9}) EXPECT_TRUE(steps_found(spring(30, 60, 30, 1.0, seed)).empty());
}

// With the loose penalties at the jump, a large λ hurts no step.
TEST(SmoothArx, FollowsAStatedJump) {
  const Ensemble e = spring(40, 60, 30, 0.3, 10), fresh = spring(40, 60, 30, 0.3, 11);
  const auto error = [&](const std::vector<Index>& jumps) {
    SmoothArxOptions o{3};
    o.variation = {10.0, 0, jumps};
    const GtvArx arx = smooth_arx(e, o);
    double sum = 0.0;
    for (Index k = 31; k < 37; ++k) {
      const Index from = (k - 3) * fresh.channels();
      sum += (fresh.output(k) - fresh.samples().middleCols(from, arx.regressors(k)) * arx.coefficients(k).transpose())
                 .squaredNorm();
    }
    return sum;
  };
  EXPECT_LT(error({30}), 0.7 * error({}));
}

}  // namespace
}  // namespace tokid::testing::jumps
