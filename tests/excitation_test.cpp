// SPDX-License-Identifier: BSD-3-Clause
#include "excitation.hpp"

#include <gtest/gtest.h>

#include "combination.hpp"
#include "repeats.hpp"
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

TEST(Combination, IsWrittenWithTheFirstChannelAlone) {
  EXPECT_EQ(sum_text({{"u1", 2.0}, {"u3", -4.0}}), "u1 - 2 u3");
  EXPECT_EQ(sum_text({{"a", -1.0}, {"b", -1.0}, {"c", 0.25}}), "a + b - 0.25 c");
}

Ensemble inputs(Index r, Index experiments = 30, Index steps = 20) {
  return random_experiments(random_system({2, 2, r}, steps, 0.9, 1), experiments, 2);
}

TEST(Excitation, NothingIsSaidOfInputsOnTheirOwn) {
  for (const Index r : {1, 2, 4}) EXPECT_EQ(excitation(inputs(r), {.lags = 3}).warnings, Texts{});
  EXPECT_EQ(warnings_of_dependent_outputs(inputs(2)), Texts{});
}

TEST(Excitation, InputsThatMoveTogetherAreNamedWithTheirSteps) {
  Ensemble e = inputs(3);
  e.names.input_names = {"left", "right", "both"};
  for (Index k = 5; k < 12; ++k) e.input(k).col(2) = e.input(k).col(0) + 0.5 * e.input(k).col(1);
  const Excitation found = excitation(e, {.lags = 2});
  EXPECT_EQ(found.warnings,
            (Texts{"inputs left, right and both move together (left + 0.5 right - both is zero) in every "
                   "experiment at steps 5–11: their effects there can't be told apart"}));
  EXPECT_EQ(found.named, (std::vector<Index>{5, 6, 7, 8, 9, 10, 11}));
}

TEST(Excitation, CombinationsThatChangeAreOneWarning) {
  Ensemble e = inputs(2);
  for (Index k = 0; k < 20; ++k) e.input(k).col(1) = (2.0 + double(k)) * e.input(k).col(0);
  EXPECT_EQ(
      excitation(e, {.lags = 2}).warnings,
      (Texts{"inputs u1 and u2 move together (a combination of u1 and u2 that changes from step to step is zero) in "
             "every experiment at steps 0–19: their effects there can't be told apart"}));
}

TEST(Excitation, InputsThatFollowFromWhatWasBefore) {
  Ensemble held = inputs(1);
  for (Index k = 0; k < 20; ++k)
    if (k % 4 > 0) held.input(k) = Matrix(held.input(k - 1));
  EXPECT_EQ(excitation(held, {.lags = 2}).warnings,
            (Texts{"input u1 follows from inputs before it (u1(k) - u1(k-1) is zero) in every experiment at steps 1–3, "
                   "5–7, 9–11, 13–15 and 17–19: its effect there can't be told from theirs"}));
  Ensemble fed = inputs(1);
  for (Index k = 3; k < 20; ++k) fed.input(k) = 0.5 * fed.output(k - 1).col(1);
  EXPECT_EQ(
      excitation(fed, {.lags = 2}).warnings,
      (Texts{"input u1 follows from the samples before it (u1(k) - 0.5 y2(k-1) is zero) in every experiment at "
             "steps 3–19: a feedback without a variation of its own, whose effect there can't be told from theirs"}));
}

TEST(Excitation, OfOneRecord) {
  Ensemble e(1, 300, 1, 1);
  Random random(3);
  for (Index k = 0; k < 300; ++k) {
    e.u(0, k, 0) = std::cos(0.5 * double(k));
    e.y(0, k, 0) = random.normal();
  }
  EXPECT_EQ(
      excitation(e, {.lags = 4, .period = 1, .centred = false}).warnings,
      (Texts{"input u1 follows from inputs before it (u1(k) - 1.76 u1(k-1) + u1(k-2) is zero) all along: its effect "
             "there can't be told from theirs"}));
  for (Index k = 0; k < 300; ++k) e.u(0, k, 0) = random.normal();
  EXPECT_EQ(excitation(e, {.lags = 4, .period = 1, .centred = false}).warnings, Texts{});
}

TEST(Excitation, OutputsThatMoveTogetherOrRest) {
  Ensemble e = inputs(2);
  for (Index k = 0; k < 20; ++k) e.output(k).col(1) = 3.0 - 2 * e.output(k).col(0).array();
  EXPECT_EQ(warnings_of_dependent_outputs(e),
            (Texts{"outputs y1 and y2 move together (y1 + 0.5 y2 is constant) at all steps: y2 says nothing that the "
                   "others don't"}));
  e = inputs(2);
  for (Index k = 0; k < 20; ++k) {
    if (k < 3 || k == 7) e.output(k).col(0).setConstant(1.0);  // the first steps may well be at rest
    if (k > 10) e.y(4, k, 1) = e.y(4, 10, 1) = 2.5;
  }
  EXPECT_EQ(
      warnings_of_dependent_outputs(e),
      (Texts{"output y1 is the same in every experiment at step 7: nothing can be identified of it there",
             "output y2 stays at 2.5 in experiment 4 at steps 10–19, which it does nowhere else: is its sensor stuck "
             "there?"}));
}

TEST(Repeats, AreCountedOnce) {
  Ensemble e = inputs(1, 10);
  EXPECT_EQ(warnings_of(repeats(e), 10, 0, 1), Texts{});
  for (const auto& [from, to] : {std::pair<Index, Index>{3, 7}, {3, 9}, {0, 1}})
    e.samples().row(to) = Matrix(e.samples().row(from));
  Repeats found = repeats(e);
  EXPECT_EQ(found.same, (std::vector<std::vector<Index>>{{0, 1}, {3, 7, 9}}));
  EXPECT_EQ(found.different, 7);
  EXPECT_EQ(warnings_of(found, 10, 8, 2),
            (Texts{"experiments 0 and 1 are the same in every sample, and so are 3, 7 and 9: 7 of 10 experiments are "
                   "different, the others add nothing; 8 needed at lag order 2"}));
  e.y(7, 19, 1) = std::nextafter(e.y(7, 19, 1), 1e9);  // the last sample
  EXPECT_EQ(repeats(e).same, (std::vector<std::vector<Index>>{{0, 1}, {3, 9}}));
  EXPECT_EQ(repeats(e).courses, 7);
}

}  // namespace
}  // namespace tokid::testing
