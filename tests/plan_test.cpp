// The choices of a plan, and what a plan makes of windows.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/plan.hpp"

#include <gtest/gtest.h>

#include "choose/folds.hpp"
#include "choose/realisation.hpp"
#include "choose/regression.hpp"
#include "noisy.hpp"

namespace tokid::testing {
namespace {

// Largest difference of the pulse responses of two models, relative to the largest entry of the first one.
double pulse_error(const Model& a, const Model& b, Index band) {
  double difference = 0.0, size = 0.0;
  for (Index k = std::max(a.k_begin, b.k_begin) + 1; k < std::min(a.k_end(), b.k_end()); ++k)
    for (Index i = std::max({a.k_begin, b.k_begin, k - band}); i < k; ++i) {
      const Matrix own = pulse_response(a, k, i);
      difference = std::max(difference, (own - pulse_response(b, k, i)).cwiseAbs().maxCoeff());
      size = std::max(size, own.cwiseAbs().maxCoeff());
    }
  return difference / size;
}

// Experiments and their triangular factors lead to the same model, step by step and coupled.
TEST(Plan, WholeEnsemblesAndFactorsGiveTheSameModel) {
  for (const SystemSize size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 2}, SystemSize{4, 2, 1}}) {
    SCOPED_TRACE(name(size));
    const Index p = smallest_lag_order(size), steps = 20;
    const Model system = random_system(size, steps, 0.9, std::uint64_t(size.n));
    const Index count = minimum_experiments(size.r, size.m, p) + 8;
    Plan plan;
    plan.lags = p;
    plan.states = size.n;
    for (const bool coupled : {false, true})
      for (const Method method : {Method::tvera, Method::subspace}) {
        if (coupled && method == Method::tvera) continue;
        plan.coupled = plan.noisy = coupled;
        plan.method = method;
        plan.choices.variation.smoothing = coupled ? 3.0 : 0.0;
        plan.choices.state_smoothing = coupled ? 0.1 : 0.0;
        const Ensemble exact = random_experiments(system, count, 5);
        const Ensemble e = coupled ? with_noise(exact, 0.05, 6) : exact;
        const WindowFactors factors = window_factors(e, p, plan.initial_state);
        const Windows windows(factors);
        const Model whole = realise(e, regressions(e, plan), {}, plan);
        const Model merged = realise(windows, regressions(windows, plan), {}, plan);
        // Factors of other rows round otherwise; the condition of windows and Hankel matrices enlarges that.
        EXPECT_LE(pulse_error(whole, merged, 3), 1e-8) << coupled << int(method);
        if (!coupled) {
          EXPECT_LE(pulse_error(system, whole, 3), 1e-8) << int(method);
        }
      }
  }
}

TEST(Plan, RegressionsAreOfEachStepUntilNoiseOrFewExperimentsAskForMore) {
  const SystemSize size{3, 2, 2};
  const Model system = random_system(size, 20, 0.9, 7);
  const Ensemble exact = random_experiments(system, 30, 8), noisy = with_noise(exact, 0.05, 9);
  const auto plan_of = [](const Ensemble& e, const IdentifyOptions& o) {
    return regressed(e, selection_samples(e, o), false, o).plan;
  };
  const Plan alone = plan_of(exact, {});
  EXPECT_FALSE(alone.coupled);
  EXPECT_FALSE(alone.noisy);
  EXPECT_EQ(alone.lags, 2);
  EXPECT_EQ(alone.initial_state, InitialState::zero);
  EXPECT_EQ(plan_of(random_experiments(system, 30, 8, 5.0), {}).initial_state, InitialState::unknown);
  const Plan together = plan_of(noisy, {});
  EXPECT_TRUE(together.coupled);
  EXPECT_TRUE(together.noisy);
  // Matrices that are independent from step to step bear hardly any penalty; those of the oscillator vary slowly.
  EXPECT_LT(together.choices.variation.smoothing, 1e-3);
  EXPECT_GT(plan_of(noisy_experiments(oscillator(30), 30, 3), {}).choices.variation.smoothing, 0.0);
  EXPECT_FALSE(plan_of(noisy, {.method = Method::tvera}).coupled);
  EXPECT_TRUE(plan_of(exact.subset({0, 1, 2, 3}), {}).coupled);
  EXPECT_TRUE(plan_of(exact, {.period = 4}).coupled);
  EXPECT_EQ(plan_of(noisy, {.smoothing = 2.5}).choices.variation.smoothing, 2.5);
}

TEST(Plan, LongRecordsAreJudgedByAStretchAndShortOnesWhole) {
  const Ensemble e = random_experiments(constant_system({2, 1, 1}, 600, 0.9, 3), 2, 4);
  EXPECT_EQ(selection_samples(e, {}).samples->steps(), 256);
  EXPECT_EQ(selection_samples(e, {}).begin, 172);
  const Ensemble whole = stretch(e, 0, 500);
  EXPECT_EQ(selection_samples(whole, {}).samples.get(), &whole);
  const auto pieces = selection_samples(e, {.period = 10}).samples;
  EXPECT_EQ(pieces->steps(), 200);  // a multiple of the period, five pieces at least of all experiments
  EXPECT_EQ(pieces->experiments(), 6);
}

// The order that was simulated is chosen on held-out experiments, whatever the number of threads, and with more states
// than it takes none is better.
TEST(Folds, ChooseTheSimulatedOrder) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const Ensemble e =
        with_noise(random_experiments(constant_system({3, 2, 2}, 60, 0.9, seed), 20, seed + 10), 0.02, seed + 20);
    Folds::Options o;
    o.lags = 4;
    o.variation = {0.0, 1};
    const OrderScores one = Folds(e, o).choose_states({}, 8);
    EXPECT_EQ(one.best, 3) << seed;
    EXPECT_TRUE(one.cross_validated);
    o.execution.threads = 3;
    const OrderScores several = Folds(e, o).choose_states({}, 8);
    EXPECT_EQ(several.errors, one.errors);
    o.horizons = {1, 7, 40};
    EXPECT_EQ(Folds(e, o).choose_states({}, 8).horizons, (std::vector<Index>{1, 7}));  // 40 steps: more than half of 60
    const OrderScores given = Folds(e, o).choose_states(2, 8);
    EXPECT_EQ(given.states, std::vector<Index>{2});
    EXPECT_EQ(given.errors.rows(), 1);
  }
}

// With too few states, a model of a varying system may predict worse the more states it has, so that the search for n
// ends early. The regressions show that more are needed.
TEST(Folds, MayEndEarlyWhereTheRegressionIsTheModel) {
  const SystemSize size{8, 4, 5};
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    Model system = constant_system(size, 100, 0.95, seed);
    const Model other = constant_system(size, 100, 0.95, seed + 100);
    for (Index k = 0; k < 100; ++k) {
      const double change = 0.3 * std::sin(0.06 * double(k));
      system.at(k).A() *= 1 + 0.1 * change;
      system.at(k).B() += change * other.at(k).B();
      system.at(k).C() += change * other.at(k).C();
      system.at(k).D() += change * other.at(k).D();
    }
    Ensemble e = with_noise(random_experiments(system, 12, seed + 10), 1e-7, seed + 20);
    if (seed > 2)  // an output that is always zero does not hide that
      for (Index k = 0; k < 100; ++k) e.output(k).col(3).setZero();
    const Identification found = identify(e, {.delays = std::vector<Index>{}});
    ASSERT_TRUE(found.comparison);
    EXPECT_GE(found.model.states(), size.n) << seed;
    EXPECT_LE(found.comparison->model.error(0), 1.25 * found.comparison->regression.error(0)) << seed;
  }
}

// Projections of noise-free records show the system itself, from any initial states.
TEST(Moesp, RecoversTimeInvariantSystemsExactly) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, SystemSize{3, 1, 2}, SystemSize{4, 2, 2}, SystemSize{5, 3, 1}}) {
    SCOPED_TRACE(name(size));
    const Model system = constant_system(size, 400, 0.9, std::uint64_t(size.n + 7));
    const Ensemble e = random_experiments(system, 3, 11, 2.0);
    Plan plan;
    plan.lags = size.n + 2;
    plan.states = size.n;
    plan.initial_state = InitialState::unknown;
    plan.coupled = true;
    plan.choices.variation = {0.0, 1};
    plan.choices.weighting = Weighting::projection;
    const Model model = realise(e, regressions(e, plan), {}, plan);
    EXPECT_EQ(model.states(), size.n);
    // 1200 samples; the errors of the projections are those of factors with condition numbers up to 1e4
    EXPECT_LE(pulse_error(from_step(system, model.k_begin), model, 5), 1e-9);
  }
}

// EM in parts is EM at once, up to any stage.
TEST(StagesOfEm, GoOnWhereTheyStopped) {
  const Model truth = with_noise(random_system({2, 1, 1}, 40, 0.9, 12),
                                 {.process_noise = process_noise, .measurement_noise = measurement_noise});
  const Ensemble data = noisy_experiments(truth, 8, 16);
  struct Case {
    std::vector<Index> jumps, ends;
  };
  for (const auto& [jumps, ends] :
       {Case{{}, {3, 6, 12, 24, 48, 96, 192}}, Case{{20}, {3, 6, 12, 24, 48, 96, 192, 384}}}) {
    RefineOptions o;
    o.smoothing = 3.0;
    o.jumps = jumps;
    const Index all = ends[ends.size() - 2], farther = ends.back();
    const Model whole = refined(truth, data, 0, farther, o);
    for (const Index part : {ends[0], ends[2], all}) {
      const Model again = refined(refined(truth, data, 0, part, o), data, part, farther, o);
      for (Index k = 0; k < whole.k_end(); ++k) EXPECT_EQ(again.at(k).A(), whole.at(k).A()) << part;
    }
    EXPECT_NE(refined(truth, data, 0, all, o).at(5).A(), whole.at(5).A());
    Index now = 0;
    for (const Index end : ends) EXPECT_EQ(now = next_stage_end(now), end);
    EXPECT_TRUE(stopped_early(ends[ends.size() - 4], o));
    EXPECT_FALSE(stopped_early(ends[ends.size() - 3], o));
  }
}

}  // namespace
}  // namespace tokid::testing
