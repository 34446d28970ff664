// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/observer.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"

namespace tokid::testing {
namespace {

TEST(Deadbeat, TimeInvariantExampleOfThePaper) {
  Model model = constant_system({2, 1, 1}, 10, 1.0, 1);
  for (Matrix& a : model.A) a = Matrix{{1, 0}, {1, 2}};  // (73)
  for (Matrix& c : model.C) c = Matrix{{0, 1}};
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 2);
  // The first step has no past to be deadbeat over; from the second on the gain is unique.
  for (size_t k = 1; k + 1 < 10; ++k) EXPECT_LE((gain.G[k] - Matrix{{-1.0}, {-3.0}}).norm(), 1e-12) << k;
  model.G = gain.G;
  EXPECT_LE((model.closed_loop(5) - Matrix{{1, -1}, {1, -1}}).norm(), 1e-12);  // (75)
}

TEST(Deadbeat, ProductsVanishForEveryStepAndSize) {
  for (const SystemSize size :
       {SystemSize{1, 1, 1}, {4, 2, 1}, {3, 2, 1}, {2, 3, 1}, {5, 2, 1}, {7, 3, 1}, {12, 4, 1}, {6, 1, 1}})
    for (const double growth : {0.9, 1.3}) {
      Model model = random_system(size, 30, growth, 90);
      const DeadbeatGain gain = deadbeat_gain(model);
      const Index p = smallest_lag_order(size);
      EXPECT_EQ(gain.steps, p) << name(size);
      model.G = gain.G;
      double largest = 0.0;
      for (const Matrix& g : gain.G) largest = std::max(largest, g.norm());
      for (const double norm : deadbeat_products(model, p))
        EXPECT_LE(norm, 1e4 * epsilon * std::pow(1 + largest, double(p))) << name(size);
      // One step fewer does not do for p·m ≥ n > (p-1)·m.
      if (p > 1) {
        EXPECT_GT(deadbeat_products(model, p - 1)[10], 1e-3) << name(size);
      }
    }
}

TEST(Deadbeat, ErrorsOfAnyStepDieEvenWhereOutputsFailForAWhile) {
  Model model = random_system({3, 1, 1}, 30, 1.0, 91);
  for (size_t k = 10; k < 14; ++k) model.C[k].setZero();  // nothing is seen for four steps
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 7);
  model.G = gain.G;
  for (const double norm : deadbeat_products(model, 7)) EXPECT_LE(norm, 1e-8);
}

TEST(Deadbeat, StatesThatAreNeverSeenAreReported) {
  Model model = random_system({3, 1, 1}, 20, 1.0, 92);
  for (size_t k = 0; k < 20; ++k) {
    model.A[k].row(2) << 0, 0, 0.9;  // the third state lives by itself …
    model.A[k].col(2) << 0, 0, 0.9;
    model.C[k](0, 2) = 0;  // … and out of sight
  }
  EXPECT_GT(deadbeat_gain(model).steps, 20);
}

TEST(Deadbeat, VaryingStateDimensions) {
  Model model = random_system({3, 1, 2}, 12, 1.0, 93);
  model.state_dim.front() = 0;  // rest: no state at all to begin with
  model.A[0].resize(3, 0);
  model.C[0].resize(1, 0);
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 3);
  model.G = gain.G;
  model.check();
  for (const double norm : deadbeat_products(model, 3)) EXPECT_LE(norm, 1e-8);
}

TEST(Deadbeat, ProductsOfNoStepsAreRefused) {
  EXPECT_THROW(deadbeat_products(random_system({2, 1, 1}, 5, 1.0, 94), 0), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
