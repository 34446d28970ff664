// The kernels that move and multiply samples, with every instruction set of the machine, on sizes around those of its
// vectors.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "linalg/orthonormal.hpp"
#include "linalg/tall_product.hpp"
#include "linalg/transposition.hpp"
#include "targets.hpp"
#include "testing.hpp"

namespace tokid {
namespace {

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
        const Matrix u = random.matrix(rows, 2), b = random.matrix(columns, 2);
        const Matrix product = part * weights.transpose(), other = u * b.transpose();
        const double unit = epsilon * double(inner + 3) * double(rows * columns + 1);
        Matrix out = before;
        auto result = out.topRows(rows);
        linalg::tall_products({{part, weights}}, result);
        EXPECT_LE((result - product).norm(), 10 * unit);
        linalg::tall_products({{part, weights, true}, {u, b}}, result);
        EXPECT_LE((result - other + product).norm(), 10 * unit);
        linalg::tall_products({}, result);
        EXPECT_EQ(Matrix(result), Matrix::Zero(rows, columns));
        linalg::tall_products(before.topRows(rows), {{part, weights}, {u, b}, {u, b, true}}, result);
        EXPECT_LE((result - before.topRows(rows) - product).norm(), 30 * unit);
        linalg::tall_products(result, {{part, weights, true}}, result);  // in place
        EXPECT_LE((result - before.topRows(rows)).norm(), 40 * unit);
        EXPECT_EQ(out.bottomRows(5), before.bottomRows(5));
      }
  const Matrix x = random.matrix(8, 2), w = random.matrix(3, 2);
  Matrix out(8, 3);
  EXPECT_THROW(linalg::tall_products({{x, w}, {x, w}, {x, w}, {x, w}}, out), std::logic_error);
  EXPECT_THROW(linalg::tall_products({{x, w.topRows(2)}}, out), std::logic_error);
  EXPECT_THROW(linalg::tall_products({{x, w.leftCols(1)}}, out), std::logic_error);
  EXPECT_THROW(linalg::tall_products({{x.topRows(7), w}}, out), std::logic_error);
  EXPECT_THROW(linalg::tall_products(x, {{x, w}}, out), std::logic_error);
}

TEST_P(Kernels, ARowDoesNotDependOnTheOthers) {
  Random random(2);
  const Matrix x = random.matrix(64, 5), w = random.matrix(3, 5), u = random.matrix(64, 2), b = random.matrix(3, 2),
               y = random.matrix(64, 3);
  Matrix all(64, 3);
  linalg::tall_products(y, {{x, w, true}, {u, b}, {x, w, true}}, all);
  for (const Index begin : {0, 3, 8, 32})
    for (const Index rows : {1, 3, 7, 13, 16, 31}) {
      Matrix part(rows, 3);
      const auto x_part = x.middleRows(begin, rows);
      linalg::tall_products(y.middleRows(begin, rows),
                            {{x_part, w, true}, {u.middleRows(begin, rows), b}, {x_part, w, true}}, part);
      EXPECT_EQ(part, all.middleRows(begin, rows));
    }
}

TEST_P(Kernels, TallProductsHaveTheBitsOfPlainLoops) {
  Random random(3);
  for (const Index rows : {1, 8, 21, 40})
    for (const Index inner : {1, 4, 9})
      for (const Index columns : {1, 2, 7}) {
        const Matrix all = random.matrix(rows + 3, inner + 1), w = random.matrix(columns, inner),
                     start = random.matrix(rows, columns);
        const auto x = all.block(2, 1, rows, inner);  // with a stride of its own
        Matrix result = start, expected = start;      // in place
        linalg::tall_products(result, {{x, w}, {x, w, true}}, result);
        for (const bool minus : {false, true})
          for (Index i = 0; i < inner; ++i)
            for (Index j = 0; j < columns; ++j)
              for (Index k = 0; k < rows; ++k) {
                const volatile double product = x(k, i) * w(j, i);  // not fused with the sum
                expected(k, j) = minus ? expected(k, j) - product : expected(k, j) + product;
              }
        EXPECT_EQ(result, expected);
      }
}

TEST_P(Kernels, GramSumsHaveTheBitsOfEightPartialSums) {
  Random random(4);
  for (const Index rows : {0, 8, 40, 104})
    for (const Index count : {0, 1, 3, 4, 9}) {
      const Matrix x = random.matrix(rows, count), before = random.matrix(count, count);  // the lower half is read
      std::vector<const double*> columns;
      for (Index j = 0; j < count; ++j) columns.push_back(x.col(j).data());
      Matrix sum = before;
      linalg::add_gram(columns, rows, sum);
      for (Index j = 0; j < count; ++j)
        for (Index i = 0; i < count; ++i) {
          double part[8] = {};
          for (Index k = 0; k < rows; ++k) {
            const volatile double product = x(k, i) * x(k, j);
            part[k % 8] += product;
          }
          for (const int apart : {4, 2, 1})
            for (int l = 0; l < apart; ++l) part[l] += part[l + apart];
          EXPECT_EQ(sum(i, j), before(std::max(i, j), std::min(i, j)) + part[0]);
        }
    }
  Matrix sum = Matrix::Zero(2, 2);
  const Matrix x = random.matrix(12, 3);
  const std::vector<const double*> two = {x.col(0).data(), x.col(1).data()};
  EXPECT_THROW(linalg::add_gram(two, 12, sum), std::logic_error);
  EXPECT_THROW(linalg::add_gram(std::vector<const double*>(3, x.data()), 8, sum), std::logic_error);
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
