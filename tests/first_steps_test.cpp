// Models from unknown initial states predict from step 0 on, and say how certain predictions several steps ahead are.
// SPDX-License-Identifier: BSD-3-Clause
#include "choose/first_steps.hpp"

#include <gtest/gtest.h>

#include "choose/ahead_errors.hpp"
#include "data/rows.hpp"
#include "noisy.hpp"
#include "tokid/em.hpp"
#include "tokid/identify.hpp"
#include "tokid/observer.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize sizes[] = {{2, 1, 1}, {3, 2, 2}, {4, 1, 2}};

// Varies slowly.
Model noisy(const SystemSize& size, std::uint64_t seed) {
  Model system = constant_system(size, 40, 0.9, seed);
  for (Index k = 0; k < 40; ++k) system.at(k).A() *= 1 + 0.1 * std::sin(0.1 * double(k));
  return with_noise(std::move(system), {.process_noise = process_noise, .measurement_noise = measurement_noise});
}

TEST(KnownMatrices, StayWhileEmEstimatesTheNoiseAndTheInitialState) {
  for (const SystemSize& size : sizes) {
    SCOPED_TRACE(name(size));
    Model truth = noisy(size, 3);
    const Ensemble data = noisy_experiments(truth, 400, 4, InitialState::unknown);
    Model start = truth;
    start.x0_mean.resize(0);
    start.x0_cov.resize(0, 0);
    for (Step& step : start.step) {
      step.set_Q(10 * step.Q());
      step.set_R(0.1 * step.R());
    }
    Refinement result = refine(
        start, data,
        {.smoothing = 1.0, .iterations = 200, .initial_state = InitialState::unknown, .estimate_matrices = false});
    Step &found = result.model.at(20), &true_step = truth.at(20);
    for (Index k = 0; k < 40; ++k)
      for (const auto part : system_parts) EXPECT_EQ((result.model.at(k).*part)(), (truth.at(k).*part)()) << k;
    // 16000 samples of each output: standard errors of about 1 %, and more where the outputs hardly show the states. Q
    // is not unique if there are fewer outputs than states, but the likelihood is as large as with the true one.
    EXPECT_NEAR(found.R().trace() / true_step.R().trace(), 1.0, 0.1);
    truth.initial_state = InitialState::unknown;
    truth.x0_mean = result.model.x0_mean;
    truth.x0_cov = result.model.x0_cov;
    EXPECT_GE(log_likelihoods(result.model, data).mean(), log_likelihoods(truth, data).mean() - 1e-3);
    EXPECT_EQ(result.model.x0_cov.rows(), size.n);
  }
}

// A model that begins late becomes one that predicts all samples, the later ones as well as before.
TEST(FirstSteps, ArePredictedByModelsThatBeganLate) {
  for (const SystemSize& size : sizes) {
    SCOPED_TRACE(name(size));
    const Model truth = noisy(size, 5);
    const Ensemble data = noisy_experiments(truth, 200, 6, InitialState::unknown),
                   fresh = noisy_experiments(truth, 200, 7, InitialState::unknown);
    const Model late =
        identify(data, {.states = size.n, .refine = false, .initial_state = InitialState::unknown}).model;
    ASSERT_GT(late.k_begin, 0);
    const Model whole = with_first_steps(late, data, InitialState::unknown, 1);
    EXPECT_EQ(whole.k_begin, 0);
    EXPECT_EQ(whole.k_end(), 40);
    EXPECT_EQ(whole.method, late.method);
    EXPECT_LE(one_step_error(whole, fresh, 30, 40), 1.05 * one_step_error(late, fresh, 30, 40));
    // The mean of x_0 is zero: no model predicts y_0 better than by D u_0.
    EXPECT_LE(one_step_error(whole, fresh, 0, 1),
              1.05 * std::sqrt(fresh.output(0).squaredNorm() / (200.0 * double(size.m))));
    EXPECT_TRUE(with_first_steps(late, data, InitialState::zero, 1).k_begin == late.k_begin);
  }
}

TEST(FirstSteps, BelongToEveryModelFromUnknownInitialStates) {
  for (const Index count : {8, 12, 40}) {
    SCOPED_TRACE(count);
    const Model truth = noisy({2, 1, 1}, 8);
    Ensemble data = noisy_experiments(truth, count, 9, InitialState::unknown);
    data.initial_state = InitialState::unknown;
    const Identification result = identify(data);
    EXPECT_EQ(result.model.k_begin, 0);
    const Ensemble predicted = predict(result.model, data).y;
    EXPECT_TRUE(predicted.output(count > result.model.states() ? 0 : 10).allFinite());
  }
}

// Almost without noise, copies of matrices are far from those of the first steps. They leave the later steps alone, or
// are not used.
TEST(FirstSteps, SpoilNoLaterStep) {
  constexpr double noise = 1e-6;
  for (const SystemSize& size : sizes) {
    SCOPED_TRACE(name(size));
    Model truth = constant_system(size, 60, 0.9, 12);
    for (Index k = 0; k < 60; ++k) truth.at(k).A() *= 1 + 0.1 * std::sin(0.2 * double(k));
    truth = with_noise(std::move(truth), {.process_noise = noise, .measurement_noise = noise});
    const auto measured = [&](std::uint64_t seed) {
      return experiments(truth, {.experiments = 40,
                                 .seed = seed,
                                 .process_noise = noise,
                                 .measurement_noise = noise,
                                 .initial_state = InitialState::unknown});
    };
    const Ensemble fresh = measured(14);
    const Model found = identify(measured(13), {.states = size.n, .refine = false}).model;
    EXPECT_TRUE(found.k_begin == 0 || found.k_begin == found.at(30).lags()) << found.k_begin;
    EXPECT_LE(one_step_error(found, fresh, 25, 55), 1.5 * one_step_error(kalman_observer(truth), fresh, 25, 55));
  }
}

AheadErrors errors_of(const Model& model, const Ensemble& predicted, const Ensemble& measured, Index horizon) {
  return ahead_errors(model, predicted, {predicted}, 2, measured, horizon);
}

// The errors of a true model are as large as it says, and those of a model with wrong dynamics are larger.
TEST(AheadErrors, AreAsLargeAsTrueModelsSay) {
  constexpr Index horizon = 10;
  for (const SystemSize& size : sizes) {
    SCOPED_TRACE(name(size));
    const Model truth = kalman_observer(noisy(size, 10));
    const Ensemble fresh = noisy_experiments(truth, 500, 11);
    const auto ratio = [&](const Model& model) {
      return errors_of(model, predict(model, fresh, {horizon, InitialState::zero}).y, fresh, horizon).ratio();
    };
    // 500 × 30 errors that are correlated over 10 steps: standard errors of about 2 %.
    EXPECT_NEAR(ratio(truth), 1.0, 0.06);
    Model wrong = truth;
    for (Step& step : wrong.step) step.A() *= 0.5;
    EXPECT_GT(ratio(wrong), 1.1);
  }
}

// Regressions on random rows X at each step, by experiments with noise of variance 1. The model of a fold errs at the
// row x of an experiment that it has not seen with the variance 1 + xᵀ (Xᵀ X)⁻¹ x: the second part comes from the
// model.
TEST(AheadErrors, ShowHowMuchOfThemComesFromTheModel) {
  struct Case {
    Index experiments, folds, used, coefficients;
  };
  constexpr Index steps = 1000;
  Model model = random_system({1, 1, 1}, steps, 0.9, 14);
  for (Step& step : model.step) {
    step.G().setZero();
    step.set_innovation_cov(Matrix::Identity(1, 1));
  }
  for (const Case c : {Case{12, 4, 4, 1}, {10, 10, 3, 4}, {15, 5, 3, 5}, {100, 2, 2, 1}}) {
    SCOPED_TRACE(c.folds);
    Random random(15);
    std::vector<Ensemble> measured, predicted;  // predicted[f * used + g]: fold f by the model of fold g
    for (Index f = 0; f < c.used; ++f) {
      measured.emplace_back(c.experiments / c.folds, steps, 1, 1);
      for (Index g = 0; g < c.used; ++g) predicted.emplace_back(c.experiments / c.folds, steps, 1, 1);
    }
    double of_model = 0.0, count = 0.0;
    for (Index k = 0; k < steps; ++k) {
      const Matrix x = random.matrix(c.experiments, c.coefficients), y = random.matrix(c.experiments, 1);
      for (Index g = 0; g < c.used; ++g) {
        const std::vector<Index> own = fold_rows(c.experiments, g, c.folds), seen = other_rows(c.experiments, own);
        const Matrix inverse = linalg::pseudo_inverse(x(seen, Eigen::all)), theta = inverse * y(seen, Eigen::all);
        measured[size_t(g)].output(k) = y(own, Eigen::all);
        if (k > 0) of_model += (x(own, Eigen::all) * inverse).squaredNorm(), count += double(own.size());
        for (Index f = 0; f < c.used; ++f)
          predicted[size_t(f * c.used + g)].output(k) = x(fold_rows(c.experiments, f, c.folds), Eigen::all) * theta;
      }
    }
    AheadErrors sum;
    for (Index f = 0; f < c.used; ++f) {
      std::vector<Ensemble> others(predicted.begin() + f * c.used, predicted.begin() + (f + 1) * c.used);
      const Ensemble own = others[size_t(f)];
      others.erase(others.begin() + f);
      sum += ahead_errors(model, own, others, c.folds, measured[size_t(f)], 1);
    }
    // 1000 regressions, whose variances spread by up to a factor of two around their mean
    EXPECT_NEAR(sum.spread(0) / of_model, 1.0, 0.12);
    EXPECT_NEAR(sum.model_share(), of_model / (of_model + count), 0.05);
    EXPECT_NEAR(sum.ratio(), std::sqrt(1 + of_model / count), 0.05);
  }
}

TEST(AheadErrors, OfOutputsWithoutNoiseAreNotCounted) {
  Model exact = random_system({2, 1, 1}, 40, 0.9, 12);
  for (Step& step : exact.step) step.set_innovation_cov(Matrix::Zero(1, 1));
  const Ensemble data = random_experiments(exact, 5, 13, 0.0);
  EXPECT_TRUE(std::isnan(errors_of(exact, data, data, 10).ratio()));
  EXPECT_TRUE(std::isnan(errors_of(exact, data, data, 10).model_share()));
}

}  // namespace
}  // namespace tokid::testing
