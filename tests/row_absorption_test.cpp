// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/row_absorption.hpp"

#include <gtest/gtest.h>
#include <vector>

#include "linalg/simd.hpp"
#include "testing.hpp"

namespace tokid {
namespace {

using linalg::RowAbsorption;
using linalg::RowMatrix;
using testing::epsilon;
using testing::Random;

// The kernels once for every instruction set that they are compiled for and this machine has.
template <class Body>
void on_every_target(Body&& body) {
  for (const simd::Target target : simd::targets()) {
    simd::limit_target(target);
    SCOPED_TRACE(simd::to_string(target));
    body();
  }
  simd::limit_target(simd::Target::avx512);
}

Matrix absorbed(const Matrix& a) {
  RowAbsorption r;
  r.reset(a.cols());
  r.absorb(a);
  return r.factor();
}

double gram_error(const Matrix& r, const Matrix& a) {
  return (r.transpose() * r - a.transpose() * a).norm() / (epsilon * double(a.cols() + 10) * a.squaredNorm());
}

// Backward stable to the last digits for every shape of blocks, tiles, vectors and pieces.
TEST(RowAbsorption, HasTheGramMatrixOfItsRows) {
  on_every_target([] {
    Random random(1);
    for (const Index rows : {1, 2, 7, 8, 9, 50, 191, 192, 193, 400})
      for (const Index cols : {1, 2, 7, 15, 16, 17, 31, 33, 48, 90}) {
        const Matrix a = random.matrix(rows, cols), r = absorbed(a);
        EXPECT_LE(gram_error(r, a), 10.0) << rows << " x " << cols;
        EXPECT_TRUE(r.isUpperTriangular(0.0));
      }
  });
}

TEST(RowAbsorption, RowsMayComeOneByOneAndScaled) {
  Random random(2);
  const Matrix a = random.matrix(45, 20);
  const Vector scales = random.matrix(20, 1).cwiseAbs();
  RowAbsorption r;
  r.reset(20);
  for (Index i = 0; i < a.rows(); ++i) r.absorb(a.middleRows(i, 1), scales.data());
  EXPECT_LE(gram_error(r.factor(), a * scales.asDiagonal()), 10.0);
}

TEST(RowAbsorption, DroppedColumnsLeaveTheFactorOfTheOthers) {
  on_every_target([] {
    Random random(3);
    for (const Index rows : {5, 60, 300})
      for (const Index count : {1, 4, 16, 19}) {
        const Matrix a = random.matrix(rows, 70);
        RowAbsorption r;
        r.reset(a.cols());
        r.absorb(a);
        for (Index begin = 0; begin + count < a.cols(); begin += count) {
          r.drop(begin, count);
          const Index rest = a.cols() - begin - count;
          EXPECT_LE(gram_error(r.factor().bottomRightCorner(rest, rest), a.rightCols(rest)), 20.0);
        }
      }
  });
}

// Zero columns stay zero, columns of any size keep their digits, dependent ones leave pivots of rounding errors.
TEST(RowAbsorption, TakesDegenerateColumns) {
  Random random(4);
  Matrix a = random.matrix(60, 24);
  a.col(0).setZero();
  a.col(17).setZero();
  a.col(5) = a.col(4);
  Matrix r = absorbed(a);
  EXPECT_EQ(r.col(0).norm(), 0.0);
  EXPECT_EQ(r.col(17).norm(), 0.0);
  EXPECT_LE(std::abs(r(5, 5)), 1e2 * epsilon * a.col(5).norm());
  EXPECT_LE(gram_error(r, a), 10.0);

  a = random.matrix(60, 24);
  Vector sizes = Vector::Ones(24);
  for (const auto& [col, size] : {std::pair<Index, double>{3, 1e-200}, {9, 1e-160}, {16, 1e170}, {23, 1e250}})
    sizes(col) = size;
  r = absorbed(a * sizes.asDiagonal()) * sizes.cwiseInverse().asDiagonal();
  EXPECT_TRUE(r.allFinite());
  EXPECT_LE(gram_error(r, a), 10.0);
}

TEST(RowAbsorption, BackSubstitutionSolvesForAnySize) {
  on_every_target([] {
    Random random(5);
    for (const Index n : {1, 3, 4, 7, 8, 9, 16, 23, 40, 70})
      for (const Index right : {1, 5, 8, 17}) {
        const Matrix r = absorbed(random.matrix(2 * n + 4, n)), b = random.matrix(n, right);
        RowMatrix padded = RowMatrix::Zero(n, linalg::whole_vectors(n)), x(n, linalg::whole_vectors(right));
        padded.leftCols(n) = r;
        x.leftCols(right) = b;
        x.rightCols(x.cols() - right).setZero();
        linalg::back_substitute(padded, x, false);
        EXPECT_LE((r * x.leftCols(right) - b).norm(), 10 * epsilon * double(n) * r.norm() * x.norm());
        RowMatrix inverse = RowMatrix::Identity(n, padded.cols());
        linalg::back_substitute(padded, inverse, true);
        EXPECT_LE((r * inverse.leftCols(n) - Matrix::Identity(n, n)).norm(),
                  10 * epsilon * double(n) * r.norm() * inverse.norm());
        EXPECT_TRUE(Matrix(inverse.leftCols(n)).isUpperTriangular(0.0));
      }
  });
}

}  // namespace
}  // namespace tokid
