// SPDX-License-Identifier: BSD-3-Clause
#include "base/statistics.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"

namespace tokid::testing {
namespace {

using namespace statistics;

TEST(Statistics, TailsOfKnownDistributions) {
  // χ² with two degrees of freedom is exponential; its cumulants are f, 2 f, 8 f.
  for (const double x : {0.1, 2.0, 15.0}) {
    EXPECT_NEAR(upper_tail({2, 4, 16}, x), std::exp(-x / 2), 1e-13);
    EXPECT_NEAR(upper_tail({-2, 4, -16}, -x), 1 - std::exp(-x / 2), 1e-13);
  }
  EXPECT_EQ(upper_tail({2, 4, 16}, -1.0), 1.0);
  EXPECT_EQ(upper_tail({-2, 4, -16}, 1.0), 0.0);
  EXPECT_NEAR(upper_tail({1, 4, 0}, 1 + 2 * 1.6448536269514722), 0.05, 1e-12);  // normal
  EXPECT_TRUE(std::isnan(upper_tail({1, 0, 0}, 1)));
  EXPECT_NEAR(chi_square_two_sided(2 * std::log(20.0), 2), 0.1, 1e-12);   // upper 5 %
  EXPECT_NEAR(chi_square_two_sided(-2 * std::log(0.95), 2), 0.1, 1e-12);  // lower 5 %
  EXPECT_NEAR(student_two_sided(-1.0, 1), 0.5, 1e-14);
}

TEST(Statistics, MomentsOfProjectedTraces) {
  Random random(1);
  for (const auto& [rank, size] : {std::pair<Index, Index>{1, 5}, {2, 5}, {3, 7}, {4, 5}}) {
    const Matrix root = random.matrix(size, 3);
    const Matrix m = root * root.transpose();
    const Cumulants c = projected_trace(double(rank), double(size), m.trace(), (m * m).trace(), (m * m * m).trace());
    const int draws = 20000;
    std::vector<double> values;
    for (int i = 0; i < draws; ++i) {
      const Matrix q = linalg::orthonormal_factor(random.matrix(size, rank));
      values.push_back((q.transpose() * m * q).trace());
    }
    double mean = 0.0, variance = 0.0, third = 0.0;
    for (const double v : values) mean += v / draws;
    for (const double v : values) variance += (v - mean) * (v - mean) / draws;
    for (const double v : values) third += std::pow(v - mean, 3) / draws;
    // Four standard errors: of a mean; of a variance, 2 for a kurtosis below 5; and of a third moment, 4 with the sixth
    // moment below 16 σ⁶.
    const double error = 4 / std::sqrt(double(draws)), deviation = std::sqrt(c.variance);
    EXPECT_NEAR(mean, c.mean, error * deviation);
    EXPECT_NEAR(variance, c.variance, 2 * error * c.variance);
    EXPECT_NEAR(third, c.third, 4 * error * std::pow(deviation, 3));
  }
}

TEST(Statistics, TracesOfWholeSpacesAreCertain) {
  const Cumulants c = projected_trace(2, 6, 6, 6, 6);  // M = I
  EXPECT_DOUBLE_EQ(c.mean, 2.0);
  EXPECT_NEAR(c.variance, 0.0, 1e-15);
  EXPECT_NEAR(c.third, 0.0, 1e-15);
}

}  // namespace
}  // namespace tokid::testing
