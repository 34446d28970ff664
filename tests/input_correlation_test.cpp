// SPDX-License-Identifier: BSD-3-Clause
#include "model/input_correlation.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"

namespace tokid::testing {
namespace {

struct Case {
  Ensemble data;
  Innovations innovations;
};

// Inputs that are correlated in time, and innovations of which output 0 has 0.5 times input 1 of two steps before.
Case correlated(Index experiments, Index steps, Index inputs, Index outputs, double share, std::uint64_t seed) {
  Random random(seed);
  Case result{Ensemble(experiments, steps, inputs, outputs), {}};
  Matrix before = random.matrix(experiments, inputs);
  for (Index k = 0; k < steps; ++k) {
    before = 0.8 * before + random.matrix(experiments, inputs);
    result.data.input(k) = before;
    result.innovations.push_back(random.matrix(experiments, outputs));
    if (k >= 2 && inputs > 1) result.innovations.back().col(0) += share * result.data.input(k - 2).col(1);
  }
  return result;
}

// Pearson's correlation coefficient of two columns.
double pearson(const Vector& a, const Vector& b) {
  const Vector x = a.array() - a.mean(), y = b.array() - b.mean();
  return x.dot(y) / std::sqrt(x.squaredNorm() * y.squaredNorm());
}

TEST(InputCorrelation, IsTheMeanOfPearsonsCoefficients) {
  std::uint64_t seed = 1;
  for (const auto& [experiments, steps, inputs, outputs] :
       {std::tuple<Index, Index, Index, Index>{40, 12, 2, 2}, {9, 30, 3, 1}, {200, 5, 1, 4}}) {
    const Case c = correlated(experiments, steps, inputs, outputs, 0.5, ++seed);
    const InputCorrelation found = input_correlation(c.innovations, c.data, -3, 3, Pooling::experiments);
    EXPECT_EQ(found.over, Pooling::experiments);
    ASSERT_EQ(found.correlation.size(), 7u);
    for (Index lag = -3; lag <= 3; ++lag)
      for (Index i = 0; i < inputs; ++i) {
        double terms = 0.0;
        Vector sum = Vector::Zero(outputs);
        for (Index k = 0; k < steps; ++k) {
          if (k - lag < 0 || k - lag >= steps) continue;
          for (Index j = 0; j < outputs; ++j)
            sum(j) += pearson(c.innovations[size_t(k)].col(j), c.data.input(k - lag).col(i));
          terms += 1;
        }
        for (Index j = 0; j < outputs; ++j)  // sums of numbers of at most 1: a few rounding errors of each
          EXPECT_NEAR(found.correlation[size_t(lag + 3)](j, i), sum(j) / terms, 1e-15 * double(10 * experiments));
        EXPECT_NEAR(found.bound(lag + 3, i), 2.5758293 / std::sqrt(terms * double(experiments - 1)), 1e-7);
      }
  }
}

TEST(InputCorrelation, IsAtTheLagInputAndOutputThatAreCorrelated) {
  for (const Index experiments : {3, 300}) {  // pooled over time, and over the experiments
    const Case c = correlated(experiments, 60, 2, 2, 0.5, 5);
    const Pooling over = independence(c.innovations, c.data, 0, 4).over;
    EXPECT_EQ(over, experiments == 3 ? Pooling::time : Pooling::experiments);
    const InputCorrelation found = input_correlation(c.innovations, c.data, -4, 4, over);
    EXPECT_EQ(found.over, over);
    double most = 0.0;
    Index lag = 0, output = 0, input = 0;
    for (Index l = 0; l < 9; ++l)
      for (Index j = 0; j < 2; ++j)
        for (Index i = 0; i < 2; ++i)
          if (const double size = std::abs(found.correlation[size_t(l)](j, i)) / found.bound(l, i); size > most)
            most = size, lag = l - 4, output = j, input = i;
    EXPECT_GT(most, 2);
    EXPECT_EQ(std::tuple(lag, output, input), std::tuple(2, 0, 1));
  }
}

// Independent innovations: the share beyond the bounds is that of the bounds, whatever the inputs are.
TEST(InputCorrelation, BoundsHoldNinetyNineInAHundred) {
  for (const Index experiments : {8, 40}) {
    Index beyond = 0, all = 0;
    for (std::uint64_t seed = 0; seed < 150; ++seed) {
      const Case c = correlated(experiments, 15, 2, 2, 0.0, 100 + seed);
      const InputCorrelation found = input_correlation(c.innovations, c.data, -2, 2, Pooling::experiments);
      for (Index l = 0; l < 5; ++l)
        for (Index j = 0; j < 2; ++j)
          for (Index i = 0; i < 2; ++i, ++all)
            beyond += std::abs(found.correlation[size_t(l)](j, i)) > found.bound(l, i);
    }
    // 3000 numbers, of which 30 are expected beyond. Those of one run are correlated: five standard deviations of
    // independent ones, 5 · √30.
    EXPECT_NEAR(double(beyond), 0.01 * double(all), 5 * std::sqrt(0.01 * double(all)));
  }
}

TEST(InputCorrelation, LeavesOutWhatIsMissingOrConstant) {
  Case c = correlated(30, 10, 2, 1, 0.5, 9);
  for (Index k = 0; k < 10; ++k) c.data.input(k).col(0).setConstant(3.0);
  c.innovations[4](7, 0) = nan;
  c.data.u(2, 5, 1) = nan;
  const InputCorrelation found = input_correlation(c.innovations, c.data, 0, 2, Pooling::experiments);
  for (Index l = 0; l < 3; ++l) {
    EXPECT_TRUE(std::isnan(found.correlation[size_t(l)](0, 0)) && std::isnan(found.bound(l, 0)));
    EXPECT_TRUE(std::isfinite(found.correlation[size_t(l)](0, 1)) && std::isfinite(found.bound(l, 1)));
  }
  // Too few for a test.
  const Case few = correlated(2, 3, 1, 1, 0.0, 1);
  for (const Pooling over : {Pooling::none, Pooling::experiments})
    for (const Matrix& lag : input_correlation(few.innovations, few.data, 0, 1, over).correlation)
      EXPECT_TRUE(lag.array().isNaN().all());
  EXPECT_THROW(input_correlation(few.innovations, few.data, 1, 0, Pooling::time), std::invalid_argument);
  EXPECT_THROW(input_correlation(few.innovations, c.data, 0, 1, Pooling::time), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
