// The state-space model in observer form makes the predictions of the regressions.
// SPDX-License-Identifier: BSD-3-Clause
#include "noise/observer_form.hpp"

#include <gtest/gtest.h>

#include "noisy.hpp"
#include "tokid/identify.hpp"
#include "tokid/plan.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/validate.hpp"

namespace tokid::testing {
namespace {

struct Kind {
  InitialState initial;
  TimeVariation variation;
};

const std::vector<Kind> kinds{{InitialState::zero, {0.0, 0}},    {InitialState::zero, {10.0, 0}},
                              {InitialState::zero, {0.0, 1}},    {InitialState::zero, {1.0, 3}},
                              {InitialState::unknown, {0.0, 0}}, {InitialState::unknown, {10.0, 0}},
                              {InitialState::unknown, {0.0, 1}}, {InitialState::unknown, {1.0, 3}}};

Plan plan_of(const Kind& kind, Index lags, bool feedthrough = true) {
  Plan plan;
  plan.method = Method::regression;
  plan.lags = lags;
  plan.initial_state = kind.initial;
  plan.feedthrough.present = feedthrough;
  plan.coupled = plan.noisy = true;
  plan.choices.variation = kind.variation;
  return plan;
}

// ŷ_k by the regressions, from measured samples before step k - h + 1 and their own predictions from there on.
Matrix predicted(const GtvArx& arx, Ensemble e, Index k, Index horizon) {
  for (Index s = k - horizon + 1; s <= k; ++s) {
    const Index lags = arx.step[size_t(s)].lags;
    e.output(s) =
        e.samples().middleCols((s - lags) * e.channels(), arx.regressors(s)) * arx.coefficients(s).transpose();
  }
  return e.output(k);
}

TEST(ObserverForm, PredictsAsTheRegressions) {
  for (const SystemSize& size : {SystemSize{3, 2, 1}, SystemSize{4, 1, 3}})
    for (const Kind& kind : kinds)
      for (const Index p : {1, 4})
        for (const bool feedthrough : {true, false}) {
          SCOPED_TRACE(name(size) + ", p = " + std::to_string(p));
          const Ensemble e = with_noise(random_experiments(random_system(size, 30, 0.95, 3), 40, 4), 0.1, 5);
          const Plan plan = plan_of(kind, p, feedthrough);
          const GtvArx arx = regressions(e, plan);
          const Model model = realise(e, arx, {}, plan);
          model.check();
          EXPECT_EQ(model.states(), p * size.m);
          EXPECT_EQ(model.method, "regression");
          const Model all = continued(model, e.steps());
          // With unknown initial states, p samples from the first step of the model on determine the state.
          const Index from = kind.initial == InitialState::zero ? 6 : model.k_begin + p + 6;
          for (const Index horizon : {1, 5}) {
            const Ensemble found = predict(all, e, {horizon, kind.initial}).y;
            for (Index k = from; k < e.steps(); ++k)
              // Sums of products of coefficients of order 1, of p·d terms each, over five steps.
              EXPECT_LE((found.output(k) - predicted(arx, e, k, horizon)).norm(), 1e-9 * e.output(k).norm())
                  << k << ", " << horizon;
          }
        }
}

TEST(ObserverForm, BeginsWithRegressionsOfFewerLags) {
  for (const double smoothing : {0.0, 10.0}) {
    const Ensemble e = with_noise(random_experiments(random_system({4, 2, 2}, 30, 0.95, 6), 60, 7, 2.0), 0.1, 8);
    const Index p = 4;
    Plan plan = plan_of({InitialState::unknown, {smoothing, 0}}, p);
    const GtvArx arx = regressions(e, plan);
    const Model model = observer_form_from_start(e, arx, {p, plan.initial_state, true, plan.choices.variation});
    model.check();
    const Ensemble found = predict(model, e, {1, InitialState::unknown}).y;
    for (Index k = 1; k < e.steps(); ++k) {
      plan.lags = std::min(k, p);
      const GtvArx own = k < p ? regressions(stretch(e, 0, 2 * p), plan) : arx;
      EXPECT_LE((found.output(k) - predicted(own, e, k, 1)).norm(), 1e-10 * e.output(k).norm()) << k;
    }
    // The covariances are those of the errors.
    for (const Index k : {0, 1, 2, 3, 10}) {
      const double ratio = (e.output(k) - found.output(k)).squaredNorm() /
                           (double(e.experiments()) * model.at(k).innovation_cov().trace());
      EXPECT_GT(ratio, 0.3) << k;
      EXPECT_LT(ratio, 3.0) << k;
    }
  }
}

TEST(ObserverForm, NeedsAsManyStepsAsLagsAndPeriod) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 12, 0.9, 10), 40, 11), 0.1, 12);
  EXPECT_THROW(identify(e, {.lags = 6, .method = Method::regression, .period = 8}), std::invalid_argument);
}

// Without noise, each step has its own regression, and bounds identify the model again.
TEST(ObserverForm, IsAModelOfExactData) {
  const Ensemble e = random_experiments(random_system({4, 2, 2}, 20, 0.95, 13), 40, 14);
  for (const bool feedthrough : {true, false}) {
    const Model model = identify(e, {.lags = 2, .method = Method::regression, .feedthrough = feedthrough}).model;
    model.check();
    EXPECT_EQ(model.states(), 4);
    EXPECT_TRUE(!feedthrough || output_error(e, simulate(model, e)) <= 1e-9);
    const Confidence bounds = confidence(model, e, {.replicates = 20});
    EXPECT_TRUE(bounds.findings.empty());
  }
}

// Regressions of one model for all steps may have more lags than those that vary.
TEST(ObserverForm, IsComparedForAnyLagsOfTheChoice) {
  const Ensemble e = with_noise(random_experiments(constant_system({2, 1, 1}, 80, 0.9, 15), 30, 16, 1.0), 0.1, 17);
  for (const Index lags : {24, 36}) EXPECT_GT(identify(e, {.lags = lags, .period = 1}).model.states(), 0);
}

TEST(ObserverForm, IsRefusedWithWhatItDoesNotUse) {
  const Ensemble e = noisy_experiments(oscillator(12), 20, 9);
  for (const IdentifyOptions& options : {IdentifyOptions{.states = 4, .method = Method::regression},
                                         {.method = Method::regression, .refine = true},
                                         {.method = Method::regression, .weighting = Weighting::one_step}})
    EXPECT_THROW(identify(e, options), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
