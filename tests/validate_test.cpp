// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"

namespace tokid::testing {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

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

std::vector<Matrix> innovations(Index experiments, Index steps, Index outputs, double correlation, std::uint64_t seed) {
  Random random(seed);
  const Matrix mix = random.matrix(outputs, outputs);  // outputs of one step may be correlated, that is no defect
  std::vector<Matrix> e;
  Matrix previous = random.matrix(experiments, outputs);
  for (Index k = 0; k < steps; ++k) {
    const Matrix fresh = random.matrix(experiments, outputs);
    e.push_back((correlation * previous + fresh) * mix);
    previous = fresh;
  }
  return e;
}

TEST(Whiteness, ProbabilitiesAreUniformForWhiteInnovations) {
  const int runs = 300;
  int below[3] = {0, 0, 0};
  const double level[3] = {0.05, 0.25, 0.5};
  for (int run = 0; run < runs; ++run) {
    const double p = whiteness_p(innovations(20, 30, 2, 0.0, std::uint64_t(run)), 5);
    for (int i = 0; i < 3; ++i) below[i] += p < level[i];
  }
  // Counts are binomial; four standard deviations.
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(below[i], runs * level[i], 4 * std::sqrt(runs * level[i] * (1 - level[i]))) << level[i];
}

TEST(Whiteness, SeesCorrelationInTime) { EXPECT_LT(whiteness_p(innovations(60, 30, 2, 0.4, 7), 5), 1e-6); }

TEST(Whiteness, CorrelationsAreThoseOfEachLag) {
  // e_k = c e_{k-1} + fresh: c / √(1 + c²) at lag 1 where the previous innovation is fresh alone, which it is here.
  Random random(5);
  const double c = 0.5;
  std::vector<Matrix> e;
  for (int pair = 0; pair < 40; ++pair) {
    const Matrix first = random.matrix(200, 1);
    e.push_back(first);
    e.push_back(c * first + random.matrix(200, 1));
  }
  const Whiteness w = whiteness(e, 3);
  // Every second pair of steps is correlated, 40 of 79. Bounds of 99 %: twice that leaves no doubt.
  EXPECT_NEAR(w.correlation(0, 0), 40.0 / 79 * c / std::sqrt(1 + c * c), 2 * w.bound(0));
  EXPECT_LT(std::abs(w.correlation(1, 0)), 2 * w.bound(1));
  EXPECT_NEAR(w.bound(0), 2.576 / std::sqrt(79.0 * 199), 1e-4);
  EXPECT_GT(w.z(0), 10);
  EXPECT_LT(std::abs(w.z(2)), 4);
  EXPECT_EQ(w.p, whiteness_p(e, 3));
}

TEST(Whiteness, LeavesOutWhatIsMissingAndNeedsEnoughExperiments) {
  std::vector<Matrix> e = innovations(20, 30, 2, 0.0, 8);
  e[4](3, 0) = nan;
  e[5].setConstant(nan);
  const double p = whiteness_p(e, 5);
  EXPECT_GT(p, 0.0);
  EXPECT_LE(p, 1.0);
  EXPECT_TRUE(std::isnan(whiteness_p(innovations(4, 30, 2, 0.0, 9), 5)));
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
