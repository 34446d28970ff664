// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/paper.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

class PaperExample : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  const Paper paper = paper_example({.seed = GetParam()});
};

TEST_P(PaperExample, EveryPrintedNumber) {
  Index eigenvalues = 0;
  for (const PrintedNumber& number : paper.printed) {
    EXPECT_TRUE(number.agrees()) << number.equation << " " << number.quantity << ": " << number.printed << " printed, "
                                 << number.computed << " computed";
    if (number.quantity.starts_with("λ") && std::abs(number.printed) > 1e-3) {
      ++eigenvalues;
      EXPECT_LE(number.tolerance, 0.6e-5) << number.quantity;  // half a unit of the fifth digit
    }
  }
  EXPECT_EQ(eigenvalues, 6);
  // 6 of (74), (75); 48 entries and 12 eigenvalues of (79)-(81); 32 entries of (82), (83).
  EXPECT_EQ(paper.printed.size(), 98u);
  EXPECT_LE(paper.similarity, 1e-2);
}

TEST_P(PaperExample, DirectMarkovParametersAreExactAndMoreExperimentsAreBetter) {
  const Index T = paper.system.steps();
  const auto worst = [&](const Vector& error, Index begin) { return error.tail(T - begin).maxCoeff(); };
  EXPECT_LE(worst(paper.minimum.direct_error, 1), 1e-10);
  EXPECT_LE(worst(paper.more.direct_error, 1), 1e-12);
  EXPECT_LT(worst(paper.more.direct_error, 1), worst(paper.minimum.direct_error, 1));
  EXPECT_LT(worst(paper.more.recursive_error, 3), worst(paper.minimum.recursive_error, 3));
  EXPECT_LT(paper.more.output_error.cwiseAbs().maxCoeff(), paper.minimum.output_error.cwiseAbs().maxCoeff());
  EXPECT_LT(paper.more.condition_max, paper.minimum.condition_max);
  // Recursions begin where more than p steps lie behind.
  EXPECT_TRUE(std::isnan(paper.minimum.direct_error(0)));
  EXPECT_TRUE(std::isnan(paper.minimum.recursive_error(2)));
  EXPECT_FALSE(std::isnan(paper.minimum.recursive_error(3)));
}

TEST_P(PaperExample, ObserverReachesZeroWhereTheOpenLoopOscillates) {
  const Vector open = paper.open_error.colwise().norm(), closed = paper.closed_error.colwise().norm();
  EXPECT_DOUBLE_EQ(open(0), 1.0);
  EXPECT_EQ(open(0), closed(0));
  for (Index k = 3 * paper.lags; k < closed.size(); ++k) EXPECT_LE(closed(k), 1e-10) << k;
  for (Index k = 0; k < open.size(); ++k) EXPECT_GE(open(k), 0.1) << k;
  // Every component of the open loop changes its sign again and again.
  for (Index i = 0; i < open.rows() && i < paper.open_error.rows(); ++i) {
    Index changes = 0;
    for (Index k = 1; k < open.size(); ++k)
      if (paper.open_error(i, k) * paper.open_error(i, k - 1) < 0) ++changes;
    EXPECT_GE(changes, 2) << i;
  }
}

TEST_P(PaperExample, HistoriesCoverTheStepsOfTheFrame) {
  const size_t steps = size_t(paper.framed.end - paper.framed.begin - 1);
  EXPECT_EQ(paper.framed.begin, 0);
  EXPECT_EQ(paper.open.size(), steps);
  EXPECT_EQ(paper.closed.size(), steps);
  EXPECT_EQ(paper.products.size(), steps - 1);
  for (size_t k = 4; k < paper.products.size(); ++k) EXPECT_LE(paper.products[k], 1e-10) << k;
  for (size_t k = 4; k < steps; ++k) {
    EXPECT_GT(std::abs(paper.open[k][0]), 0.9) << k;     // an oscillator
    EXPECT_LE(std::abs(paper.closed[k][2]), 1e-5) << k;  // two of four eigenvalues are zero (79)-(81)
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, PaperExample, ::testing::Values(1, 2, 3, 4, 5, 6, 7, 8),
                         [](const auto& test) { return "seed" + std::to_string(test.param); });

TEST(Paper, OptionsOutOfRangeAreRefused) {
  EXPECT_THROW(paper_example({.steps = 40}), std::invalid_argument);
  EXPECT_THROW(paper_example({.minimum = 9}), std::invalid_argument);
  EXPECT_THROW(paper_example({.minimum = 20, .more = 15}), std::invalid_argument);
  EXPECT_THROW(paper_example({.free_responses = 3}), std::invalid_argument);
  EXPECT_THROW(paper_example({.markov_band = 2}), std::invalid_argument);
}

TEST(KalmanStudy, TheIdentifiedObserverTendsToTheKalmanFilter) {
  const KalmanStudy study = kalman_study({.seed = 1});
  // 7 lag orders for 4 numbers of experiments, but N = 50 carries p = 15 and 20 not.
  ASSERT_EQ(study.cells.size(), 26u);
  const auto cell = [&](Index p, Index experiments) {
    for (const KalmanStudyCell& c : study.cells)
      if (c.lags == p && c.experiments == experiments) return c;
    return KalmanStudyCell{};
  };
  EXPECT_LE(cell(10, 2000).error, 1.04);
  for (const Index p : {2, 3, 5, 8, 10}) {
    // More experiments never hurt, and nothing beats the Kalman filter but by chance: 500·40·2 samples.
    EXPECT_GT(cell(p, 50).error, cell(p, 200).error) << p;
    EXPECT_GT(cell(p, 200).error, cell(p, 2000).error) << p;
    EXPECT_GT(cell(p, 2000).error, cell(p, 0).error - 0.01) << p;
    EXPECT_GT(cell(p, 0).error, 0.999) << p;
  }
  // In the limit of many experiments, both errors fall with every further lag.
  for (const auto& [p, next] : {std::pair{2, 3}, {3, 5}, {5, 8}, {8, 10}, {10, 15}, {15, 20}}) {
    EXPECT_GT(cell(p, 0).error, cell(next, 0).error) << p;
    EXPECT_GT(cell(p, 0).gain, 1.1 * cell(next, 0).gain) << p;
  }
  // They fall to zero: G_k → -A_k K_k.
  EXPECT_LE(cell(20, 0).error, 1.01);
  EXPECT_LE(cell(20, 0).gain, 0.15);
}

TEST(KalmanStudy, RangesOutsideTheStepsAreRefused) {
  EXPECT_THROW(kalman_study({.begin = 50, .end = 50}), std::invalid_argument);
  EXPECT_THROW(kalman_study({.end = 61}), std::invalid_argument);
  EXPECT_THROW(kalman_study({.fresh = 0}), std::invalid_argument);
  EXPECT_THROW(kalman_study({.lags = {0}}), std::invalid_argument);
  EXPECT_THROW(kalman_study({.experiments = {-1}}), std::invalid_argument);
  EXPECT_THROW(kalman_study({.measurement_noise = 0}), std::invalid_argument);
  EXPECT_TRUE(kalman_study({.lags = {10}, .experiments = {42}}).cells.empty());  // as many unknowns as experiments
}

// The regression on the second moments must be the limit of regressions on more and more experiments.
TEST(ExpectedMoments, AreTheLimitOfManyExperiments) {
  const ExperimentOptions options{.experiments = 20000, .process_noise = 0.1, .measurement_noise = 0.2};
  const Model system = with_noise(rotating_tube(12), options);
  const Ensemble many = experiments(system, options), limit = expected_moments(system);
  const Matrix expected = limit.samples().transpose() * limit.samples() / double(limit.experiments());
  const Matrix sampled = many.samples().transpose() * many.samples() / double(many.experiments());
  const Vector size = expected.diagonal().cwiseSqrt();
  // Correlations over N experiments scatter by 1/√N = 0.007; the largest of 24² of them by some five times that.
  EXPECT_LE(((sampled - expected).array() / (size * size.transpose()).array()).abs().maxCoeff(), 0.035);

  Model bad = system;
  for (Step& step : bad.step) step.forget_noise();
  EXPECT_THROW(expected_moments(bad), std::invalid_argument);
  bad = system;
  bad.step[3].set_Q(-bad.step[3].Q());
  EXPECT_THROW(expected_moments(bad), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
