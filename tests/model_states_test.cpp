// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/model_states.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"

namespace tokid::testing {
namespace {

TEST(ModelStates, GainsFarAboveTheirMedianAreReported) {
  Model model = constant_system({3, 2, 1}, 60, 0.9, 1);
  // Gains of the first steps may be large, because the initial state is not known yet.
  for (Index k = 0; k < 60; ++k)
    model.step[size_t(k)].set_K(Matrix::Constant(3, 2, k < 2 ? 1e4 : 1 + 0.5 * std::sin(double(k))));
  EXPECT_TRUE(findings_of_gains(model).empty());
  for (Index k = 40; k < 44; ++k) model.step[size_t(k)].set_K(Matrix::Constant(3, 2, 1e3 + double(k)));
  const Findings found = findings_of_gains(model);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.front().kind, Finding::Kind::gains_grow);
  EXPECT_EQ(found.front().steps, (std::vector<Index>{40, 41, 42, 43}));
  EXPECT_NEAR(found.front().numbers.at("ratio"), 1043, 150);
}

TEST(ModelStates, ModelsWithoutKalmanGainsHaveNoneToReport) {
  EXPECT_TRUE(findings_of_gains(constant_system({3, 2, 1}, 60, 0.9, 1)).empty());
}

}  // namespace
}  // namespace tokid::testing
