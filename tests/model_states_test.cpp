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
  const double exact = model.at(0).C().norm() > 0 ? 1e4 / model.at(0).C().norm() : 1e4;
  for (Index k = 40; k < 44; ++k) model.step[size_t(k)].set_K(Matrix::Constant(3, 2, exact + double(k)));
  const Findings found = findings_of_gains(model);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.front().kind, Finding::Kind::gains_grow);
  EXPECT_EQ(found.front().steps, (std::vector<Index>{40, 41, 42, 43}));
  EXPECT_GT(found.front().numbers.at("ratio"), 100);
}

// Without process noise, gains decay from those of an unknown initial state to nearly zero.
TEST(ModelStates, GainsThatDecayAreUsual) {
  Model model = constant_system({3, 2, 1}, 200, 0.9, 1);
  for (Index k = 0; k < 200; ++k) model.step[size_t(k)].set_K(Matrix::Constant(3, 2, std::pow(0.9, double(k))));
  EXPECT_TRUE(findings_of_gains(model).empty());
}

TEST(ModelStates, ModelsWithoutKalmanGainsHaveNoneToReport) {
  EXPECT_TRUE(findings_of_gains(constant_system({3, 2, 1}, 60, 0.9, 1)).empty());
}

}  // namespace
}  // namespace tokid::testing
