// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/excitation.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "diagnose/combination.hpp"
#include "testing.hpp"

namespace tokid::testing {
namespace {

using Texts = std::vector<std::string>;

TEST(Combination, HasAsFewTermsAsItTakes) {
  Random random(1);
  Matrix a = random.matrix(50, 6);
  a.col(3) *= 1e-8;  // another unit
  EXPECT_FALSE(combination(a, random.matrix(50, 1), false));
  const auto found = combination(a, Vector(2 * a.col(1) - 1e9 * a.col(3)), false);
  ASSERT_TRUE(found);
  ASSERT_EQ(found->terms.size(), 2u);
  EXPECT_EQ(found->terms[0].column, 1);
  EXPECT_NEAR(found->terms[0].factor, 2, 1e-12);
  EXPECT_NEAR(found->terms[1].factor, -1e9, 1);
  EXPECT_FALSE(combination(a, Vector(a.col(1).array() + 3), false));
  EXPECT_TRUE(combination(a, Vector(a.col(1).array() + 3), true)->constant);
  EXPECT_FALSE(combination(a.topRows(7), Vector(a.col(1).head(7)), false));  // any target would do
}

Ensemble inputs(Index r, Index experiments = 30, Index steps = 20) {
  return random_experiments(random_system({2, 2, r}, steps, 0.9, 1), experiments, 2);
}

TEST(Excitation, NothingIsSaidOfInputsOnTheirOwn) {
  for (const Index r : {1, 2, 4}) EXPECT_EQ(in_words(excitation(inputs(r), {.lags = 3}).findings), Texts{});
  EXPECT_EQ(in_words(findings_of_dependent_outputs(inputs(2))), Texts{});
}

TEST(Excitation, InputsThatMoveTogetherAreNamedWithTheirSteps) {
  Ensemble e = inputs(3);
  e.names.input_names = {"left", "right", "both"};
  for (Index k = 5; k < 12; ++k) e.input(k).col(2) = e.input(k).col(0) + 0.5 * e.input(k).col(1);
  const Excitation found = excitation(e, {.lags = 2});
  EXPECT_EQ(in_words(found.findings),
            (Texts{"inputs left, right and both move together (left + 0.5 right - both is zero) in every "
                   "experiment at steps 5–11: their effects at these steps can't be separated from each other"}));
  EXPECT_EQ(found.named, (std::vector<Index>{5, 6, 7, 8, 9, 10, 11, 12, 13}));  // windows of two lags more
}

TEST(Excitation, CombinationsThatChangeAreOneWarning) {
  Ensemble e = inputs(2);
  for (Index k = 0; k < 20; ++k) e.input(k).col(1) = (2.0 + double(k)) * e.input(k).col(0);
  EXPECT_EQ(
      in_words(excitation(e, {.lags = 2}).findings),
      (Texts{
          "inputs u1 and u2 move together (a weighted sum of u1 and u2, with weights that change from step to step, is zero) in "
          "every experiment at steps 0–19: their effects at these steps can't be separated from each other"}));
}

TEST(Excitation, InputsThatFollowFromWhatWasBefore) {
  Ensemble held = inputs(1);
  for (Index k = 0; k < 20; ++k)
    if (k % 4 > 0) held.input(k) = Matrix(held.input(k - 1));
  EXPECT_EQ(
      in_words(excitation(held, {.lags = 2}).findings),
      (Texts{
          "input u1 is determined by earlier inputs (u1(k) - u1(k-1) is zero) in every experiment at steps 1–3, "
          "5–7, 9–11, 13–15 and 17–19: its effect at these steps can't be separated from the effects of the earlier inputs"}));
  Ensemble fed = inputs(1);
  for (Index k = 3; k < 20; ++k) fed.input(k) = 0.5 * fed.output(k - 1).col(1);
  EXPECT_EQ(
      in_words(excitation(fed, {.lags = 2}).findings),
      (Texts{
          "input u1 is determined by the samples before it (u1(k) - 0.5 y2(k-1) is zero) in every experiment at "
          "steps 3–19. The input is a feedback without independent variation, so its effect at these steps can't be separated from the effects of these samples. Add an independent variation to the input"}));
}

TEST(Excitation, OfOneRecord) {
  Ensemble e(1, 300, 1, 1);
  Random random(3);
  for (Index k = 0; k < 300; ++k) {
    e.u(0, k, 0) = std::cos(0.5 * double(k));
    e.y(0, k, 0) = random.normal();
  }
  EXPECT_EQ(
      in_words(excitation(e, {.lags = 4, .period = 1, .centred = false}).findings),
      (Texts{
          "input u1 is determined by earlier inputs (u1(k) - 1.76 u1(k-1) + u1(k-2) is zero: the input consists of one frequency, but lag order 4 needs 5) at every step: its effect at these steps can't be separated from the effects of the earlier inputs"}));
  for (Index k = 0; k < 300; ++k) e.u(0, k, 0) = random.normal();
  EXPECT_EQ(in_words(excitation(e, {.lags = 4, .period = 1, .centred = false}).findings), Texts{});
}

TEST(Excitation, OutputsThatMoveTogetherOrRest) {
  Ensemble e = inputs(2);
  for (Index k = 0; k < 20; ++k) e.output(k).col(1) = 3.0 - 2 * e.output(k).col(0).array();
  EXPECT_EQ(
      in_words(findings_of_dependent_outputs(e)),
      (Texts{"outputs y1 and y2 move together (y1 + 0.5 y2 is constant) at all steps: output y2 adds no information to "
             "the other outputs"}));
  e = inputs(2);
  for (Index k = 0; k < 20; ++k) {
    if (k < 3 || k == 7) e.output(k).col(0).setConstant(1.0);  // the first steps may well be at rest
    if (k > 10) e.y(4, k, 1) = e.y(4, 10, 1) = 2.5;
  }
  EXPECT_EQ(
      in_words(findings_of_dependent_outputs(e)),
      (Texts{
          "output y1 is the same in every experiment at step 7: nothing about this output can be identified at these steps"}));
  EXPECT_EQ(
      in_words(stuck_outputs(e).findings),
      (Texts{
          "output y2 stays at 2.5 in experiment 4 at steps 10–19, while the inputs of this experiment move. Check whether the sensor of this output was stuck"}));
}

// What nothing is wrong with, and what chance makes of few experiments.
TEST(Excitation, NothingIsSaidOfOutputsThatFollowFromTheirInputs) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const SystemSize size : {SystemSize{2, 1, 1}, {2, 2, 2}}) {
      const Ensemble e = random_experiments(constant_system(size, 40, 0.85, seed), 40, seed);
      Ensemble single = e;
      single.samples() = Matrix(e.samples()).cast<float>().cast<double>();
      for (const Index lags : {2, 4}) {
        EXPECT_EQ(in_words(excitation(single, {.lags = lags, .noisy = true}).findings), Texts{}) << "single precision";
        EXPECT_EQ(in_words(excitation(single, {.lags = lags, .period = 1, .noisy = true}).findings), Texts{})
            << "time-invariant";
        for (const double noise : {1e-8, 1e-7, 1e-6})
          EXPECT_EQ(in_words(excitation(with_noise(e, noise, seed), {.lags = lags, .noisy = true}).findings), Texts{})
              << noise;
      }
    }
}

TEST(Excitation, FeedbackOfTheSameStepIsSeen) {
  Ensemble fed = with_noise(random_experiments(random_system({2, 2, 1}, 20, 0.9, 1), 40, 2), 0.1, 3);
  for (Index k = 3; k < 20; ++k) fed.input(k) = 0.5 * fed.output(k).col(0) - fed.output(k).col(1);
  const Texts found = in_words(excitation(fed, {.lags = 2, .noisy = true}).findings);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NE(found.front().find(
                "(u1(k) - 0.5 y1(k) + y2(k) is zero) in every experiment at steps 3–19. The input is a feedback"),
            std::string::npos)
      << found.front();
}

Ensemble binary(Index experiments, Index steps, Index r, std::uint64_t seed) {
  Ensemble e = random_experiments(random_system({2, 1, r}, steps, 0.8, seed), experiments, seed);
  for (Index k = 0; k < steps; ++k) e.input(k) = Matrix(e.input(k)).array().sign();
  return with_noise(simulate(random_system({2, 1, r}, steps, 0.8, seed), e, Matrix::Zero(2, experiments)), 0.05, seed);
}

TEST(Excitation, ChanceOfFewExperimentsIsNoWarning) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    EXPECT_EQ(in_words(excitation(binary(5, 150, 2, seed), {.lags = 1, .noisy = true}).findings), Texts{});
    EXPECT_EQ(in_words(excitation(binary(8, 300, 1, seed), {.lags = 1, .noisy = true}).findings), Texts{});
    EXPECT_EQ(in_words(excitation(binary(6, 150, 3, seed), {.lags = 1, .noisy = true}).findings), Texts{});
  }
  // What holds at all steps is none.
  Ensemble e = binary(5, 150, 2, 1);
  for (Index k = 0; k < 150; ++k) e.input(k).col(1) = -e.input(k).col(0);
  const Texts found = in_words(excitation(e, {.lags = 1, .noisy = true}).findings);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.front().find("inputs u1 and u2 move together (u1 + u2 is zero) in every experiment at steps 0"), 0u);
}

TEST(Excitation, FactorsAreTheSameWhateverTheirLastDigit) {
  for (const double factor : {1.125, 1.0005, 0.3335}) {
    Ensemble e = inputs(2);
    for (Index k = 0; k < 20; ++k) e.input(k).col(0) = factor * e.input(k).col(1);
    const Texts found = in_words(excitation(e, {.lags = 2}).findings);
    ASSERT_EQ(found.size(), 1u) << factor;
    EXPECT_EQ(found.front().find("changes"), std::string::npos) << found.front();
    e = inputs(2);
    for (Index k = 0; k < 20; ++k) e.output(k).col(0) = factor * e.output(k).col(1);
    EXPECT_EQ(findings_of_dependent_outputs(e).size(), 1u) << factor;
  }
}

TEST(Excitation, HeldInputsAreOneWarning) {
  Ensemble e = inputs(2, 40, 60);
  for (Index k = 0; k < 60; ++k)
    if (k % 4 > 0) e.input(k) = Matrix(e.input(k - 1));
  std::vector<Index> suspects;
  for (Index k = 6; k < 60; ++k) suspects.push_back(k);  // six lags hold steps that are held
  const Excitation found = excitation(e, {.lags = 6, .dependent_steps = suspects});
  EXPECT_EQ(found.findings.size(), 2u);  // one for each input
  for (const Index k : suspects) EXPECT_TRUE(std::binary_search(found.named.begin(), found.named.end(), k)) << k;
}

TEST(Excitation, ASumOfSinesIsCounted) {
  Ensemble e(1, 400, 1, 1);
  e.samples().setZero();
  Random random(3);
  for (Index k = 0; k < 400; ++k) {
    for (const double frequency : {0.3, 0.8, 1.5}) e.u(0, k, 0) += std::cos(frequency * double(k));
    e.y(0, k, 0) = random.normal();
  }
  EXPECT_EQ(
      in_words(excitation(e, {.lags = 8, .period = 1, .centred = false}).findings),
      (Texts{
          "input u1 is determined by earlier inputs (a weighted sum of u1(k) and u1(k-1…6) is zero: the input consists of 3 frequencies, but lag order 8 needs 9) at every step: its effect at these steps can't be separated from the effects of the earlier inputs"}));
}

TEST(Excitation, OutputsThatRestWithTheirInputsAreNotStuck) {
  // A baseline from the zero state, and one that moves late.
  Ensemble e = inputs(2, 30, 60);
  for (Index k = 0; k < 60; ++k) {
    e.input(k).row(4).setZero();
    e.output(k).row(4).setZero();
    if (k < 30) e.input(k).row(9).setZero(), e.output(k).row(9).setZero();
  }
  EXPECT_EQ(in_words(findings_of_dependent_outputs(e)), Texts{});
  EXPECT_EQ(in_words(stuck_outputs(e).findings), Texts{});
  // Outputs in steps of their sensors, that come to rest where the inputs do.
  Ensemble coarse = random_experiments(constant_system({2, 1, 1}, 80, 0.7, 1), 20, 1);
  for (Index k = 30; k < 60; ++k) coarse.input(k).row(3).setZero();
  coarse = simulate(constant_system({2, 1, 1}, 80, 0.7, 1), coarse, Matrix::Zero(2, 20));
  coarse.samples() = ((coarse.samples() / 0.2).array().round() * 0.2).matrix().eval();
  EXPECT_EQ(in_words(findings_of_dependent_outputs(coarse)), Texts{});
  EXPECT_EQ(in_words(stuck_outputs(coarse).findings), Texts{});
}

TEST(Excitation, StuckSensorsDoNotHideEachOther) {
  Ensemble e = inputs(2);
  for (const Index n : {4, 11})
    for (Index k = 10; k < 20; ++k) e.y(n, k, 1) = e.y(n, 9, 1);
  EXPECT_EQ(stuck_outputs(e).experiments, (std::vector<Index>{4, 11}));
}

TEST(Excitation, CoarseOutputsCoincideByChance) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    Ensemble e = random_experiments(constant_system({2, 1, 1}, 200, 0.8, seed), 3, seed);
    e.samples() = ((e.samples() / 0.2).array().round() * 0.2).matrix().eval();
    EXPECT_EQ(in_words(findings_of_dependent_outputs(e)), Texts{}) << seed;
    EXPECT_EQ(in_words(stuck_outputs(e).findings), Texts{}) << seed;
  }
}

}  // namespace
}  // namespace tokid::testing
