// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <string>

#include "noisy.hpp"
#include "tokid/example.hpp"
#include "tokid/observer.hpp"

namespace tokid::testing {
namespace {

using testing::mentions;

// The published example: N = 10 zero-state experiments, p = 2, free responses. paper_test.cpp holds its numbers.
TEST(Identify, PublishedExampleFromStepZeroToTheLast) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8}) {
    const Ensemble e = experiments(oscillator(80), {.experiments = 10, .seed = seed, .free_responses = 8});
    const Identification result = identify(e, {.states = 4, .lags = 2});
    const Ensemble fresh = experiments(oscillator(80), {.experiments = 30, .seed = seed + 1000});
    EXPECT_LE(output_error(fresh, simulate(result.model, fresh)), 1e-9);
    EXPECT_EQ(result.model.k_begin, 0);
    EXPECT_EQ(result.model.k_end(), 80);
    EXPECT_TRUE(result.findings.empty());  // the first two steps have residuals left, which say that there is no noise
    EXPECT_EQ(result.min_experiments, 10);
  }
}

// Noise-free recovery on random systems, whose matrices are independent from step to step.
struct Case {
  SystemSize size;
  double growth;  // largest singular value of A_k: the origin is stable below 1, unstable above about 1.2
};

class Recovery : public ::testing::TestWithParam<Case> {
 protected:
  template <class Check>
  void for_each_setting(Check&& check) {
    const SystemSize size = GetParam().size;
    for (const Index extra : {0, 3}) {
      const Index p = smallest_lag_order(size) + extra;
      const Index steps = std::max<Index>(30, 4 * p + 2 * size.n);
      const Model system =
          random_system(size, steps, GetParam().growth, std::uint64_t(size.n + 10 * size.m + 100 * size.r));
      for (const Index experiments : {minimum_experiments(size.r, size.m, p) + 5, Index(200)}) {
        SCOPED_TRACE("p = " + std::to_string(p) + ", N = " + std::to_string(experiments));
        check(system, p, experiments);
      }
    }
  }
};

TEST_P(Recovery, MarkovParametersAndFreshOutputsFromRest) {
  for_each_setting([&](const Model& system, Index p, Index count) {
    const Identification result =
        identify(random_experiments(system, count, 1), {.lags = p, .initial_state = InitialState::zero});
    EXPECT_EQ(result.model.steps(), system.steps());
    EXPECT_EQ(result.model.states(), system.states());
    EXPECT_LE(kinematically_similar(result.model, system).max_difference, 1e-9);
    const Ensemble fresh = random_experiments(system, 20, 2);
    EXPECT_LE(output_error(fresh, simulate(result.model, fresh)), 1e-9);
    EXPECT_EQ(result.initial_state_test.decision, InitialState::zero);
  });
}

TEST_P(Recovery, PredictionsFromUnknownInitialStates) {
  for_each_setting([&](const Model& system, Index p, Index count) {
    Ensemble e = random_experiments(system, count, 3, 30.0);
    const Identification result = identify(e, {.lags = p});
    EXPECT_EQ(result.initial_state_test.decision, InitialState::unknown) << result.initial_state_test.reason;
    const Index begin = result.model.k_begin;
    EXPECT_EQ(begin, p);
    EXPECT_TRUE(mentions(result.findings, "the model begins at step " + std::to_string(begin)));
    const Ensemble fresh = random_experiments(system, 20, 4, 30.0);
    const Prediction prediction = predict(result.model, fresh);
    for (Index k = 0; k < system.steps(); ++k) EXPECT_EQ(prediction.y.output(k).allFinite(), k >= begin + p);
    EXPECT_LE(output_error(fresh, prediction.y), 1e-9);
  });
}

INSTANTIATE_TEST_SUITE_P(
    Grid, Recovery,
    ::testing::Values(Case{{1, 1, 1}, 0.9}, Case{{1, 1, 1}, 1.3}, Case{{2, 1, 1}, 0.9}, Case{{2, 1, 1}, 1.3},
                      Case{{3, 1, 1}, 1.0}, Case{{4, 2, 2}, 0.9}, Case{{4, 2, 2}, 1.3}, Case{{3, 2, 1}, 1.3},
                      Case{{2, 3, 1}, 0.9}, Case{{2, 3, 1}, 1.3}, Case{{2, 1, 4}, 0.9}, Case{{2, 1, 4}, 1.3},
                      Case{{5, 2, 3}, 1.0}, Case{{4, 1, 2}, 1.3}, Case{{4, 3, 1}, 1.0}, Case{{6, 1, 1}, 1.0},
                      Case{{12, 3, 2}, 0.9}, Case{{12, 4, 4}, 0.9}, Case{{12, 4, 4}, 1.3}, Case{{12, 2, 1}, 0.9},
                      Case{{12, 2, 1}, 1.3}, Case{{12, 1, 1}, 0.9}, Case{{12, 1, 1}, 1.2}, Case{{12, 1, 2}, 1.0}),
    [](const auto& test) { return name(test.param.size) + "growth" + std::to_string(int(10 * test.param.growth)); });

TEST(Identify, TimeInvariantSystemsGiveTheModelOfClassicalEra) {
  const SystemSize size{3, 2, 1};
  const Model system = constant_system(size, 40, 0.9, 100);
  const Identification result = identify(random_experiments(system, 30, 101), {.lags = 3});
  // ERA (Juang 1994): Hankel matrices of the pulse responses h_1, h_2, … of the step where k is large enough.
  const auto h = [&](Index gap) { return pulse_response(result.model, 30, 30 - gap); };
  Matrix h0(3 * 2, 3), h1(3 * 2, 3);
  for (Index a = 0; a < 3; ++a)
    for (Index b = 0; b < 3; ++b) h0.block(2 * a, b, 2, 1) = h(a + b + 1), h1.block(2 * a, b, 2, 1) = h(a + b + 2);
  const linalg::Svd d = linalg::svd(h0);
  const Matrix root = d.s.head(3).cwiseSqrt().cwiseInverse().asDiagonal();
  const Matrix a = root * d.u.leftCols(3).transpose() * h1 * d.v.leftCols(3) * root;
  const Matrix b = root * d.u.leftCols(3).transpose() * h0.leftCols(1);
  const Matrix c = h0.topRows(2) * d.v.leftCols(3) * root;
  Matrix power = b;
  for (Index gap = 1; gap < 12; ++gap, power = a * power)
    for (Index k = gap; k < 40; ++k)
      EXPECT_LE((pulse_response(result.model, k, k - gap) - c * power).norm(), 1e-9) << k << " " << gap;
  // The poles are those of the system.
  Eigen::VectorXcd poles = linalg::eigenvalues(a), truth = linalg::eigenvalues(system.step[0].A());
  const auto order = [](auto x, auto y) { return std::pair(x.real(), x.imag()) < std::pair(y.real(), y.imag()); };
  std::sort(poles.begin(), poles.end(), order);
  std::sort(truth.begin(), truth.end(), order);
  EXPECT_LE((poles - truth).norm(), 1e-8);
}

// Of regressions with many unknowns, the choices use stretches of the steps. They must lie within the data.
TEST(Identify, TakesLagsBeyondHalfOfTheSteps) {
  const Ensemble e = with_noise(random_experiments(constant_system({2, 2, 1}, 90, 0.9, 5), 60, 6), 0.01, 7);
  const Identification found =
      identify(e, {.states = 2, .lags = 48, .smoothing = std::numeric_limits<double>::infinity(), .refine = false});
  EXPECT_EQ(found.plan.lags, 48);
  EXPECT_GT(found.validation.one_step.fit.minCoeff(), 98);  // the noise is 1 % of the outputs
}

TEST(Identify, ChoosesTheOrdersOfNoiseFreeData) {
  const Ensemble e = experiments(oscillator(60), {.experiments = 40});
  const Identification result = identify(e);
  EXPECT_EQ(result.plan.lags, 2);
  EXPECT_EQ(result.model.states(), 4);
  EXPECT_FALSE(result.plan.noisy);
  EXPECT_EQ(result.lag_order_errors.best, 2);
}

// The factors of the subspace realisation show 24 singular values unless more are needed.
TEST(Identify, HasMoreStatesThanAreUsual) {
  const Model system = random_system({26, 8, 2}, 14, 0.95, 3);
  const Ensemble e = experiments(system, {.experiments = 80, .measurement_noise = 1e-5});
  const Identification result = identify(e, {.states = 26, .lags = 4, .refine = false});
  EXPECT_TRUE(result.plan.coupled);
  EXPECT_EQ(result.model.states(), 26);
}

TEST(Identify, InitialStatesAreToldApartWithAndWithoutNoise) {
  for (const double noise : {0.0, 0.1})
    for (const InitialState truth : {InitialState::zero, InitialState::unknown})
      for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        Ensemble e = experiments(oscillator(40), {.experiments = 40,
                                                  .seed = seed,
                                                  .process_noise = noise / 3,
                                                  .measurement_noise = noise,
                                                  .initial_state = truth});
        e.initial_state.reset();
        const InitialStateTest test = identify(e, {.states = 4, .lags = 3, .method = Method::tvera}).initial_state_test;
        EXPECT_EQ(test.decision, truth) << "noise " << noise << " seed " << seed << ": " << test.reason;
      }
}

TEST(Identify, WhatTheDataOrTheCallerSayOfInitialStatesIsTaken) {
  Ensemble e = experiments(oscillator(40), {.experiments = 20});
  EXPECT_EQ(identify(e).initial_state_test.reason, "as the data say");
  const Identification result = identify(e, {.initial_state = InitialState::unknown});
  EXPECT_EQ(result.initial_state_test.reason, "as asked");
  EXPECT_EQ(result.model.k_begin, 2);  // as soon as the samples tell all of the state
  EXPECT_EQ(result.model.initial_state, InitialState::unknown);
}

// The output is a position. Initial velocities show from the second step on.
TEST(Identify, InitialStatesOfFewRecordsOfOneModelAreTested) {
  for (const Index count : {2, 3, 5})
    for (const InitialState state : {InitialState::zero, InitialState::unknown}) {
      std::mt19937_64 random{std::uint64_t(count)};
      std::normal_distribution<double> normal;
      Ensemble e(count, 80, 1, 1);
      for (Index n = 0; n < count; ++n) {
        double position = 0.0, velocity = state == InitialState::unknown ? 3.0 * normal(random) : 0.0;
        for (Index k = 0; k < e.steps(); ++k) {
          const double u = e.u(n, k, 0) = normal(random);
          e.y(n, k, 0) = position + 0.02 * normal(random);
          position += 0.3 * velocity;
          velocity += 0.3 * (u - position) - 0.1 * velocity;
        }
      }
      const InitialStateTest test =
          identify(e, {.period = 1, .refine = false, .nominal = NominalChoice::none}).initial_state_test;
      EXPECT_EQ(test.decision, state) << count << ": " << test.reason;
    }
}

// Regressions of each step alone have one lag here, and their residuals hide initial states.
TEST(Identify, InitialStatesOfFewExperimentsAreTestedOnHeldOutOnes) {
  for (const std::uint64_t seed : {1u, 2u, 3u})
    for (const InitialState state : {InitialState::zero, InitialState::unknown}) {
      const Ensemble e =
          experiments(periodic_system({4, 2, 2}, 30, 1, 1.0, seed),
                      {.experiments = 9, .seed = seed, .measurement_noise = 1e-3, .initial_state = state});
      Ensemble untold = e;
      untold.initial_state.reset();
      const InitialStateTest test = identify(untold, {.refine = false}).initial_state_test;
      EXPECT_EQ(test.decision, state) << seed << ": " << test.reason;
    }
}

// A gust that meets every experiment: over all steps together its mean is nothing.
TEST(Identify, MeanMotionsOfFewStepsAreFound) {
  const Model system = oscillator(100);
  const auto moved = [](Ensemble e) {
    for (Index k = 40; k < 46; ++k) e.output(k).col(0).array() += 20;
    return e;
  };
  const Ensemble e = moved(experiments(system, {.experiments = 40, .measurement_noise = 0.1}));
  const Ensemble fresh = moved(experiments(system, {.experiments = 10, .seed = 9, .measurement_noise = 0.1}));
  const IdentifyOptions options{.states = 4, .lags = 4};
  const Identification result = identify(e, options);
  EXPECT_TRUE(result.plan.nominal);
  EXPECT_LT(result.nominal_test.statistic, result.nominal_test.threshold);
  ASSERT_EQ(result.nominal_test.departures.size(), 1u);
  EXPECT_EQ(result.nominal_test.departures[0].channel, 2);
  EXPECT_EQ(result.nominal_test.departures[0].steps, (std::vector<Index>{40, 41, 42, 43, 44, 45}));
  EXPECT_GT(validate(result.model, fresh).simulation.fit.minCoeff(), 90.0);
}

TEST(Identify, NominalTrajectoriesAreFoundRemovedAndAddedBack) {
  const Model system = oscillator(50);
  const auto moved = [](Ensemble e) {
    for (Index k = 0; k < e.steps(); ++k) {
      e.input(k).array() += 3 * std::sin(0.2 * double(k));
      e.output(k).array() += 20 * std::cos(0.1 * double(k));
    }
    return e;
  };
  const Ensemble e = moved(experiments(system, {.experiments = 20}));
  const Ensemble fresh = moved(experiments(system, {.experiments = 5, .seed = 9}));
  const Identification result = identify(e);
  EXPECT_TRUE(result.nominal_test.significant);
  ASSERT_EQ(result.model.y_nominal.rows(), 50);
  // The sample mean of 20 experiments is not the true trajectory; but what remains is an affine combination of exact
  // departures, so the model is exact and the outputs of fresh data are too.
  EXPECT_TRUE(kinematically_similar(result.model, system, 1e-9).similar);
  EXPECT_LE(output_error(fresh, simulate(result.model, fresh)), 1e-9);
  EXPECT_EQ(result.min_experiments, 11);
  EXPECT_TRUE(identify(e.subset({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}), {.lags = 2, .nominal = NominalChoice::mean})
                  .model.step[20]
                  .innovation_cov()
                  .isZero(0));  // the mean has spent the one degree of freedom that 11 experiments leave
  IdentifyOptions none{.states = 4, .lags = 2};  // choices take long, because the motion stays
  none.nominal = NominalChoice::none;
  none.refine = false;
  EXPECT_EQ(identify(e, none).model.y_nominal.size(), 0);
  EXPECT_FALSE(identify(experiments(system, {.experiments = 20})).nominal_test.significant);
  EXPECT_EQ(identify(experiments(system, {.experiments = 20})).model.y_nominal.size(), 0);
}

TEST(Identify, TooFewExperimentsAreCountedAndTheOrderThatWouldDoIsNamed) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 9});
  EXPECT_EQ(
      message([&] { identify(e, {.lags = 2, .method = Method::tvera}); }),
      "experiments: 9 found, lag order 2 with 2 inputs and 2 outputs needs at least 10 (r + p(r+m)); 9 suffice for "
      "lag orders up to 1; with smoothing over time, fewer experiments suffice (omit --method tvera)");
  EXPECT_NE(message([&] {
              identify(experiments(oscillator(40), {.experiments = 3}), {.lags = 1, .method = Method::tvera});
            }).find("too few for any lag order, 6 are needed for lag order 1"),
            std::string::npos);
  EXPECT_NE(message([&] {
              identify(experiments(oscillator(2), {.experiments = 40}), {.lags = 2});
            }).find("steps: 2 found, lag order 2 needs at least 3"),
            std::string::npos);
  EXPECT_NE(
      message([&] { identify(e, {.hold_out = 1.0}); }).find("hold_out: 1.0 found, a number from 0 to below 1 needed"),
      std::string::npos);
  EXPECT_NE(message([&] { identify(e, {.states = -1}); }).find("states: -1 found"), std::string::npos);
  Ensemble no_outputs(5, 5, 2, 0);
  for (Index k = 0; k < 5; ++k) no_outputs.input(k).setOnes();
  EXPECT_NE(message([&] { identify(no_outputs); }).find("0 outputs found"), std::string::npos);
}

TEST(Identify, ConstantInputsAreNamedWithTheirSteps) {
  Ensemble e = experiments(oscillator(40), {.experiments = 30});
  Ensemble inputs = e;
  for (Index k = 0; k < 40; ++k) {
    if (k < 10) inputs.input(k).col(1).setZero();
    if (k >= 30) inputs.input(k).col(0).setConstant(1.5);
  }
  inputs.names.input_names = {"torque", "valve"};
  Ensemble data = simulate(oscillator(40), inputs);
  data.names = inputs.names;
  const Identification result = identify(data, {.states = 4, .lags = 2});
  EXPECT_TRUE(mentions(result.findings, "input valve is zero in every experiment at steps 0–9"));
  EXPECT_TRUE(mentions(result.findings, "input torque is the same in every experiment at steps 30–39"));
  result.model.check();  // all matrices are finite
}

TEST(Identify, HeldOutExperimentsJudgeTheModel) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 40, .process_noise = 0.01, .measurement_noise = 0.03});
  const Identification result = identify(e, {.states = 4, .lags = 3, .refine = false, .hold_out = 0.25});
  EXPECT_TRUE(result.held_out);
  EXPECT_EQ(result.experiments, 30);
  EXPECT_EQ(result.validation.one_step.samples, 10 * 40);
  EXPECT_TRUE(result.plan.noisy);
}

// Regressions step by step that were tried and given up leave no figures behind.
TEST(Identify, FiguresAreOfTheRegressionsThatTheModelComesFrom) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    ExperimentOptions o{.experiments = 60, .seed = seed};
    const Identification exact = identify(experiments(oscillator(40), o));
    EXPECT_FALSE(exact.plan.coupled);
    EXPECT_GT(exact.condition_max, 1.0);
    EXPECT_GT(exact.lag_order_errors.mean.size(), 0);
    o.measurement_noise = 0.05;
    for (const bool missing : {false, true}) {
      Ensemble data = experiments(oscillator(40), o);
      if (missing) data.y(7, 12, 1) = nan;
      const Identification noisy = identify(data, {.refine = false});
      EXPECT_TRUE(noisy.plan.coupled);
      EXPECT_FALSE(noisy.smoothing_choice.trials.empty());
      EXPECT_EQ(noisy.condition_max, 0.0);
      EXPECT_EQ(noisy.rank_deficient_steps, 0);
      EXPECT_EQ(noisy.lag_order_errors.mean.size(), 0);
      // Asked for, they are kept.
      const Identification asked = identify(data, {.method = Method::tvera});
      EXPECT_FALSE(asked.plan.coupled);
      EXPECT_GT(asked.condition_max, 1.0);
      EXPECT_GT(asked.lag_order_errors.mean.size(), 0);
    }
  }
}

TEST(Identify, SingleExperimentsAreNamedWithHoldOutToo) {
  Ensemble data = experiments(oscillator(30), {.experiments = 60, .seed = 4, .measurement_noise = 0.02});
  for (Index k = 0; k < 30; ++k) data.y(16, k, 0) *= 50;
  // Two that share no step, both of the larger part of a hold-out.
  for (Index k = 0; k < 30; ++k) {
    if (k < 15) data.input(k).row(41).setConstant(nan), data.output(k).row(41).setConstant(nan);
    if (k >= 14) data.input(k).row(20).setConstant(nan), data.output(k).row(20).setConstant(nan);
  }
  for (int n = 1; n <= 60; ++n) data.experiment_names.push_back(std::to_string(n));
  for (const double hold_out : {0.0, 0.2}) {
    const Identification found = identify(data, {.refine = false, .hold_out = hold_out});
    ASSERT_FALSE(found.outliers.empty());
    EXPECT_EQ(found.outliers.front().experiment, 16);
    EXPECT_EQ(found.outliers.front().name, "17");
    const auto told = [&](const std::string& text) { return mentions(found.findings, text); };
    EXPECT_EQ(told("experiment \"17\" (row 16) does not fit the other experiments"), 1);
    EXPECT_EQ(
        told("experiment \"42\" (row 41) begins at step 15, after experiment \"21\" (row 20) has ended at step 13"), 1);
  }
}

TEST(Identify, NoiseIsSurvivedByEveryOrderChosenAutomatically) {
  // The fits that a usable model reaches on fresh data here; a wrong order gives large negative ones.
  const Model system = oscillator(60);
  ExperimentOptions options{.experiments = 100, .seed = 77, .process_noise = 0.01, .measurement_noise = 0.03};
  const Ensemble fresh = experiments(system, options);
  options.seed = 1;
  for (const auto& [method, count] : std::vector<std::pair<std::optional<Method>, Index>>{
           {Method::tvera, 30}, {Method::tvera, 100}, {Method::tvera, 400}, {std::nullopt, 30}}) {
    options.experiments = count;
    const Identification result = identify(experiments(system, options), {.method = method});
    const Validation v = validate(result.model, fresh);
    EXPECT_GT(v.one_step.fit.minCoeff(), 99) << count;
    EXPECT_GT(v.simulation.fit.minCoeff(), method == Method::tvera && count < 100 ? 85 : 97) << count;
    EXPECT_GE(result.model.states(), 4);
    EXPECT_EQ(method == Method::tvera ? result.order_scores.best : result.refinement.states, result.model.states());
  }
}

// The stiffness of the oscillator changes within 13 steps. Ten experiments determine such changes badly, but a long
// record determines one model with many lags and states well.
TEST(Identify, OneModelServesALongRecordWhereItPredictsBetter) {
  ExperimentOptions options{.experiments = 10, .seed = 1, .process_noise = 0.02, .measurement_noise = 0.05};
  const Ensemble data = experiments(oscillator(2200), options);
  options.seed = 2;
  const Ensemble fresh = experiments(oscillator(2200), options);
  const Identification together = identify(data);
  EXPECT_EQ(together.plan.choices.variation.period, 1);
  EXPECT_EQ(together.plan.choices.refinement_iterations, 0);
  EXPECT_TRUE(mentions(together.findings, "tokid uses one model for all steps"));
  const Identification varying = identify(data, {.jumps = std::vector<Index>{}, .refine = false});
  EXPECT_EQ(varying.plan.choices.variation.period, 0);
  const Validation one = validate(together.model, fresh), many = validate(varying.model, fresh);
  EXPECT_LT(one.one_step.rmse.maxCoeff(), many.one_step.rmse.maxCoeff());
  EXPECT_LT(one.simulation.rmse.maxCoeff(), many.simulation.rmse.maxCoeff());
}

// Few block columns of H_k once left the states of slow and unstable systems to the noise: ratios of 7 to 10 here, with
// one-step predictions of an unstable observer.
TEST(Identify, StatesOfSlowSystemsStandOutFromTheNoise) {
  for (const Model& system : {rotating_tube(80), oscillator(80)}) {
    const Index n = system.states();
    ExperimentOptions options{.experiments = 100, .seed = 60, .process_noise = 0.05, .measurement_noise = 0.1};
    const Ensemble data = experiments(system, options);
    options.experiments = 300;
    options.seed = 61;
    const Ensemble fresh = experiments(system, options);
    const Vector best = validate(with_noise(system, options), fresh).one_step.rmse;
    IdentifyOptions identify_options;
    identify_options.states = n;
    identify_options.lags = 8;
    identify_options.method = Method::tvera;
    const Vector found = validate(identify(data, identify_options).model, fresh).one_step.rmse;
    // √(1 + L/N) is 1.09 for the tube and 1.16 for the oscillator, and as much again is granted to the realisation.
    EXPECT_LE(found.cwiseQuotient(best).maxCoeff(), 1.35) << n;
  }
}

TEST(Identify, FewExperimentsForManyUnknownsAreSaid) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 15, .measurement_noise = 0.1});
  EXPECT_TRUE(mentions(identify(e, {.lags = 3, .method = Method::tvera, .feedthrough = true}).findings,
                       "15 experiments are few for the 14 unknowns"));
  EXPECT_TRUE(mentions(identify(experiments(oscillator(40), {.experiments = 10}), {.states = 4}).findings,
                       "leave no degree of freedom to test lag order 2"));
  EXPECT_TRUE(mentions(
      identify(experiments(oscillator(40), {.experiments = 10}), {.method = Method::tvera, .feedthrough = true})
          .findings,
      "lag order 1 is the largest that 10 experiments can test"));
}

// The outputs depend on the inputs of 21 steps by random coefficients, so that p lags determine at most p states of 20.
TEST(Identify, SingleStepsMayNeedManyLags) {
  Random random(5);
  Ensemble e(90, 60, 1, 1);
  Vector taps(21);
  for (double& tap : taps) tap = random.normal();
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = 0; k < e.steps(); ++k) {
      e.u(n, k, 0) = random.normal();
      e.y(n, k, 0) = 0.0;
      for (Index i = 0; i <= std::min<Index>(k, 20); ++i) e.y(n, k, 0) += taps(i) * e.u(n, k - i, 0);
    }
  e.initial_state = InitialState::zero;
  EXPECT_EQ(identify(e, {.method = Method::tvera}).plan.lags, 20);
}

TEST(Identify, AskingForMoreStatesThanThereAreIsAnswered) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 30});
  const Identification result = identify(e, {.states = 6, .lags = 3});
  EXPECT_EQ(result.model.states(), 4);
  EXPECT_TRUE(mentions(result.findings, "6 states were asked for, but the Hankel matrices have at most rank 4"));
  EXPECT_TRUE(mentions(identify(e, {.states = 4, .lags = 1, .method = Method::tvera}).findings,
                       "lag order 1 with 2 outputs allows at most 2"));
}

TEST(Identify, MissingSamplesAndUnequalLengthsCostOnlyTheRowsTheyTouch) {
  const Model system = oscillator(40);
  Ensemble e = experiments(system, {.experiments = 60});
  Random random(5);
  for (Index n = 0; n < 60; ++n)
    for (Index k = 0; k < 40; ++k)
      if (random.uniform(0, 1) < 0.03 || (n % 3 == 0 && k >= 25)) e.y(n, k, k % 2) = nan;
  const Identification result = identify(e, {.states = 4, .lags = 2});
  EXPECT_TRUE(kinematically_similar(result.model, system, 1e-9).similar);
  const Ensemble fresh = experiments(system, {.experiments = 10, .seed = 6});
  EXPECT_LE(output_error(fresh, simulate(result.model, fresh)), 1e-9);
  // Where too few experiments are left, the tool says at which steps.
  for (Index n = 5; n < 60; ++n) e.y(n, 20, 0) = nan;
  EXPECT_TRUE(mentions(identify(e, {.states = 4, .lags = 2}).findings,
                       "fewer experiments than the regression has unknowns (10) at steps 20–22"));
}

TEST(Identify, FramesAreAppliedAndNamed) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 20});
  IdentifyOptions options;
  for (const auto& [frame, text] :
       {std::pair{Frame::raw, "raw"}, {Frame::reference, "reference"}, {Frame::smooth, "smooth"}}) {
    options.frame = frame;
    const Identification result = identify(e, options);
    EXPECT_EQ(result.model.frame, text);
    EXPECT_TRUE(kinematically_similar(result.model, oscillator(40), 1e-9).similar);
  }
  options.frame = Frame::reference;
  options.reference_step = 39;
  EXPECT_THROW(identify(e, options), std::invalid_argument);
}

TEST(Identify, ProgressRunsFromZeroToOne) {
  std::vector<double> seen;
  IdentifyOptions options;
  options.execution.progress = [&](const ProgressReport& report) { seen.push_back(report.share); };
  identify(experiments(oscillator(60), {.experiments = 20}), options);
  ASSERT_GT(seen.size(), 10u);
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  EXPECT_EQ(seen.back(), 1.0);
}

// Noisy data, with and without EM, and by one and by two threads: the share never decreases.
TEST(Identify, ProgressOfNoisyDataRisesThroughItsStages) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 20, .process_noise = 0.02, .measurement_noise = 0.05});
  for (const bool refine : {false, true})
    for (const int threads : {1, 2}) {
      std::vector<ProgressReport> seen;
      IdentifyOptions options;
      options.refine = refine;
      options.execution = {threads, [&](const ProgressReport& report) { seen.push_back(report); }};
      identify(e, options);
      ASSERT_GT(seen.size(), 50u);
      std::set<std::string> stages;
      for (size_t i = 1; i < seen.size(); ++i) {
        ASSERT_GE(seen[i].share, seen[i - 1].share) << seen[i - 1].stage << " to " << seen[i].stage;
        stages.insert(seen[i].stage);
      }
      EXPECT_TRUE(stages.contains("choosing lags and lambda") && stages.contains("choosing the number of states"));
      EXPECT_EQ(stages.contains("EM: all experiments"), refine);
      EXPECT_EQ(seen.back().share, 1.0);
    }
}

// The caller gets the subspace model that EM starts from, once, and in the coordinates that were asked for.
TEST(Identify, GivesTheFirstModelBeforeEm) {
  const Ensemble e = experiments(oscillator(40), {.experiments = 30, .process_noise = 0.02, .measurement_noise = 0.05});
  std::vector<Model> first;
  const OnModel keep = [&](Model model) { first.push_back(std::move(model)); };
  IdentifyOptions options;
  options.frame = Frame::smooth;
  const Identification result = identify(e, options, keep);
  ASSERT_EQ(first.size(), 1u);
  EXPECT_EQ(first[0].method, "subspace");
  EXPECT_EQ(first[0].frame, result.model.frame);
  EXPECT_EQ(first[0].provenance.experiments, 30);
  EXPECT_GT(validate(first[0], e).one_step.fit.minCoeff(), 80);
  options.refine = false;
  identify(e, options, keep);
  identify(experiments(oscillator(40), {.experiments = 20}), {}, keep);
  EXPECT_EQ(first.size(), 1u) << "a first model where no EM follows";
}

TEST(Identify, UnitsDoNotMatterWithinTheRangeOfDoublePrecision) {
  const Ensemble e = experiments(oscillator(30), {.experiments = 30});
  const auto scaled = [&](double inputs, double outputs) {
    Ensemble other = e;
    for (Index k = 0; k < 30; ++k) other.input(k) *= inputs, other.output(k) *= outputs;
    return other;
  };
  for (const double inputs : {1e-55, 1e-6, 1e55})
    for (const double outputs : {1e-55, 1e6, 1e55}) {
      const Identification result = identify(scaled(inputs, outputs));
      EXPECT_EQ(result.plan.lags, 2);
      EXPECT_EQ(result.model.states(), 4);
      EXPECT_GT(result.validation.simulation.fit.minCoeff(), 100 - 1e-7);
    }
  EXPECT_NE(message([&] { identify(scaled(1e-200, 1.0)); }).find("input u1: values up to"), std::string::npos);
  EXPECT_NE(message([&] { identify(scaled(1.0, 1e200)); }).find("output y1: values up to"), std::string::npos);
}

TEST(Identify, EveryChannelMayHaveItsOwnUnit) {
  // Two loops of two states that know nothing of each other, the second in micro-units.
  Model system = random_system({4, 2, 2}, 40, 1.0, 110);
  for (size_t k = 0; k < 40; ++k) {
    system.step[k].A().topRightCorner(2, 2).setZero();
    system.step[k].A().bottomLeftCorner(2, 2).setZero();
    system.step[k].B().topRightCorner(2, 1).setZero();
    system.step[k].B().bottomLeftCorner(2, 1).setZero();
    system.step[k].C().topRightCorner(1, 2).setZero();
    system.step[k].C().bottomLeftCorner(1, 2).setZero();
    system.step[k].D() = Matrix(system.step[k].D().diagonal().asDiagonal());
  }
  Random random(111);
  Ensemble noisy = random_experiments(system, 80, 112);
  for (Index k = 0; k < 40; ++k)
    for (Index j = 0; j < 2; ++j)
      noisy.output(k).col(j) += 0.02 * noisy.output(k).col(j).norm() / std::sqrt(80.0) * random.matrix(80, 1);
  Ensemble small = noisy;
  for (Index k = 0; k < 40; ++k) small.output(k).col(1) *= 1e-6, small.input(k).col(0) *= 1e3;
  // EM turns rounding errors into hundredths of a percent; what it starts from does not.
  const IdentifyOptions options{.refine = false};
  const Identification a = identify(noisy, options), b = identify(small, options);
  EXPECT_EQ(a.plan.lags, b.plan.lags);
  EXPECT_EQ(a.model.states(), b.model.states());
  // Scaling by powers of ten rounds, and the choices above are the same: equal fits to many digits.
  EXPECT_LE((a.validation.one_step.fit - b.validation.one_step.fit).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LE((a.validation.simulation.fit - b.validation.simulation.fit).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_GT(b.validation.simulation.fit.minCoeff(), 80);
}

TEST(Identify, InputsThatReachNothingLeaveTheOthersTheirStates) {
  Model system = random_system({4, 2, 2}, 40, 1.0, 113);
  for (Step& step : system.step) step.B().col(1).setZero();
  for (const InitialState state : {InitialState::zero, InitialState::unknown}) {
    const double initial = state == InitialState::zero ? 0.0 : 10.0;
    const Ensemble e = random_experiments(system, 40, 114, initial);
    const Identification result = identify(e);
    EXPECT_EQ(result.model.states(), 4);
    EXPECT_EQ(result.initial_state_test.decision, state);
    const Ensemble fresh = random_experiments(system, 10, 115, initial);
    EXPECT_LE(output_error(fresh, predict(result.model, fresh).y), 1e-9);
    if (state == InitialState::zero) {
      EXPECT_LE(kinematically_similar(result.model, system).max_difference, 1e-9);
    }
  }
  // The same with an input that rests throughout.
  Ensemble rest(40, 40, 2, 2);
  Random random(116);
  for (Index k = 0; k < 40; ++k) rest.input(k) << random.matrix(40, 1), Matrix::Zero(40, 1);
  const Model whole = random_system({4, 2, 2}, 40, 1.0, 117);
  const Identification result = identify(simulate(whole, rest));
  EXPECT_GT(result.validation.simulation.fit.minCoeff(), 100 - 1e-7);
}

TEST(Identify, UnequalLengthsDoNotCollapseTheLagOrder) {
  Ensemble e = random_experiments(random_system({4, 1, 1}, 100, 1.0, 118), 80, 119);
  Random random(120);
  e.length.assign(80, 0);
  for (Index n = 0; n < 80; ++n) {
    const Index length = e.length[size_t(n)] = Index(random.uniform(40, 100));
    for (Index k = length; k < 100; ++k) e.u(n, k, 0) = e.y(n, k, 0) = nan;
  }
  const Identification result = identify(e);
  EXPECT_EQ(result.plan.lags, 4);
  EXPECT_EQ(result.model.states(), 4);
  EXPECT_GT(result.validation.simulation.fit(0), 100 - 1e-6);
}

TEST(Identify, ExactFitsForLackOfFreedomAreNotPraised) {
  Ensemble e = experiments(
      oscillator(40),
      {.experiments = 10, .process_noise = 0.1, .measurement_noise = 0.3, .initial_state = InitialState::unknown});
  EXPECT_TRUE(mentions(identify(e, {.lags = 2, .method = Method::tvera}).findings,
                       "leave no degree of freedom at lag order 2"));
}

TEST(Identify, DependentInputsAreNamed) {
  Ensemble e = experiments(oscillator(40), {.experiments = 30});
  for (Index k = 0; k < 40; ++k) e.input(k).col(1) = 2 * e.input(k).col(0);
  e = simulate(oscillator(40), e);
  EXPECT_TRUE(mentions(identify(e, {.lags = 2}).findings,
                       "inputs u1 and u2 move together (u1 - 0.5 u2 is zero) in every experiment at steps 0–39"));
}

TEST(Identify, FreeResponsesOfAMovingRigAreDepartures) {
  const Model system = oscillator(50);
  Ensemble e = experiments(system, {.experiments = 20, .free_responses = 6});
  for (Index k = 0; k < 50; ++k) {
    e.output(k).array() += 20 * std::cos(0.1 * double(k));
    e.free.y.middleCols(2 * k, 2).array() += 7 * std::cos(0.1 * double(k));
  }
  e.free.y(2, 3) = nan;  // costs its experiment and no other
  const Identification result = identify(e);
  EXPECT_EQ(result.model.full_begin(), 0);
  EXPECT_TRUE(kinematically_similar(result.model, system, 1e-9).similar);
  e.free = {1, 50, e.free.y.topRows(1)};
  EXPECT_TRUE(mentions(identify(e).findings, "a single free response"));
  Ensemble few = experiments(system, {.experiments = 20, .free_responses = 2});
  EXPECT_TRUE(mentions(identify(few).findings, "the 2 free responses show all 4 states only from step"));
}

TEST(Identify, OutputsThatDoNotAnswerHaveNoStates) {
  Ensemble e(12, 10, 1, 1);
  Random random(8);
  for (Index k = 0; k < 10; ++k) e.input(k) = random.matrix(12, 1), e.output(k) = 2.0 * e.input(k);
  const Identification result = identify(e, {.lags = 1});
  EXPECT_EQ(result.model.states(), 0);
  EXPECT_TRUE(mentions(result.findings, "no state was found"));
  EXPECT_NEAR(result.model.step[5].D()(0, 0), 2.0, 1e-12);
  for (Index k = 0; k < 10; ++k) e.output(k).setZero();
  EXPECT_NO_THROW(identify(e, {.lags = 1}));
}

}  // namespace
}  // namespace tokid::testing
