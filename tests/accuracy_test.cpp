// SPDX-License-Identifier: BSD-3-Clause
#include "accuracy.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <ostream>
#include <set>

#include "oracle.hpp"
#include "testing.hpp"

namespace tokid::testing {

void PrintTo(const AccuracyStudy& study, std::ostream* out) { *out << study.name; }

namespace {

class AccuracyOf : public ::testing::TestWithParam<AccuracyStudy> {};
INSTANTIATE_TEST_SUITE_P(Studies, AccuracyOf, ::testing::ValuesIn(accuracy_studies()),
                         [](const auto& study) { return study.param.name; });

TEST_P(AccuracyOf, EveryStageAndRouteIsWithinOneBound) {
  const std::vector<Accuracy> all = GetParam().run(GetParam().cases);
  EXPECT_GE(all.size(), size_t(GetParam().cases));  // few cases are left out
  for (const Accuracy& a : all)
    EXPECT_LE(a.ratio, accuracy_bound) << a.stage << ", " << a.route << ", condition " << a.condition;
}

TEST(Accuracy, CasesCoverEveryConditionAndRoute) {
  std::set<std::string> routes;
  double best = 1e12, worst = 1.0;
  for (const Accuracy& a : accuracy_studies().front().run(40)) {
    routes.insert(a.route.substr(0, a.route.find(',')));
    best = std::min(best, a.condition);
    worst = std::max(worst, a.condition);
  }
  EXPECT_EQ(routes, (std::set<std::string>{"SIMD lanes", "each step by itself", "merged files (MPI)", "shared window",
                                           "streamed update"}));
  EXPECT_LE(best, 100);
  EXPECT_GE(worst, 1e11);
}

// x is known: 1, 2, 3 …, and the numbers are so few and small that products and sums are exact.
TEST(Oracle, SolvesWhatDoublePrecisionCannot) {
  Random random(1);
  const Index rows = 20, cols = 6;
  Matrix a(rows, cols), x(cols, 1);
  for (Index j = 0; j < cols; ++j) x(j, 0) = double(j + 1);
  for (Index n = 0; n < rows; ++n)
    for (Index j = 0; j < cols; ++j)
      a(n, j) =
          j == 0 ? std::round(random.uniform(-8, 8)) : a(n, 0) + std::ldexp(std::round(random.uniform(-8, 8)), -36);
  const Matrix b = a * x;
  const oracle::LeastSquares truth = oracle::least_squares(oracle::exact(a), oracle::exact(b));
  EXPECT_GT(truth.condition, 1e10);
  EXPECT_LT(oracle::distance(x, truth.x), 1e-20);
  EXPECT_LT(truth.residual(0), 1e-20 * truth.right(0));
  // Orthogonal factorisations keep to the bound, normal equations in double precision have no digit left.
  const double unit = epsilon * truth.condition * (x.norm() + truth.right(0) / truth.size);
  EXPECT_LT((linalg::minimum_norm(a, b, 1e-14).x - x).norm(), accuracy_bound * unit);
  EXPECT_GT((Matrix((a.transpose() * a).llt().solve(a.transpose() * b)) - x).norm(), 100 * accuracy_bound * unit);
}

}  // namespace
}  // namespace tokid::testing
