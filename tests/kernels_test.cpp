// The kernels that move and multiply samples, with every instruction set of the machine, on sizes around those of its
// vectors.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "linalg/column_range.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/tall_product.hpp"
#include "linalg/transposition.hpp"
#include "targets.hpp"
#include "testing.hpp"

namespace tokid {
namespace {

using linalg::Into;
using testing::epsilon;
using testing::Random;

class Kernels : public testing::OnTarget {};
INSTANTIATE_TEST_SUITE_P(Targets, Kernels, testing::all_targets(), testing::target_name);

TEST_P(Kernels, TallProductsAreThoseOfEigen) {
  Random random(1);
  for (const Index rows : {1, 7, 8, 17, 50, 103})
    for (const Index inner : {0, 1, 4, 9})
      for (const Index columns : {0, 1, 2, 3, 7, 8}) {
        const Matrix x = random.matrix(rows + 3, inner + 2), w = random.matrix(columns + 1, inner),
                     before = random.matrix(rows + 5, columns);
        const auto part = x.block(2, 1, rows, inner);  // with a stride of its own
        const auto weights = w.topRows(columns);
        const Matrix product = part * weights.transpose();
        const double unit = epsilon * double(inner + 1) * double(rows * columns + 1);
        const auto result = [&](Into into) {
          Matrix out = before;
          linalg::tall_product(part, weights, into, out.topRows(rows));
          EXPECT_EQ(out.bottomRows(5), before.bottomRows(5));
          return Matrix(out.topRows(rows));
        };
        EXPECT_LE((result(Into::set) - product).norm(), 10 * unit);
        EXPECT_LE((result(Into::add) - before.topRows(rows) - product).norm(), 10 * unit);
        EXPECT_LE((result(Into::subtract) - before.topRows(rows) + product).norm(), 10 * unit);
      }
}

TEST_P(Kernels, ARowDoesNotDependOnTheOthers) {
  Random random(2);
  const Matrix x = random.matrix(64, 5), w = random.matrix(3, 5);
  Matrix all(64, 3);
  linalg::tall_product(x, w, Into::set, all);
  for (const Index begin : {0, 3, 8, 32})
    for (const Index rows : {1, 3, 7, 13, 16, 31}) {
      Matrix part(rows, 3);
      linalg::tall_product(x.middleRows(begin, rows), w, Into::set, part);
      EXPECT_EQ(part, all.middleRows(begin, rows));
    }
}

TEST_P(Kernels, BasesAreOrthonormalWhateverTheCondition) {
  Random random(5);
  for (const Index rows : {12, 50, 300, 601})
    for (const Index cols : {1, 5, 12})
      for (const double condition : {1.0, 1e8, 1e14}) {
        Matrix a = random.matrix(rows, cols);
        if (condition > 1) {
          const linalg::Svd d = linalg::svd(a);
          Vector s(cols);
          for (Index i = 0; i < cols; ++i)
            s(i) = std::pow(condition, -double(i) / double(std::max<Index>(1, cols - 1)));
          a = d.u * s.asDiagonal() * d.v.transpose();
        }
        Matrix q = a;
        linalg::orthonormalise(q);
        const double unit = 20 * epsilon * double(rows * cols);
        EXPECT_LE((q.transpose() * q - Matrix::Identity(cols, cols)).norm(), unit) << condition;
        for (Index c = 1; c <= cols; ++c) {  // the spaces of the first columns
          const auto basis = q.leftCols(c);
          EXPECT_LE((basis * (basis.transpose() * a.leftCols(c)) - a.leftCols(c)).norm(), unit * a.norm());
        }
      }
}

TEST_P(Kernels, BasesOfDependentColumnsAreOrthonormalOrZero) {
  Random random(6);
  Matrix a = random.matrix(80, 12);
  a.col(4).setZero();
  a.col(7) = 2 * a.col(1) - a.col(3);
  a.col(8) = a.col(2);
  const Matrix before = a;
  linalg::orthonormalise(a);
  Matrix expected = Matrix::Identity(12, 12);
  expected(4, 4) = 0.0;
  for (const Index c : {7, 8})
    if (a.col(c).norm() == 0) expected(c, c) = 0.0;
  EXPECT_LE((a.transpose() * a - expected).norm(), 1e3 * epsilon);
  EXPECT_LE((a * (a.transpose() * before) - before).norm(), 1e3 * epsilon * before.norm());
}

TEST_P(Kernels, RangesAreThoseOfEigen) {
  Random random(3);
  for (const Index count : {1, 2, 8, 15, 16, 17, 50, 200}) {
    Vector values = random.matrix(count, 1);
    const linalg::ColumnRange range = linalg::column_range(values.data(), count);
    EXPECT_TRUE(range.finite);
    EXPECT_EQ(range.min, values.minCoeff());
    EXPECT_EQ(range.max, values.maxCoeff());
    for (const Index at : {Index{0}, count / 2, count - 1})
      for (const double odd : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                               -std::numeric_limits<double>::infinity()}) {
        Vector other = values;
        other(at) = odd;
        EXPECT_FALSE(linalg::column_range(other.data(), count).finite);
      }
  }
}

TEST_P(Kernels, RowsBecomeColumns) {
  Random random(4);
  for (const Index rows : {1, 7, 8, 9, 40})
    for (const Index cols : {1, 3, 8, 21}) {
      const Index stride = cols + 2;
      const Matrix stored = random.matrix(stride, rows);  // row i of the argument is column i
      Matrix to = Matrix::Zero(rows + 1, 2 * cols);
      std::vector<double*> columns;
      for (Index j = 0; j < cols; ++j) columns.push_back(to.col(2 * j).data());
      linalg::transpose(stored.data(), rows, stride, columns);
      for (Index j = 0; j < cols; ++j) {
        EXPECT_EQ(Vector(to.col(2 * j).head(rows)), Vector(stored.row(j).transpose()));
        EXPECT_EQ(to(rows, 2 * j), 0.0);
        EXPECT_EQ(to.col(2 * j + 1).norm(), 0.0);
      }
    }
}

}  // namespace
}  // namespace tokid
