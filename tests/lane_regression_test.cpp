// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/lane_regression.hpp"

#include <gtest/gtest.h>
#include <cmath>

#include "linalg/simd.hpp"
#include "testing.hpp"

namespace tokid {
namespace {

using linalg::LaneRegression;
using testing::epsilon;
using testing::Random;

struct Batch {
  Matrix samples;
  Index left, right, offset;
  LaneRegression lanes;

  Batch(Matrix a, Index left_columns, Index right_columns, Index offset_columns)
      : samples(std::move(a)),
        left(left_columns),
        right(right_columns),
        offset(offset_columns),
        lanes(samples.rows(), left, right) {
    lanes.run(samples.data(), samples.rows(), offset * samples.rows());
  }
  Matrix own(Index l) const { return samples.middleCols(l * offset, left + right); }
  Matrix factor(Index l) const {
    Matrix r = Matrix::Zero(left + right, left + right);
    for (Index j = 0; j < r.cols(); ++j)
      for (Index i = 0; i <= j; ++i) r(i, j) = lanes.factor(l, i, j);
    return r;
  }
};

TEST(LaneRegression, SolvesTheProblemOfEveryLane) {
  Random random(1);
  for (const simd::Target target : simd::targets()) {
    simd::limit_target(target);
    SCOPED_TRACE(simd::to_string(target));
    for (const Index rows : {5, 31, 50, 64, 201})
      for (const auto& [left, right] : {std::pair<Index, Index>{1, 1}, {4, 1}, {3, 2}, {10, 2}, {19, 4}}) {
        const Batch b(random.matrix(rows, left + right + 3 * 8), left, right, 3);
        for (Index l = 0; l < b.lanes.lanes(); ++l) {
          const Matrix a = b.own(l), r = b.factor(l);
          EXPECT_LE((r.transpose() * r - a.transpose() * a).norm(),
                    10 * epsilon * double(left + right + 10) * a.squaredNorm());
          if (rows <= left + right) continue;
          const linalg::MinimumNorm best = linalg::minimum_norm(a.leftCols(left), a.rightCols(right), 1e-14);
          Matrix x(left, right), inverse = Matrix::Zero(left, left);
          for (Index j = 0; j < right; ++j)
            for (Index i = 0; i < left; ++i) x(i, j) = b.lanes.x(l, i, j);
          for (Index j = 0; j < left; ++j)
            for (Index i = 0; i <= j; ++i) inverse(i, j) = b.lanes.inverse(l, i, j);
          const double unit = 1e2 * epsilon * double(left) * best.condition;
          EXPECT_LE((x - best.x).norm(), unit * (best.x.norm() + 1));
          EXPECT_LE((inverse * r.topLeftCorner(left, left) - Matrix::Identity(left, left)).norm(), unit);
          const Vector size = a.leftCols(left).colwise().norm();
          EXPECT_NEAR(b.lanes.condition(l), std::sqrt(double(left)) * (size.asDiagonal() * inverse).norm(),
                      unit * b.lanes.condition(l));
        }
      }
  }
  simd::limit_target(simd::Target::avx512);
}

TEST(LaneRegression, DeficientLanesHaveNoFiniteConditionAndDisturbNoOther) {
  Random random(2);
  const Matrix whole = random.matrix(30, 6 * 9);
  Matrix holed = whole;
  holed.col(6 * 1 + 2).setZero();
  const Batch sound(whole, 4, 2, 6), ill(holed, 4, 2, 6);
  for (Index l = 0; l < sound.lanes.lanes(); ++l) {
    EXPECT_EQ(std::isfinite(ill.lanes.condition(l)), l != 1);
    if (l == 1) continue;
    EXPECT_EQ(ill.lanes.condition(l), sound.lanes.condition(l));
    EXPECT_EQ(ill.factor(l), sound.factor(l));
  }
}

}  // namespace
}  // namespace tokid
