// Systems whose outputs are known not to answer to the inputs of the same step (D = 0), by every route.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "oracle.hpp"
#include "testing.hpp"
#include "tokid/em.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/markov.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/subspace.hpp"

namespace tokid::testing {
namespace {

Model without_feedthrough(Model system) {
  for (Step& step : system.step) step.D().setZero();
  return system;
}

// The window of step k without u_k.
Matrix past(const Ensemble& e, Index k, Index lags) { return e.window(k, lags).leftCols(lags * e.channels()); }

TEST(Feedthrough, RegressionsWithoutItAreLeastSquaresOnThePastAlone) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {3, 1, 2}, {3, 2, 1}}) {
    const Index p = smallest_lag_order(size), n = minimum_experiments(size.r, size.m, p) + 20;
    const Ensemble e = with_noise(random_experiments(random_system(size, 30, 1.0, 7), n, 8), 0.1, 9);
    for (const Index block : {0, 1, 3}) {  // steps in lanes, alone, and with shared factorisations
      GtvArxOptions options;
      options.lags = {p};
      options.feedthrough = false;
      options.block = block;
      const GtvArx arx = gtv_arx(e, options);
      for (Index k = 0; k < e.steps(); ++k) {
        const Index lags = std::min(p, k);
        ASSERT_EQ(arx.regressors(k), lags * e.channels());
        EXPECT_TRUE(arx.D(k).isZero(0.0));
        EXPECT_EQ(arx.noise_shape(k).rows(), arx.regressors(k));
        EXPECT_EQ(arx.step[size_t(k)].freedom, n - arx.step[size_t(k)].rank);
        const Matrix w = past(e, k, lags), y = e.output(k);
        const Matrix expected = w.cols() > 0 ? Matrix(linalg::pseudo_inverse(w) * y) : Matrix(0, size.m);
        const double condition = std::max(1.0, arx.step[size_t(k)].condition), unit = double(n) * epsilon * condition;
        EXPECT_LE((arx.coefficients(k) - expected.transpose()).norm(), 10 * unit * std::max(1.0, expected.norm()))
            << name(size) << " block " << block << " k " << k;
        const Matrix residual = y - w * expected;
        const Matrix covariance = residual.transpose() * residual / double(arx.step[size_t(k)].freedom);
        EXPECT_LE((arx.residual_cov(k) - covariance).norm(), 10 * unit * y.squaredNorm() / double(n)) << k;
      }
    }
  }
}

TEST(Feedthrough, LeaveOneOutErrorsWithoutItAreThoseOfTheRegressionsWithoutIt) {
  const SystemSize size{2, 1, 2};
  const Ensemble e = with_noise(random_experiments(random_system(size, 8, 1.0, 11), 40, 12), 0.2, 13);
  LagOrderOptions options;
  options.p_max = 2;
  options.feedthrough = false;
  const LagOrderErrors found = lag_order_errors(e, options);
  for (size_t i = 0; i < found.steps.size(); ++i)
    for (Index p = 1; p <= options.p_max; ++p) {
      const Matrix w = past(e, found.steps[i], p), hat = w * linalg::pseudo_inverse(w), y = e.output(found.steps[i]);
      const Vector left_out = (y - hat * y).array() / (1 - hat.diagonal().array());
      const double expected = std::log(left_out.squaredNorm() / y.squaredNorm());
      EXPECT_NEAR(found.error(Index(i), p - 1), expected, 1e-10) << found.steps[i] << ' ' << p;
    }
}

TEST(Feedthrough, PulseResponsesWithoutItAreExact) {
  for (const SystemSize size : {SystemSize{4, 2, 2}, {3, 2, 1}}) {
    const Model system = without_feedthrough(random_system(size, 20, 1.0, 21));
    const Index p = smallest_lag_order(size);
    // One experiment fewer than a regression with feedthrough needs.
    const Index n = minimum_experiments(size.r, size.m, p, false) + size.r - 1;
    GtvArxOptions options;
    options.lags = {p};
    options.feedthrough = false;
    const Markov found = markov(gtv_arx(random_experiments(system, n, 22), options), 2 * p);
    for (Index k = 0; k < 20; ++k) {
      EXPECT_TRUE(found.D(k).isZero(0.0));
      for (Index i = std::max<Index>(0, k - 2 * p); i < k; ++i) {
        const Matrix expected = pulse_response(system, k, i);
        EXPECT_LE((found.h(k, i) - expected).norm(), 1e-9 * std::max(1.0, expected.norm())) << k << ' ' << i;
      }
    }
  }
}

// The error of the outputs that a subspace model of noise-free data simulates.
double subspace_error(const Ensemble& e, Weighting weighting, TimeVariation variation, Index p) {
  SmoothArxOptions options{.lags = p, .feedthrough = false, .variation = variation};
  const GtvArx arx = smooth_arx(e, options);
  SubspaceOptions o;
  o.variation = variation;
  o.weighting = weighting;
  o.noisy = false;
  const Model model = subspace(e, arx, o);
  for (const Step& step : model.step) EXPECT_TRUE(step.D().isZero(0.0));
  return output_error(e, simulate_data(model, e, InitialState::zero), p);
}

TEST(Feedthrough, SubspaceModelsWithoutItAreExact) {
  const SystemSize size{3, 2, 1};
  const Index p = smallest_lag_order(size) + 1;
  const Ensemble varying = random_experiments(without_feedthrough(random_system(size, 20, 1.0, 31)), 30, 32);
  EXPECT_LE(subspace_error(varying, Weighting::one_step, {0.0, 0}, p), 1e-8);
  const Ensemble constant = random_experiments(without_feedthrough(constant_system(size, 60, 0.9, 33)), 5, 34);
  for (const Weighting weighting : {Weighting::one_step, Weighting::many_steps, Weighting::projection})
    EXPECT_LE(subspace_error(constant, weighting, {0.0, 1}, p), 1e-8) << int(weighting);
}

TEST(Feedthrough, EmKeepsItAtZeroAndRaisesTheLikelihood) {
  const Model truth = without_feedthrough(random_system({2, 2, 1}, 25, 0.9, 41));
  const Ensemble e = with_noise(random_experiments(truth, 60, 42), 0.1, 43);
  const GtvArx arx = smooth_arx(e, {.lags = 3, .variation = {1.0, 0}});
  SubspaceOptions o;
  o.states = 2;
  o.variation = {1.0, 0};
  const Model start = subspace(e, arx, o);  // with the feedthrough that noise suggests
  for (const double smoothing : {0.0, 1.0, std::numeric_limits<double>::infinity()}) {
    RefineOptions options;
    options.smoothing = smoothing;
    options.iterations = 20;
    options.feedthrough = false;
    const Refinement found = refine(start, e, options);
    for (const Step& step : found.model.step) EXPECT_TRUE(step.D().isZero(0.0)) << smoothing;
    for (size_t i = 1; i < found.penalised.size(); ++i)
      EXPECT_GE(found.penalised[i], found.penalised[i - 1]) << smoothing << ' ' << i;
    EXPECT_GT(found.penalised.back(), found.penalised.front()) << smoothing;
  }
}

}  // namespace
}  // namespace tokid::testing
