// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/recording.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "noisy.hpp"
#include "testing.hpp"

namespace tokid::testing {
namespace {

Ensemble runs(Index count, std::uint64_t seed) {
  return noisy_experiments(constant_system({2, 2, 2}, 80, 0.9, seed), count, seed);
}

// Fills the samples from step `begin` on with zeros, or with the samples of the step before.
void fill_end(Ensemble& e, Index n, Index begin, bool hold) {
  const Index d = e.channels();
  for (Index k = begin; k < e.steps(); ++k)
    for (Index c = 0; c < d; ++c) e.samples()(n, k * d + c) = hold ? e.samples()(n, (begin - 1) * d + c) : 0.0;
}

std::vector<Index> early(const Ensemble& e) {
  std::vector<Index> rows;
  for (const Finding& f : findings_of_recording(e))
    if (f.kind == Finding::Kind::experiments_end_early)
      for (const Finding::Experiment& experiment : f.experiments) rows.push_back(experiment.row);
  return rows;
}

Index wraps(const Ensemble& e) {
  Index count = 0;
  for (const Finding& f : findings_of_recording(e)) count += f.kind == Finding::Kind::angle_wraps;
  return count;
}

TEST(Recording, RunsThatWereFilledAreFound) {
  for (const bool hold : {false, true})
    for (const Index count : {2, 20}) {
      Ensemble e = runs(count, 1);
      EXPECT_TRUE(early(e).empty());
      fill_end(e, 1, 50, hold);
      ASSERT_EQ(early(e), std::vector<Index>{1}) << hold << ' ' << count;
      EXPECT_EQ(findings_of_recording(e).front().steps, std::vector<Index>{hold ? 49 : 50});
    }
}

TEST(Recording, AlsoIfMostRunsWereFilled) {
  Ensemble e = runs(20, 2);
  for (Index n = 1; n < 20; ++n) fill_end(e, n, 40 + n, false);
  EXPECT_EQ(early(e).size(), 19u);
}

TEST(Recording, AlsoWithOutputsAtEverySecondStep) {
  Ensemble e = runs(10, 3);
  for (Index k = 1; k < e.steps(); k += 2) e.output(k).setConstant(std::nan(""));
  EXPECT_TRUE(early(e).empty());
  for (Index k = 50; k < e.steps(); ++k) {
    e.input(k).row(4).setZero();
    if (k % 2 == 0) e.output(k).row(4).setZero();
  }
  EXPECT_EQ(early(e), std::vector<Index>{4});
}

// The inputs stop before the outputs do.
TEST(Recording, AtRestNothingWasFilled) {
  for (const double resolution : {0.0, 0.05}) {
    Ensemble e(6, 80, 1, 1);
    for (Index n = 0; n < 6; ++n)
      for (Index k = 0; k < 10; ++k) e.u(n, k, 0) = 1 + double(n) + std::sin(double(k * n));
    e = simulate(constant_system({2, 1, 1}, 80, 0.5, 4), e);
    if (resolution > 0)
      for (Index k = 0; k < 80; ++k) e.output(k) = (e.output(k).array() / resolution).round().matrix() * resolution;
    EXPECT_TRUE(early(e).empty()) << resolution;
  }
}

TEST(Recording, AnOutputThatFailsIsNoEnd) {
  Ensemble e = runs(10, 5);
  for (Index k = 40; k < e.steps(); ++k) e.input(k).rowwise() = Eigen::RowVector2d(1.0, 2.0);
  for (Index k = 60; k < e.steps(); ++k) e.output(k).row(3).setConstant(std::nan(""));
  EXPECT_TRUE(early(e).empty());
}

TEST(Recording, AnglesBetweenTwoLimitsAreFound) {
  for (const double turn : {2 * std::numbers::pi, 360.0}) {
    Ensemble e(5, 100, 1, 2);
    for (Index n = 0; n < 5; ++n)
      for (Index k = 0; k < 100; ++k) {
        e.u(n, k, 0) = double(n) * double(k);
        const double angle = turn * (0.011 * double(k) + 0.02 * std::sin(double(k * (n + 1))));
        e.y(n, k, 0) = angle;
        e.y(n, k, 1) = angle - turn * std::round(angle / turn);
      }
    const Findings found = findings_of_recording(e);
    ASSERT_EQ(found.size(), 1u) << turn;
    EXPECT_EQ(found.front().kind, Finding::Kind::angle_wraps);
    EXPECT_EQ(found.front().channels.front().index, 1);
    EXPECT_DOUBLE_EQ(found.front().numbers.at("turn"), turn);
    EXPECT_GE(found.front().numbers.at("count"), 5);
  }
}

TEST(Recording, OtherJumpsAreNoTurns) {
  Ensemble e(5, 100, 1, 3);
  Random random(6);
  for (Index n = 0; n < 5; ++n)
    for (Index k = 0; k < 100; ++k) {
      e.u(n, k, 0) = random.normal();
      e.y(n, k, 0) = k / 10 % 2 == 0 ? 3.1 : -3.1;                       // a switch
      e.y(n, k, 1) = std::clamp(2 * random.normal(), -3.14, 3.14);       // noise that fills the turn
      e.y(n, k, 2) = 170 * std::sin(0.3 * double(k)) + random.normal();  // an angle that does not wrap
    }
  EXPECT_EQ(wraps(e), 0);
}

}  // namespace
}  // namespace tokid::testing
