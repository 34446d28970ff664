// SPDX-License-Identifier: BSD-3-Clause
// Dead times: the states that hold delayed inputs, and the choice of dead times.
#include "choose/input_delays.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "model/input_delays.hpp"
#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing::input_delays {
namespace {

// y of a plant of two states behind dead times, with white inputs. `variation`: of its frequency over time. `weak`: the
// effect of the last of several inputs, relative to the others.
Ensemble plant(Index experiments, Index steps, const std::vector<Index>& delays, double noise, std::uint64_t seed,
               double variation = 0.2, double weak = 1.0) {
  RandomNumbers random(seed);
  const Index r = Index(delays.size());
  Ensemble e(experiments, steps, r, 2);
  for (Index k = 0; k < steps; ++k)
    for (Index n = 0; n < experiments; ++n)
      for (Index i = 0; i < r; ++i) e.u(n, k, i) = random.normal();
  Ensemble v = delayed(e, delays);
  for (Index k = 0; k < steps; ++k) v.input(k).col(r - 1) *= weak;
  Matrix x = Matrix::Zero(experiments, 2);
  for (Index k = 0; k < steps; ++k) {
    e.output(k) = x;
    const double turn = 0.3 + variation * std::sin(6.28 * double(k) / double(steps));
    const Matrix before = x;
    x.col(0) = 0.8 * before.col(0) - turn * before.col(1) + v.input(k).rowwise().sum();
    x.col(1) = turn * before.col(0) + 0.7 * before.col(1) + 0.5 * v.input(k).col(0);
    for (Index n = 0; n < experiments; ++n)
      for (Index j = 0; j < 2; ++j) e.y(n, k, j) += noise * random.normal();
  }
  e.initial_state = InitialState::zero;
  return e;
}

TEST(InputDelays, HeldInputsGiveTheOutputsOfDelayedOnes) {
  for (const std::vector<Index>& delays : {std::vector<Index>{0, 3, 0}, {1, 0, 7}, {4, 2, 5}}) {
    RandomNumbers random(3);
    const Model model = random_system(SystemSize{4, 2, 3}, 12, 0.9, 3);
    Ensemble inputs(5, 12, 3, 2);
    for (Index k = 0; k < 12; ++k)
      for (Index n = 0; n < 5; ++n)
        for (Index i = 0; i < 3; ++i) inputs.u(n, k, i) = random.normal();
    inputs.initial_state = InitialState::zero;
    const Model undelayed = of_undelayed(model, delays);
    undelayed.check();
    EXPECT_EQ(undelayed.states(), model.states() + held_inputs(delays));
    const Matrix expected = simulate(model, delayed(inputs, delays)).samples();
    const Ensemble found = simulate(undelayed, inputs);
    for (Index k = 0; k < 12; ++k) {
      const auto y = expected.middleCols(k * 5 + 3, 2);
      // Rounding errors of 12 products of matrices of 4 states.
      EXPECT_LT((found.output(k) - y).norm(), 12 * 4 * epsilon * expected.norm());
    }
  }
}

TEST(InputDelays, HeldInputsAreNoUnknownsOfAnEstimate) {
  const std::vector<Index> delays{10, 10, 10};
  Model model = of_undelayed(random_system(SystemSize{4, 2, 3}, 40, 0.9, 3), delays);
  model.provenance.choices.emplace().delays = delays;
  const Index window = estimation_window(model);
  EXPECT_EQ(window, 12);
  Ensemble inputs(5, 40, 3, 2);
  RandomNumbers random(4);
  for (Index k = 0; k < 40; ++k)
    for (Index n = 0; n < 5; ++n)
      for (Index i = 0; i < 3; ++i) inputs.u(n, k, i) = random.normal();
  inputs.initial_state = InitialState::zero;
  Ensemble measured = simulate(model, inputs);
  measured.initial_state = model.initial_state = InitialState::unknown;
  const Prediction found = predict(model, measured);
  double size = 0.0;
  for (Index k = 0; k < 40; ++k) size = std::max(size, measured.output(k).norm());
  for (Index k = window; k < 40; ++k) EXPECT_LT((found.y.output(k) - measured.output(k)).norm(), 1e-9 * size) << k;
}

// A regression of five lags may begin a little before the response.
TEST(InputDelays, AreFoundForEachInput) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const std::vector<Index>& delays : {std::vector<Index>{9}, {0, 23}, {16, 6}, {5, 0, 12}}) {
      const std::vector<Index> found = find_delays(plant(40, 120, delays, 0.1, seed), {});
      ASSERT_EQ(found.size(), delays.size());
      for (size_t i = 0; i < delays.size(); ++i) {
        EXPECT_LE(found[i], delays[i]);
        EXPECT_GE(found[i], delays[i] - 2);
      }
    }
}

// A lag too many costs unknowns, one too few an effect of the input: most are exact, and none is late. Of several
// inputs, each hides the dead times of the others.
TEST(InputDelays, AreMostlyExactAlmostWithoutNoise) {
  Index exact = 0, all = 0;
  for (const std::uint64_t seed : {1, 2, 3, 4, 5})
    for (const std::vector<Index>& delays : {std::vector<Index>{12}, {11, 11, 11}, {12, 8, 12, 7}}) {
      const std::vector<Index> found = find_delays(plant(24, 120, delays, 1e-5, seed), {});
      ASSERT_EQ(found.size(), delays.size());
      for (size_t i = 0; i < delays.size(); ++i) {
        EXPECT_LE(found[i], delays[i]);
        exact += found[i] == delays[i];
        ++all;
      }
    }
  EXPECT_GE(3 * exact, 2 * all);
}

// An input of little effect shows its dead time only beside an input with the same one. Without that, it has none.
TEST(InputDelays, OfWeakInputsAreThoseOfOthers) {
  Index found = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const std::vector<Index> same = find_delays(plant(12, 80, {9, 9}, 0.5, seed, 0.2, 0.2), {}),
                             none = find_delays(plant(12, 80, {9, 0}, 0.5, seed, 0.2, 0.2), {});
    ASSERT_EQ(none.size(), 2u);
    EXPECT_EQ(none[1], 0) << seed;
    found += same.size() == 2 && same[1] >= 7;
  }
  EXPECT_GE(found, 18);
}

// The lags of an input end with those whose products are known.
TEST(InputDelays, AreSharedUpToTheLargestOne) {
  for (const Index delay : {34, 35, 36, 37, 38, 39}) {
    const std::vector<Index> found = find_delays(plant(12, 80, {delay, 0}, 0.01, 3), {});
    EXPECT_TRUE(found.empty() || found[1] == 0) << delay;
  }
}

TEST(InputDelays, AreNotFoundWhereThereAreNone) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6}) {
    EXPECT_TRUE(find_delays(plant(40, 120, {0}, 0.1, seed), {}).empty());
    EXPECT_TRUE(find_delays(plant(12, 60, {0, 0}, 1.0, seed), {}).empty());
    EXPECT_TRUE(find_delays(plant(40, 120, {2, 1}, 0.1, seed), {}).empty());
    EXPECT_TRUE(find_delays(plant(3, 20, {0, 0}, 0.1, seed), {}).empty());
    EXPECT_TRUE(
        find_delays(experiments(oscillator(60), {.experiments = 30, .seed = seed, .measurement_noise = 0.1}), {})
            .empty());
  }
}

TEST(InputDelays, MakeAModelOfFewStates) {
  const Identification found = identify(plant(40, 120, {14}, 0.1, 4));
  EXPECT_EQ(found.plan.choices.delays, std::vector<Index>{14});
  EXPECT_EQ(found.model.states(), 16);
  ASSERT_TRUE(found.model.provenance.choices);
  EXPECT_EQ(found.model.provenance.choices->delays, std::vector<Index>{14});
  // The errors of a fresh simulation are small beside the noise.
  const Ensemble fresh = plant(20, 120, {14}, 0.0, 5);
  const Matrix error = simulate(found.model, fresh).samples() - fresh.samples();
  EXPECT_LT(std::sqrt(error.squaredNorm() / double(20 * 120 * 2)), 0.1 * 0.3);
}

TEST(InputDelays, MayBeStated) {
  const Ensemble data = plant(40, 120, {14}, 0.1, 4);
  // The states of the plant then hold two more inputs.
  const auto with = [&](std::vector<Index> delays, Index states) {
    return identify(data, {.states = states, .lags = 4, .smoothing = 100.0, .delays = delays, .refine = false});
  };
  EXPECT_EQ(with({12}, 16).plan.choices.delays, std::vector<Index>{12});
  const Identification none = identify(data, {.smoothing = 100.0, .delays = std::vector<Index>{}, .refine = false});
  EXPECT_TRUE(none.plan.choices.delays.empty());
  EXPECT_EQ(with({14}, 16).model.states(), 16);
  EXPECT_THROW(identify(data, {.delays = std::vector<Index>{1, 2}}), std::invalid_argument);
  EXPECT_THROW(identify(data, {.delays = std::vector<Index>{120}}), std::invalid_argument);
  EXPECT_THROW(identify(data, {.states = 14, .delays = std::vector<Index>{14}}), std::invalid_argument);
}

// Experiments are examined by regressions that must see the delayed inputs.
TEST(InputDelays, HideNoExperimentThatDoesNotFit) {
  Ensemble data = plant(40, 120, {14}, 0.1, 6);
  for (Index k = 0; k < 120; ++k) data.y(7, k, 0) *= -1;
  const Identification noisy = identify(data, {.refine = false});
  ASSERT_FALSE(noisy.plan.choices.delays.empty());
  ASSERT_EQ(noisy.outliers.size(), 1u);
  EXPECT_EQ(noisy.outliers.front().experiment, 7);
  const Identification exact =
      identify(plant(40, 30, {5}, 0.0, 6), {.method = Method::tvera, .delays = std::vector<Index>{5}});
  EXPECT_TRUE(exact.outliers.empty());
}

TEST(InputDelays, OfEarlierChoicesAreChecked) {
  const Ensemble data = plant(40, 60, {14}, 0.1, 4);
  const NoisyChoices choices = identify(data, {.refine = false}).plan.choices;
  for (const std::vector<Index>& wrong : {std::vector<Index>{3, 3}, {-1}, {60}}) {
    NoisyChoices other = choices;
    other.delays = wrong;
    EXPECT_THROW(identify(data, {.states = 16, .lags = 4, .choices = other}), std::invalid_argument);
  }
  EXPECT_EQ(identify(data, {.states = 16, .lags = 4, .choices = choices}).plan.choices.delays, choices.delays);
}

TEST(InputDelays, AreExactWithoutNoise) {
  const Ensemble data = plant(40, 30, {5}, 0.0, 6), fresh = plant(3, 30, {5}, 0.0, 7);
  const Identification found = identify(data, {.method = Method::tvera, .delays = std::vector<Index>{5}});
  EXPECT_EQ(found.model.states(), 7);
  const Matrix error = simulate(found.model, fresh).samples() - fresh.samples();
  // As for other exact recoveries: the condition of the regressions times rounding errors.
  EXPECT_LT(error.cwiseAbs().maxCoeff(), 1e-9 * fresh.samples().cwiseAbs().maxCoeff());
}

TEST(InputDelays, OfOneModelForAllStepsPredictFromUnknownStates) {
  const Ensemble all = plant(1, 1500, {11}, 0.1, 8, 0.0), fresh = plant(4, 200, {11}, 0.1, 9, 0.0);
  Ensemble data = all;
  data.initial_state = InitialState::unknown;
  const Identification found = identify(data, {.period = 1});
  EXPECT_EQ(found.plan.choices.delays, std::vector<Index>{11});
  const Ensemble predicted = predict(found.model, fresh, {.initial_state = InitialState::unknown}).y;
  EXPECT_TRUE(predicted.output(199).allFinite());
}

}  // namespace
}  // namespace tokid::testing::input_delays
