// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"

namespace tokid::testing {
namespace {

TEST(Fit, IsOneHundredPercentLessTheRelativeError) {
  Ensemble y(1, 4, 1, 1), computed = y;
  const double values[] = {1, 2, 3, 6};
  for (Index k = 0; k < 4; ++k) y.y(0, k, 0) = computed.y(0, k, 0) = values[k];
  EXPECT_EQ(fit(y, computed).fit(0), 100.0);
  computed.y(0, 3, 0) = 5;  // error 1; spread about the mean 3: 4 + 1 + 0 + 9
  EXPECT_DOUBLE_EQ(fit(y, computed).fit(0), 100 * (1 - std::sqrt(1.0 / 14)));
  EXPECT_DOUBLE_EQ(fit(y, computed).rmse(0), 0.5);
  computed.y(0, 0, 0) = nan;  // only what is known on both sides counts: spread about 11/3
  EXPECT_EQ(fit(y, computed).samples, 3);
  const Matrix nominal = Matrix::Constant(4, 1, 2.0);  // spread of 2, 3, 6 about it: 0 + 1 + 16
  EXPECT_DOUBLE_EQ(fit(y, computed, nominal).fit(0), 100 * (1 - std::sqrt(1.0 / 17)));
  for (Index k = 0; k < 4; ++k) computed.y(0, k, 0) = nan;
  EXPECT_TRUE(std::isnan(fit(y, computed).fit(0)));
  EXPECT_THROW(fit(y, Ensemble(2, 4, 1, 1)), std::invalid_argument);
}

TEST(Validate, TrueModelsFitNoiseFreeDataCompletely) {
  const Model system = oscillator(40);
  for (const InitialState state : {InitialState::zero, InitialState::unknown}) {
    ExperimentOptions options;
    options.experiments = 8;
    options.initial_state = state;
    const Validation v = validate(system, experiments(system, options), {.horizon = 4});
    for (const Fit* fit : {&v.simulation, &v.one_step, &v.horizon})
      for (const double f : fit->fit) EXPECT_GT(f, 100 - 1e-9);
    EXPECT_TRUE(std::isnan(v.whiteness_p));  // rounding errors are no innovations
    EXPECT_EQ(v.first_predicted, state == InitialState::zero ? 0 : 2);
    EXPECT_TRUE(v.warnings.empty());
  }
}

TEST(Validate, SaysWhenNothingCanBePredicted) {
  const Model system = oscillator(40);
  ExperimentOptions options;
  options.initial_state = InitialState::unknown;
  Ensemble e = experiments(oscillator(2), options);  // two steps: as many as the state needs
  const Validation v = validate(system, e);
  EXPECT_TRUE(std::isnan(v.one_step.fit(0)));
  ASSERT_FALSE(v.warnings.empty());
  EXPECT_NE(v.warnings[0].find("no step could be predicted"), std::string::npos);
  EXPECT_THROW(validate(from_step(system, 10), e), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
