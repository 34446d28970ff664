// SPDX-License-Identifier: BSD-3-Clause
// The constant of a time-invariant system, and the outputs at rest.
#include "choose/constant.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing::constants {
namespace {

// Two outputs with time constants of ten and five steps around `rest`, which begin at zero; held inputs. With `pole` 1
// the first output integrates.
Ensemble heated(Index experiments, Index steps, const Vector& rest, double noise, std::uint64_t seed,
                double pole = 0.9) {
  RandomNumbers random(seed);
  Ensemble e(experiments, steps, 2, 2);
  for (Index n = 0; n < experiments; ++n) {
    Vector x = -rest, u = Vector::Zero(2);
    for (Index k = 0; k < steps; ++k) {
      if (k % 10 == 0) u = 2 * random.normals(2);
      for (Index i = 0; i < 2; ++i) e.u(n, k, i) = u(i);
      for (Index j = 0; j < 2; ++j) e.y(n, k, j) = rest(j) + x(j) + noise * random.normal();
      x = Vector{{pole * x(0) + 0.3 * u(0), 0.8 * x(1) + 0.1 * x(0) + 0.5 * u(1)}};
    }
  }
  return e;
}

TEST(ConstantTest, FindsTheOutputsAtRest) {
  const Vector rest{{22.0, -7.0}};
  for (const double noise : {1e-3, 0.1}) {
    const Constant found = test_constant(heated(1, 400, rest, noise, 1));
    ASSERT_TRUE(found.significant());
    // Lags of noisy outputs bias the regression by the square of the noise.
    EXPECT_LT((found.at_rest - rest).norm(), 2 * noise * rest.norm()) << noise;
  }
}

TEST(ConstantTest, FindsNoneWhereThereIsNone) {
  Index found = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed)
    if (test_constant(heated(2, 150, Vector::Zero(2), 0.1, seed)).significant()) ++found;
  EXPECT_LE(found, 3);  // 0.3 expected: more than three have a probability of 3e-4
  EXPECT_FALSE(test_constant(heated(1, 400, Vector::Zero(2), 0.0, 1)).significant());
}

// A shift of the outputs is found whatever the noise and the inputs are, because the innovations are linear in them.
TEST(ConstantTest, OfAModelIsThatOfTheData) {
  const Vector shift{{3.0, -0.5}};
  for (const Index period : {1, 0}) {
    const Ensemble e = heated(6, 60, Vector::Zero(2), 0.3, 4);
    IdentifyOptions options{.period = period, .initial_state = InitialState::unknown};
    options.nominal = NominalChoice::none;
    const Model model = identify(e, options).model;
    Ensemble shifted = e;
    for (Index k = 0; k < e.steps(); ++k) shifted.output(k).rowwise() += shift.transpose();
    shifted.y(0, 30, 1) = nan;
    Ensemble gap = e;
    gap.y(0, 30, 1) = nan;
    const auto before = remaining_constant(model, gap, InitialState::unknown),
               after = remaining_constant(model, shifted, InitialState::unknown);
    ASSERT_TRUE(before && after) << period;
    EXPECT_LT((*after - *before - shift).norm(), 1e-9) << period;
  }
}

// The regression of a slow plant with much noise misses the point of rest by more than the noise.
TEST(ConstantTest, OfIdentifiedModelsIsAccurate) {
  const Vector rest{{22.0, -7.0}};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Model model = identify(heated(1, 400, rest, 0.5, seed), {.period = 1}).model;
    const Ensemble fresh = heated(1, 400, rest, 0.0, seed + 50), computed = simulate_data(model, fresh, InitialState::unknown);
    Matrix error = Matrix::Zero(300, 2);
    for (Index k = 0; k < 300; ++k) error.row(k) = computed.output(k + 100) - fresh.output(k + 100);
    EXPECT_LT(error.colwise().mean().cwiseAbs().maxCoeff(), 0.3) << seed;
  }
}

TEST(ConstantTest, NeedsSamplesAndAPointOfRest) {
  const Vector rest{{22.0, -7.0}};
  EXPECT_EQ(test_constant(heated(1, 20, rest, 0.1, 1)).threshold, 0.0);
  EXPECT_FALSE(test_constant(heated(4, 200, Vector::Zero(2), 0.01, 1, 1.0)).significant());
  Ensemble gaps = heated(1, 900, rest, 1e-3, 1);
  for (Index k = 5; k < 900; k += 37) gaps.y(0, k, 1) = nan;
  const Constant found = test_constant(gaps);
  ASSERT_TRUE(found.significant());
  EXPECT_LT((found.at_rest - rest).norm(), 2e-3 * rest.norm());
}

// Powers of two as units change no bit of the nominal trajectory.
TEST(ConstantTest, IsTheSameInAllUnits) {
  const Vector rest{{22.0, -7.0}};
  const Ensemble data = heated(1, 300, rest, 0.05, 3);
  Ensemble scaled = data;
  for (Index k = 0; k < data.steps(); ++k) {
    scaled.input(k).col(0) *= 0x1p30;
    scaled.output(k).col(1) *= 0x1p-30;
  }
  const IdentifyOptions options{.states = 2, .lags = 3, .period = 1, .refine = false};
  const Matrix y = identify(data, options).model.y_nominal, other = identify(scaled, options).model.y_nominal;
  EXPECT_EQ(y.col(0), other.col(0));
  EXPECT_EQ(y.col(1), other.col(1) * 0x1p30);
}

TEST(ConstantTest, MakesRestTheNominalTrajectory) {
  const Vector rest{{22.0, -7.0}};
  const Ensemble data = heated(1, 300, rest, 0.05, 3), fresh = heated(3, 300, rest, 0.0, 4);
  const Identification found = identify(data, {.period = 1});
  EXPECT_TRUE(found.nominal_test.significant);
  EXPECT_GT(found.nominal_test.constant_statistic, found.nominal_test.constant_threshold);
  const Ensemble simulated = simulate_data(found.model, fresh, InitialState::unknown);
  double error = 0.0;
  for (Index k = 50; k < 300; ++k) error += (simulated.output(k) - fresh.output(k)).squaredNorm();
  EXPECT_LT(std::sqrt(error / (250 * 3 * 2)), 0.05);
  // As the user states
  EXPECT_EQ(identify(data, {.period = 1, .nominal = NominalChoice::none}).model.y_nominal.size(), 0);
}

}  // namespace
}  // namespace tokid::testing::constants
