// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/markov.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/observer.hpp"

namespace tokid::testing {
namespace {

// The GTV-ARX model that a known system with deadbeat gains obeys, written down from (13), (15).
GtvArx arx_of(const Model& model, Index lags) {
  GtvArx arx;
  arx.resize(model.steps(), model.inputs, model.outputs, lags, true);
  for (Index k = 0; k < model.steps(); ++k) {
    const Index own = arx.step[size_t(k)].lags = std::min(lags, k);
    Eigen::Map<Matrix> coefficients = arx.coefficients(k);
    coefficients.rightCols(model.inputs) = model.step[size_t(k)].D();
    Matrix row = model.step[size_t(k)].C();  // C_k Ā_{k-1} … Ā_{k-j+1}
    for (Index j = 1; j <= own; ++j) {
      const size_t i = size_t(k - j);
      const Index at = (own - j) * (model.inputs + model.outputs);
      coefficients.middleCols(at, model.inputs) = row * (model.step[i].B() + model.step[i].G() * model.step[i].D());
      coefficients.middleCols(at + model.inputs, model.outputs) = -row * model.step[i].G();
      row = row * model.at(k - j).closed_loop();
    }
  }
  return arx;
}

TEST(Markov, RecursionsGiveThePulseResponsesOfSystemAndObserver) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {3, 1, 2}, {3, 2, 1}, {2, 3, 1}, {6, 2, 3}}) {
    Model model = random_system(size, 24, 1.0, 40);
    set_gains(model, deadbeat_gain(model).G);
    const Index band = 9;
    const Markov parameters = markov(arx_of(model, smallest_lag_order(size)), band);
    ASSERT_EQ(parameters.band, band);
    double worst = 0.0, worst_gain = 0.0;
    for (Index k = 1; k < 24; ++k)
      for (Index i = std::max<Index>(0, k - band); i < k; ++i) {
        ASSERT_TRUE(parameters.has(k, i));
        const Matrix h = pulse_response(model, k, i), g = gain_pulse_response(model, k, i);
        worst = std::max(worst, (parameters.h(k, i) - h).norm() / (1 + h.norm()));
        worst_gain = std::max(worst_gain, (parameters.h_gain(k, i) - g).norm() / (1 + g.norm()));
      }
    // The recursion multiplies rounding errors by the deadbeat gains of nearly unobservable steps.
    EXPECT_LE(worst, 1e-10) << name(size);
    EXPECT_LE(worst_gain, 1e-10) << name(size);
  }
}

TEST(Markov, KeepsTheBandAndNothingElse) {
  Model model = random_system({2, 1, 3}, 50, 1.0, 41);
  set_gains(model, deadbeat_gain(model).G);
  const Markov parameters = markov(arx_of(model, 2), 4);
  EXPECT_FALSE(parameters.has(10, 5));
  EXPECT_FALSE(parameters.has(10, 10));
  for (Index k = 0; k < 50; ++k) {
    EXPECT_EQ(parameters.system(k).cols(), 4 * 3);
    EXPECT_EQ(parameters.gain(k).cols(), 4);
  }
  EXPECT_EQ(markov(arx_of(model, 2), 1000).band, 49);  // no more than the steps can tell
  EXPECT_THROW(markov(arx_of(model, 2), 0), std::invalid_argument);
  GtvArx lean;
  lean.resize(3, 1, 1, 1, false);
  EXPECT_THROW(markov(lean, 2), std::invalid_argument);  // no noise shapes
}

// With a single lag h_{k,k-1} is linear in the coefficients of two steps, and its first-order variance is exact: over
// 300 runs the mean of the scaled squares is 1 within 5 standard errors of sqrt(2/300).
TEST(Markov, VarianceIsThatOfRepeatedNoise) {
  Model model = random_system({1, 1, 1}, 8, 0.9, 42);
  const Ensemble clean = random_experiments(model, 40, 43);
  const Index k = 6, runs = 300;
  const Matrix truth = markov(gtv_arx(clean), 3).h(k, k - 1);
  Random random(44);
  double sum = 0.0;
  for (Index run = 0; run < runs; ++run) {
    Ensemble e = clean;
    const double sigma = 0.01;
    e.output(k) += sigma * random.matrix(40, 1);
    const GtvArx arx = gtv_arx(e);
    const Markov parameters = markov(arx, 3);
    const double variance = parameters.h_noise(k, k - 1)(0, 0) * sigma * sigma / arx.residual_cov(k)(0, 0);
    sum += std::pow(parameters.h(k, k - 1)(0, 0) - truth(0, 0), 2) / variance;
  }
  EXPECT_NEAR(sum / double(runs), 1.0, 5 * std::sqrt(2.0 / double(runs)));
}

TEST(Markov, SameBitsForAnyNumberOfThreads) {
  const Ensemble e = random_experiments(random_system({3, 2, 2}, 60, 1.0, 45), 30, 46);
  GtvArxOptions options;
  options.lags = {3};
  const GtvArx arx = gtv_arx(e, options);
  const Markov one = markov(arx, 6, {1, {}}), three = markov(arx, 6, {3, {}});
  for (Index k = 0; k < 60; ++k) {
    EXPECT_EQ(one.system(k), three.system(k));
    EXPECT_EQ(one.gain(k), three.gain(k));
  }
}

}  // namespace
}  // namespace tokid::testing
