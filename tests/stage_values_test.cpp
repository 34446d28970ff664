// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/stage_values.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "testing.hpp"

namespace tokid::testing {
namespace {

const std::string sound = "no exception";

GtvArx regressions() { return gtv_arx(random_experiments(random_system({2, 2, 2}, 12, 1.0, 3), 30, 4), {.lags = {2}}); }

// The message of the std::invalid_argument that check() throws after `spoil` has changed the value.
template <class Value>
std::string refusal(Value value, const std::function<void(Value&)>& spoil) {
  spoil(value);
  return message([&] { check(value); });
}

TEST(StageValues, ChecksNameTheMatrixAndTheStepOfARegression) {
  const GtvArx arx = regressions();
  EXPECT_EQ(refusal<GtvArx>(arx, [](GtvArx&) {}), sound);
  constexpr double inf = std::numeric_limits<double>::infinity();
  for (const Index k : {0, 5, 11}) {
    const auto starts = [&](const char* name, const std::function<void(GtvArx&)>& spoil) {
      const std::string found = refusal<GtvArx>(arx, spoil);
      EXPECT_EQ(found.find(name), 0U) << found;
      EXPECT_NE(found.find(" at step " + std::to_string(k) + ","), std::string::npos) << found;
    };
    starts("coefficients: ", [&](GtvArx& a) { a.coefficients(k)(1, 0) = nan; });
    starts("residual_cov: ", [&](GtvArx& a) { a.residual_cov(k)(0, 1) = inf; });
    starts("residual_cov: ", [&](GtvArx& a) { a.residual_cov(k)(0, 0) = -1.0; });
    starts("residual_cov: ", [&](GtvArx& a) { a.residual_cov(k) = Matrix{{1.0, 2.0}, {2.0, 1.0}}; });
    starts("output_rms: ", [&](GtvArx& a) { a.output_rms(k)(1) = -1.0; });
    starts("output_rms: ", [&](GtvArx& a) { a.output_rms(k)(0) = inf; });
    starts("noise_shape: ", [&](GtvArx& a) { a.noise_shape(k)(0, 0) = nan; });
  }
  // A step without a regression has nothing to check.
  EXPECT_EQ(refusal<GtvArx>(arx,
                            [&](GtvArx& a) {
                              a.begin_at(6);
                              a.residual_cov(5)(0, 0) = -1.0;
                            }),
            sound);
}

TEST(StageValues, ChecksNameTheMatrixAndTheStepOfMarkovParameters) {
  const Markov h = markov(regressions(), 4);
  EXPECT_EQ(refusal<Markov>(h, [](Markov&) {}), sound);
  constexpr double inf = std::numeric_limits<double>::infinity();
  const auto starts = [&](const char* name, const std::function<void(Markov&)>& spoil) {
    const std::string found = refusal<Markov>(h, spoil);
    EXPECT_EQ(found.find(name), 0U) << found;
    EXPECT_NE(found.find(" at step 7,"), std::string::npos) << found;
  };
  starts("system: ", [&](Markov& a) { a.h(7, 5)(0, 1) = nan; });
  starts("gain: ", [&](Markov& a) { a.h_gain(7, 3)(1, 1) = inf; });
  starts("D: ", [&](Markov& a) { a.D(7)(0, 0) = nan; });
  starts("system_noise: ", [&](Markov& a) { a.h_noise(7, 6)(0, 0) = -1e-300; });
  starts("system_noise: ", [&](Markov& a) { a.h_noise(7, 6)(0, 0) = inf; });
}

TEST(StageValues, NoiseShapesOfAnyWidthKeepTheirCovariance) {
  for (const Index k : {0, 1, 6})
    for (const Index width : {0, 1, 3, 10, 40}) {
      GtvArx arx = regressions();
      const Index regressors = arx.regressors(k);
      const Matrix x = Random(17).matrix(regressors, width);
      set_noise_shape(arx, k, x);
      EXPECT_EQ(arx.step[size_t(k)].rank, std::min(regressors, width));
      // Householder's QR is backward stable: its factor is that of a matrix which differs by about width·eps·|X|.
      const double tolerance = 4 * double(width) * epsilon * x.squaredNorm();
      EXPECT_LE((arx.noise_shape(k) * arx.noise_shape(k).transpose() - x * x.transpose()).norm(), tolerance)
          << "k " << k << " width " << width;
    }
  GtvArx arx = regressions();
  EXPECT_THROW(set_noise_shape(arx, 4, Matrix::Ones(3, 2)), std::invalid_argument);
  EXPECT_THROW(set_noise_shape(arx, 4, Matrix::Constant(arx.regressors(4), 90, nan)), std::invalid_argument);
  arx.forget_noise_shapes();
  EXPECT_THROW(set_noise_shape(arx, 4, Matrix::Ones(arx.regressors(4), 1)), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
