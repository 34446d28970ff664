// SPDX-License-Identifier: BSD-3-Clause
#include "studies/accuracy.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <ostream>
#include <set>

#include "oracle.hpp"
#include "studies/accuracy_tables.hpp"
#include "testing.hpp"

namespace tokid::testing {

void PrintTo(const AccuracyStudy& study, std::ostream* out) { *out << study.name; }

namespace {

class AccuracyOf : public ::testing::TestWithParam<AccuracyStudy> {};
INSTANTIATE_TEST_SUITE_P(Studies, AccuracyOf, ::testing::ValuesIn(accuracy_studies()),
                         [](const auto& study) { return study.param.name; });

// What the page shows comes from more cases, and from another machine.
constexpr double alike = 10.0;

std::string page() {
  std::ifstream in(TOKID_ACCURACY_PAGE);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST_P(AccuracyOf, EveryStageAndRouteIsWithinOneBound) {
  const AccuracyFindings found = GetParam().run(GetParam().cases);
  EXPECT_GE(found.judged + found.left_out, GetParam().cases);
  EXPECT_GE(found.judged, GetParam().judged * (found.judged + found.left_out));
  for (const Accuracy& a : found.all)
    EXPECT_LE(a.ratio, accuracy_bound) << a.stage << ", " << a.route << ", condition " << a.condition;

  // One bound for all is wide for some: their medians are held to the page, in both directions.
  const std::vector<AccuracyRow> rows = accuracy_rows(found.all), shown_rows = read_accuracy_rows(page());
  const auto same = [](const AccuracyRow& a) {
    return [&a](const AccuracyRow& b) { return a.stage == b.stage && a.route == b.route; };
  };
  for (const AccuracyRow& row : rows) {
    SCOPED_TRACE(row.stage + ", " + row.route);
    const auto shown = std::find_if(shown_rows.begin(), shown_rows.end(), same(row));
    ASSERT_NE(shown, shown_rows.end()) << "not in docs/evidence.md";
    EXPECT_LE(row.median, alike * shown->median);
    EXPECT_GE(row.median, shown->median / alike);
    EXPECT_LE(row.largest, alike * shown->largest);
    EXPECT_GE(row.largest, shown->largest / alike);
  }
  for (const AccuracyRow& shown : shown_rows) {
    const auto same_stage = [&](const AccuracyRow& row) { return row.stage == shown.stage; };
    if (std::none_of(rows.begin(), rows.end(), same_stage)) continue;
    EXPECT_TRUE(std::any_of(rows.begin(), rows.end(), same(shown))) << shown.stage << ", " << shown.route;
  }

  // Of fewer cases the worst is not as bad: no fewer digits than the page shows, but for one.
  const std::vector<DigitsRow> digits = digits_rows(found.all), shown_digits = read_digits_rows(page());
  ASSERT_EQ(digits.size(), shown_digits.size());
  for (size_t i = 0; i < digits.size(); ++i)
    for (size_t j = 0; j < digits[i].digits.size(); ++j) {
      if (std::isnan(digits[i].digits[j])) continue;
      EXPECT_GE(digits[i].digits[j], shown_digits[i].digits[j] - 1) << i << ", " << j;
    }
}

TEST(Accuracy, CasesCoverEveryConditionAndRoute) {
  std::set<std::string> routes;
  double best = 1e12, worst = 1.0;
  for (const Accuracy& a : accuracy_studies().front().run(40).all) {
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
