// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/lane_svd.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "targets.hpp"
#include "testing.hpp"

namespace tokid {
namespace {

using linalg::LaneSvd;
using testing::epsilon;
using testing::Random;

struct SvdBatch {
  std::vector<Matrix> a;
  LaneSvd lanes;

  explicit SvdBatch(std::vector<Matrix> matrices) : a(std::move(matrices)), lanes(a[0].rows(), a[0].cols()) {
    for (Index l = 0; l < LaneSvd::lanes(); ++l)
      for (Index i = 0; i < a[0].rows(); ++i)
        for (Index j = 0; j < a[0].cols(); ++j) lanes.entry(l, i, j) = a[size_t(l)](i, j);
    lanes.run();
  }
  Matrix u(Index l) { return take(l).first; }
  Vector s(Index l) { return take(l).second; }

 private:
  std::pair<Matrix, Vector> take(Index l) {
    std::pair<Matrix, Vector> result;
    lanes.take(l, result.first, result.second);
    return result;
  }
};

std::vector<Matrix> random_matrices(Random& random, Index rows, Index cols) {
  std::vector<Matrix> a;
  for (Index l = 0; l < LaneSvd::lanes(); ++l) a.push_back(random.matrix(rows, cols));
  return a;
}

class LaneSvdOn : public testing::OnTarget {};
INSTANTIATE_TEST_SUITE_P(Targets, LaneSvdOn, testing::all_targets(), testing::target_name);

TEST_P(LaneSvdOn, DecomposesTheMatrixOfEveryLane) {
  Random random(1);
  for (const Index rows : {1, 2, 6, 11, 32, 70})
    for (const Index cols : {1, 4, 8, 33, 90}) {
      SvdBatch b(random_matrices(random, rows, cols));
      // An orthogonal reduction of cols rows to a triangle, then some sweeps of rows² rotations.
      const double unit = 20 * epsilon * double(rows + cols);
      for (Index l = 0; l < LaneSvd::lanes(); ++l) {
        ASSERT_TRUE(b.lanes.found(l));
        const Matrix &a = b.a[size_t(l)], u = b.u(l);
        const linalg::Svd other = linalg::svd(a);
        EXPECT_LE((b.s(l) - other.s).norm(), unit * other.s(0));
        EXPECT_LE((u.transpose() * u - Matrix::Identity(u.cols(), u.cols())).norm(), unit);
        // u sᵀs uᵀ = a aᵀ
        EXPECT_LE((u * b.s(l).cwiseAbs2().asDiagonal() * u.transpose() - a * a.transpose()).norm(),
                  unit * a.squaredNorm());
      }
    }
}

// Hankel matrices without noise have a rank, beyond which there are rounding errors; and channels of many sizes.
TEST_P(LaneSvdOn, KeepsDirectionsOrthogonalWhereSingularValuesAreRoundingErrors) {
  Random random(2);
  std::vector<Matrix> a;
  for (Index l = 0; l < LaneSvd::lanes(); ++l) {
    a.emplace_back(random.matrix(9, 4) * random.matrix(4, 12));
    a.back().row(3) *= 1e-7;
    a.back().col(5) *= 1e5;
  }
  SvdBatch b(a);
  for (Index l = 0; l < LaneSvd::lanes(); ++l) {
    ASSERT_TRUE(b.lanes.found(l));
    const Matrix u = b.u(l);
    const Vector s = b.s(l);
    EXPECT_LE((u.transpose() * u - Matrix::Identity(9, 9)).norm(), 100 * epsilon * 9);
    EXPECT_LE(s(4), 100 * epsilon * s(0));
    EXPECT_LE((u.leftCols(4) * (u.leftCols(4).transpose() * a[size_t(l)]) - a[size_t(l)]).norm(),
              100 * epsilon * a[size_t(l)].norm());
  }
}

TEST_P(LaneSvdOn, SaysWhereItHasNothing) {
  Random random(3);
  std::vector<Matrix> a = random_matrices(random, 5, 7);
  SvdBatch sound(a);
  a[0].setZero();
  for (const double size :
       {0.0, 1e-200, 1e200, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    a[0](0, 0) = size;
    SvdBatch b(a);
    EXPECT_FALSE(b.lanes.found(0)) << size;
    for (Index l = 1; l < LaneSvd::lanes(); ++l) {  // the other lanes are not disturbed
      ASSERT_TRUE(b.lanes.found(l));
      EXPECT_EQ(b.u(l), sound.u(l));
      EXPECT_EQ(b.s(l), sound.s(l));
    }
  }
}

// Squares of such columns are denormal: rotations never end there.
TEST_P(LaneSvdOn, LanesThatNeverEndLeaveTheOthersAlone) {
  Random random(4);
  std::vector<Matrix> a = random_matrices(random, 6, 8);
  SvdBatch sound(a);
  const Matrix lane = a[0];
  for (const double size : {1e-150, 1e-155, 1e-160, 1e-165}) {
    a[0] = size * lane;
    SvdBatch b(a);
    EXPECT_FALSE(b.lanes.found(0)) << size;
    for (Index l = 1; l < LaneSvd::lanes(); ++l) {
      ASSERT_TRUE(b.lanes.found(l)) << size;
      EXPECT_EQ(b.u(l), sound.u(l));
      EXPECT_EQ(b.s(l), sound.s(l));
    }
  }
}

TEST_P(LaneSvdOn, ColumnsOfZerosChangeNothing) {
  Random random(5);
  for (const Index rows : {2, 6, 11})
    for (const Index cols : {11, 12, 15}) {
      std::vector<Matrix> a = random_matrices(random, rows, cols), wider = a;
      for (Matrix& w : wider) {
        w.conservativeResize(rows, cols + 5);
        w.rightCols(5).setZero();
      }
      SvdBatch narrow(a), wide(wider);
      for (Index l = 0; l < LaneSvd::lanes(); ++l) {
        ASSERT_TRUE(wide.lanes.found(l));
        EXPECT_EQ(wide.u(l), narrow.u(l));
        EXPECT_EQ(wide.s(l), narrow.s(l));
      }
    }
}

}  // namespace
}  // namespace tokid
