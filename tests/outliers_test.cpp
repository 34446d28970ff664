// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers.hpp"

#include <gtest/gtest.h>

#include "studies/campaigns.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

std::string sentence(const Outlier& outlier) { return outlier.explanation ? in_words(*outlier.explanation) : ""; }

// No change of the samples explains it.
bool is_no_change(const Outlier& outlier) {
  using Kind = Explanation::Kind;
  return !outlier.explanation || outlier.explanation->kind == Kind::stuck ||
         outlier.explanation->kind == Kind::one_output;
}

class Fault : public ::testing::Test {
 protected:
  // One experiment of forty that something has happened to.
  template <class Change>
  std::vector<Outlier> found(Change&& change, double noise = 0.05) {
    Ensemble e = campaign({40, 60, {3, 2, 2}, noise, 4}, 5);
    const Ensemble before = e;
    for (Index k = 0; k < e.steps(); ++k) change(e, before, k);
    return outliers(e, {.lags = 4});
  }
  template <class Change>
  void expect(const std::string& explanation, Change&& change) {
    for (const double noise : {0.0, 0.02, 0.1}) {
      SCOPED_TRACE(explanation + ", noise " + std::to_string(noise));
      const std::vector<Outlier> result = found(change, noise);
      ASSERT_EQ(result.size(), 1u);
      EXPECT_EQ(result.front().experiment, 12);
      EXPECT_GT(result.front().ratio, 3);
      EXPECT_EQ(sentence(result.front()), explanation);
    }
  }
};

TEST_F(Fault, IsNamedWithWhatWouldExplainIt) {
  expect("It would fit with outputs y1 and y2 swapped",
         [](Ensemble& e, const Ensemble&, Index k) { std::swap(e.y(12, k, 0), e.y(12, k, 1)); });
  expect("It would fit with inputs u1 and u2 swapped",
         [](Ensemble& e, const Ensemble&, Index k) { std::swap(e.u(12, k, 0), e.u(12, k, 1)); });
  expect("It would fit with the sign of input u2 changed",
         [](Ensemble& e, const Ensemble&, Index k) { e.u(12, k, 1) *= -1; });
  expect("It would fit with the outputs 2 steps earlier", [](Ensemble& e, const Ensemble& before, Index k) {
    for (Index j = 0; j < 2; ++j) e.y(12, k, j) = k < 2 ? nan : before.y(12, k - 2, j);
  });
}

TEST_F(Fault, OfScaleIsFoundWhateverItIs) {
  for (const double factor : {1e-3, 10.0, 1e3, 1e6}) {
    const std::vector<Outlier> result =
        found([factor](Ensemble& e, const Ensemble&, Index k) { e.y(12, k, 1) *= factor; });
    ASSERT_EQ(result.size(), 1u) << factor;
    EXPECT_EQ(result.front().experiment, 12);
    ASSERT_TRUE(result.front().explanation);
    const Explanation& cause = *result.front().explanation;
    EXPECT_EQ(cause.kind, Explanation::Kind::scaled);
    EXPECT_EQ(cause.channels, (std::vector<Finding::Channel>{{true, 1, "y2"}}));
    EXPECT_NEAR(cause.numbers.at("factor") * factor, 1, 0.05);
  }
}

TEST_F(Fault, OfSeveralDoesNotHideThem) {
  const std::vector<Outlier> result = found([](Ensemble& e, const Ensemble&, Index k) {
    for (const Index n : {3, 12, 30}) std::swap(e.y(n, k, 0), e.y(n, k, 1));
    e.y(21, k, 0) *= 1000;
  });
  ASSERT_EQ(result.size(), 4u);
  std::vector<Index> experiments;
  for (const Outlier& o : result) experiments.push_back(o.experiment);
  std::sort(experiments.begin(), experiments.end());
  EXPECT_EQ(experiments, (std::vector<Index>{3, 12, 21, 30}));
}

// Without noise a wrong experiment fits, by states of its own.
TEST(Outliers, OfIdentifyWithoutNoise) {
  for (const Campaign& c : various_campaigns())
    for (const double initial : {0.0, 3.0}) {
      SCOPED_TRACE(std::to_string(c.experiments) + " experiments, initial states " + std::to_string(initial));
      Ensemble e = campaign({c.experiments, c.steps, c.size, 0.0, c.lags}, 1, initial);
      EXPECT_TRUE(identify(e).outliers.empty());
      if (c.experiments < 20) continue;
      const Index wrong = 7;
      for (Index k = 0; k < e.steps(); ++k) e.output(k).row(wrong) *= -1;
      const Identification found = identify(e);
      ASSERT_EQ(found.outliers.size(), 1u);
      EXPECT_EQ(found.outliers.front().experiment, wrong);
      // Also among those held out, where the model owes nothing to it.
      IdentifyOptions options;
      options.hold_out = 0.5;
      const Identification other = identify(e, options);
      ASSERT_EQ(other.outliers.size(), 1u);
      EXPECT_EQ(other.outliers.front().experiment, wrong);
    }
}

// The others tell nothing of the state that it begins with.
TEST(Outliers, OneThatBeginsElsewhereIsHealthy) {
  for (const double displaced : {1e-3, 1.0})
    for (const Index resting : {0, 5}) {
      const Model system = constant_system({2, 1, 1}, 60, 0.9, 3);
      Ensemble e(40, 60, 1, 1);
      Random random(4);
      for (Index k = 0; k < 60; ++k) e.input(k) = (k < resting ? 0.0 : 1.0) * random.matrix(40, 1);
      Matrix x0 = Matrix::Zero(2, 40);
      x0.col(12) << displaced, -2 * displaced;
      e = simulate(system, e, x0);
      e.initial_state = InitialState::unknown;
      EXPECT_TRUE(identify(e).outliers.empty()) << displaced << ", inputs at rest for " << resting << " steps";
      for (Index k = 0; k < 60; ++k) e.output(k).row(7) *= -1;
      const Identification found = identify(e);
      ASSERT_EQ(found.outliers.size(), 1u);
      EXPECT_EQ(found.outliers.front().experiment, 7);
      EXPECT_GE(found.outliers.front().ratio, 1e6);
    }
}

// Few experiments and many regressors: without any one of them, the others are explained.
TEST(Outliers, FewOfManyRegressorsAreHealthyWithoutNoise) {
  for (Index count = 5; count <= 24; ++count)
    for (const std::uint64_t seed : {1, 2, 3}) {
      const Ensemble e = random_experiments(random_system({8, 1, 2}, 30, 1.0, seed), count, seed);
      for (const bool zero_start : {false, true})
        EXPECT_TRUE(outliers_without_noise(e, {.lags = 8, .zero_start = zero_start}).empty())
            << count << " experiments";
    }
}

// It reaches a state that the others never do.
TEST(Outliers, OneThatAloneMovesAnInputIsHealthy) {
  Model system = constant_system({2, 1, 2}, 60, 0.9, 1);
  for (Step& step : system.step) {
    step.A() = Vector{{0.9, 0.95}}.asDiagonal();
    step.B().setIdentity();
    step.C().setOnes();
  }
  Ensemble e(40, 60, 2, 1);
  Random random(6);
  for (Index k = 0; k < 60; ++k) {
    e.input(k) << random.matrix(40, 1), Vector::Zero(40);
    if (k < 8) e.u(12, k, 1) = 1.0;
  }
  e = simulate(system, e);
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    e.initial_state = initial;
    EXPECT_TRUE(identify(e).outliers.empty());
  }
}

TEST(Outliers, FourExperimentsDoNotTellWhoIsRight) {
  Ensemble e = campaign({4, 60, {2, 2, 1}, 0.05, 2}, 5);
  for (Index k = 0; k < 60; ++k) e.output(k).row(1) *= 1000;
  EXPECT_TRUE(outliers(e, {.lags = 2}).empty());
}

// Where all others have ended, nothing is left to judge those by that go on.
TEST(Outliers, AreJudgedWhereThereAreOthers) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    Ensemble e = campaign({100, 100, {2, 1, 1}, 0.05, 2}, seed);
    Random random(seed);
    const double size = output_sizes(e)(0);
    std::vector<Index> length(100, 60), expected;
    for (Index n = 3; n < 100; n += 10) {
      expected.push_back(n);
      length[size_t(n)] = 100;
      for (Index k = 0; k < 100; ++k) e.y(n, k, 0) = 50 * size * random.normal();
    }
    set_length(e, length);
    std::vector<Index> found;
    for (const Outlier& o : outliers(e, {.lags = 2})) {
      found.push_back(o.experiment);
      EXPECT_TRUE(std::isfinite(o.ratio));
      // Samples that are shrunk have small residuals of any model; the shares of the outputs tell.
      EXPECT_TRUE(is_no_change(o)) << sentence(o);
    }
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
  }
}

TEST(Outliers, OneWildSampleIsNoWildExperiment) {
  const Campaign c{20, 80, {2, 1, 1}, 0.05, 2};
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Ensemble e = campaign(c, seed);
    e.y(7, 41, 0) += 50 * c.noise * output_sizes(e)(0);
    EXPECT_TRUE(identified_outliers(e, c).empty()) << "seed " << seed;
  }
}

// White noise in place of an output: nothing that is done to it makes it as usual, least of all to shrink it.
TEST(Outliers, NothingExplainsWhatIsOfAnotherKind) {
  const Campaign c{40, 60, {3, 2, 2}, 0.05, 4};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    Ensemble e = campaign(c, seed);
    Random random(seed);
    const double size = output_sizes(e)(0);
    for (Index k = 0; k < e.steps(); ++k) e.y(12, k, 0) = size * random.normal();
    const std::vector<Outlier> found = outliers(e, {.lags = c.lags});
    ASSERT_EQ(found.size(), 1u);
    EXPECT_TRUE(is_no_change(found.front())) << sentence(found.front());
  }
}

// Long records of one model show it, and who does not obey it.
TEST(Outliers, OneOfThreeLongRecords) {
  const Model system = constant_system({2, 1, 1}, 400, 0.9, 1);
  Ensemble e = with_noise(random_experiments(system, 3, 2), 0.05, 3);
  EXPECT_TRUE(outliers(e, {.lags = 2, .period = 1}).empty());
  for (Index k = 0; k < e.steps(); ++k) e.y(1, k, 0) *= 1000;
  const std::vector<Outlier> found = outliers(e, {.lags = 2, .period = 1});
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.front().experiment, 1);
  ASSERT_TRUE(found.front().explanation);
  EXPECT_EQ(found.front().explanation->kind, Explanation::Kind::scaled) << sentence(found.front());
  EXPECT_NEAR(found.front().explanation->numbers.at("factor"), 1e-3, 1e-4);
}

}  // namespace
}  // namespace tokid::testing
