// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/random_walk.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "linalg/simd.hpp"
#include "noise/random_walk_lanes.hpp"
#include "testing.hpp"

namespace tokid::testing {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

// The same problem as one dense least-squares problem in all coefficients.
std::vector<Matrix> dense(const std::vector<Matrix>& rows, Index l, const Vector& stiffness) {
  const Index steps = Index(rows.size()), q = rows[0].cols() - l;
  Index count = (steps - 1) * l;
  for (const Matrix& block : rows) count += block.rows();
  Matrix a = Matrix::Zero(count, steps * l), b = Matrix::Zero(count, q);
  Index at = 0;
  for (Index g = 0; g < steps; ++g) {
    const Matrix& block = rows[size_t(g)];
    a.block(at, g * l, block.rows(), l) = block.leftCols(l);
    b.middleRows(at, block.rows()) = block.rightCols(q);
    at += block.rows();
  }
  for (Index g = 0; g + 1 < steps; ++g, at += l) {
    a.block(at, g * l, l, l).diagonal() = -stiffness;
    a.block(at, (g + 1) * l, l, l).diagonal() = stiffness;
  }
  const Matrix x = linalg::minimum_norm(a, b, 1e-14).x;
  std::vector<Matrix> result;
  for (Index g = 0; g < steps; ++g) result.emplace_back(x.middleRows(g * l, l));
  return result;
}

std::vector<Matrix> random_rows(Random& random, const std::vector<Index>& counts, Index columns) {
  std::vector<Matrix> rows;
  for (const Index count : counts) rows.push_back(random.matrix(count, columns));
  return rows;
}

double difference(const std::vector<Matrix>& a, const std::vector<Matrix>& b) {
  double largest = 0;
  for (size_t g = 0; g < a.size(); ++g) largest = std::max(largest, (a[g] - b[g]).norm());
  return largest;
}

}  // namespace
TEST(RandomWalk, solves_the_dense_problem) {
  // Steps with more rows than coefficients, fewer, and none, in one chain.
  for (const Index l : {1, 3, 8})
    for (const Index q : {1, 2})
      for (const double weight : {1e-3, 1.0, 1e3}) {
        Random random(std::uint64_t(100 * l + q));
        const auto rows = random_rows(random, {2 * l, l, 0, 1, 3 * l, 0, 0, l + 2}, l + q);
        const Vector stiffness = weight * (Vector::Ones(l) + random.matrix(l, 1).cwiseAbs());
        const auto expected = dense(rows, l, stiffness);
        // Rounding errors of two orthogonal solutions, times the condition number (stiffness against rows).
        EXPECT_LT(difference(random_walk_regression(rows, l, stiffness), expected),
                  1e4 * epsilon * std::max(weight, 1 / weight) * double(rows.size() * size_t(l)))
            << l << " " << q << " " << weight;
      }
}

// The rows of [R Z] with an upper triangular R.
linalg::MatrixList triangular_rows(Random& random, Index steps, Index l, Index q) {
  linalg::MatrixList rows(steps, l, l + q);
  for (Index g = 0; g < steps; ++g) {
    auto block = rows[size_t(g)];
    block = random.matrix(l, l + q);
    block.leftCols(l).triangularView<Eigen::StrictlyLower>().setZero();
    if (g % 3 == 1) block.bottomRows(l - l / 2).setZero();  // a step that does not determine all coefficients
    if (g % 4 == 2) block.setZero();
  }
  return rows;
}

linalg::MatrixList regressions_of(const linalg::MatrixList& rows, Index begin, Index end, const Matrix& stiffness) {
  const WalkRows walks[] = {{rows, stiffness}};
  return random_walk_regressions(walks, begin, end).front();
}

TEST(RandomWalk, solves_columns_of_their_own_stiffness) {
  for (const Index l : {1, 2, 5, 9})
    for (const Index q : {1, 2, 4, 11})
      for (const double unit : {1.0, 1e-180, 1e120}) {
        Random random(std::uint64_t(100 * l + q));
        linalg::MatrixList rows = triangular_rows(random, 9, l, q);
        const Matrix stiffness = unit * (Matrix::Constant(l, q, 0.5) + random.matrix(l, q).cwiseAbs());
        for (size_t g = 0; g < 9; ++g) rows[g].leftCols(l) *= unit;
        constexpr Index begin = 1, end = 8;
        const linalg::MatrixList x = regressions_of(rows, begin, end, stiffness);
        // Together with a walk of another size, the bits are the same.
        const linalg::MatrixList others = triangular_rows(random, 9, 3, 2);
        const Matrix other_stiffness = Matrix::Ones(3, 2);
        const WalkRows both[] = {{others, other_stiffness}, {rows, stiffness}};
        const std::vector<linalg::MatrixList> together = random_walk_regressions(both, begin, end);
        EXPECT_EQ(together[0], regressions_of(others, begin, end, other_stiffness)) << l << " " << q << " " << unit;
        EXPECT_EQ(together[1], x) << l << " " << q << " " << unit;
        for (Index j = 0; j < q; ++j) {
          std::vector<Matrix> column, found;
          for (size_t g = begin; g < end; ++g) {
            column.push_back(linalg::beside(rows[g].leftCols(l) / unit, rows[g].col(l + j)));
            found.emplace_back(x[g - begin].row(j).transpose() * unit);
          }
          // Rounding errors of two orthogonal solutions, times the condition number (stiffness against rows).
          EXPECT_LT(difference(found, random_walk_regression(column, l, stiffness.col(j) / unit)),
                    1e3 * epsilon * double(9 * l))
              << l << " " << q << " " << unit;
        }
      }
}

TEST(RandomWalk, columns_are_the_same_bits_with_every_instruction_set) {
  Random random(5);
  const linalg::MatrixList rows = triangular_rows(random, 20, 6, 5);
  const Matrix stiffness = Matrix::Ones(6, 5) + random.matrix(6, 5).cwiseAbs();
  const linalg::MatrixList x = regressions_of(rows, 0, 20, stiffness);
  for (const simd::Target target : simd::targets()) {
    simd::limit_target(target);
    EXPECT_EQ(regressions_of(rows, 0, 20, stiffness), x) << simd::to_string(target);
  }
  simd::limit_target(simd::Target::avx512);
}

TEST(RandomWalk, gains_are_the_decrease_of_the_least_squares_with_loose_penalties) {
  for (const Index l : {1, 3})
    for (const double weight : {0.1, 1.0, 10.0}) {
      Random random(std::uint64_t(10 * l));
      const std::vector<Matrix> rows = random_rows(random, {2, l + 1, 0, 4, 1, 2 * l}, l + 2);
      const Vector stiffness = weight * (Vector::Ones(l) + random.matrix(l, 1).cwiseAbs());
      const auto minimum = [&](const std::vector<Index>& loose) {
        double sum = 0.0;
        const auto x = random_walk_regression(rows, l, stiffness, loose);
        for (size_t g = 0; g < rows.size(); ++g)
          sum += (rows[g].leftCols(l) * x[g] - rows[g].rightCols(2)).squaredNorm();
        for (size_t g = 1; g < rows.size(); ++g) {
          const bool is_loose = std::find(loose.begin(), loose.end(), Index(g)) != loose.end();
          sum += (is_loose ? loose_penalty : 1.0) * (stiffness.asDiagonal() * (x[g] - x[g - 1])).squaredNorm();
        }
        return sum;
      };
      const double all = minimum({});
      for (const Index width : {1, 2, 9}) {
        const Vector gains = loosening_gains(rows, stiffness, width);
        ASSERT_EQ(gains.size(), Index(rows.size()));
        EXPECT_EQ(gains(0), 0.0);
        for (Index g = 1; g < gains.size(); ++g) {
          std::vector<Index> loose;
          for (Index k = g; k < std::min(g + width, gains.size()); ++k) loose.push_back(k);
          // Differences of sums of squares, with rounding errors relative to the sums.
          EXPECT_NEAR(gains(g), all - minimum(loose), 1e3 * epsilon * (1 + all)) << l << " " << width << " " << g;
        }
      }
    }
  const std::vector<Matrix> rows{Matrix::Identity(1, 2), Matrix::Identity(1, 2)};
  for (const double wrong : {0.0, -1.0, std::numeric_limits<double>::infinity()})
    EXPECT_THROW(loosening_gains(rows, Vector::Constant(1, wrong), 1), std::invalid_argument);
  EXPECT_THROW(loosening_gains(rows, Vector::Ones(1), 0), std::invalid_argument);
}

TEST(RandomWalk, refuses_columns_of_wrong_sizes_or_stiffness) {
  Random random(6);
  const linalg::MatrixList rows = triangular_rows(random, 3, 4, 2);
  EXPECT_THROW(regressions_of(rows, 0, 3, Matrix::Ones(4, 3)), std::logic_error);
  EXPECT_THROW(regressions_of(rows, 0, 3, Matrix::Ones(5, 2)), std::logic_error);
  EXPECT_THROW(regressions_of(rows, 0, 3, Matrix::Zero(4, 2)), std::logic_error);
  EXPECT_THROW(regressions_of(rows, 0, 3, Matrix::Constant(4, 2, inf)), std::logic_error);
  EXPECT_THROW(regressions_of(rows, 1, 4, Matrix::Ones(4, 2)), std::logic_error);
  EXPECT_THROW(regressions_of(rows, 2, 1, Matrix::Ones(4, 2)), std::logic_error);
  EXPECT_EQ(regressions_of(rows, 2, 2, Matrix::Ones(4, 2)).size(), 0);
}

TEST(RandomWalk, without_stiffness_each_step_stands_alone) {
  Random random(1);
  const auto rows = random_rows(random, {9, 9, 4}, 7);
  const auto x = random_walk_regression(rows, 5, Vector::Zero(5));
  for (size_t g = 0; g < 2; ++g) {
    const Matrix r = rows[g].leftCols(5), residual = rows[g].rightCols(2) - r * x[g];
    EXPECT_LT((r.transpose() * residual).norm(), 100 * epsilon * rows[g].squaredNorm());
  }
  EXPECT_LT((rows[2].leftCols(5) * x[2] - rows[2].rightCols(2)).norm(), 1e3 * epsilon * rows[2].norm());
}

TEST(RandomWalk, infinite_stiffness_is_the_limit_of_large_stiffness) {
  Random random(2);
  const auto rows = random_rows(random, {6, 2, 0, 7, 5}, 6);
  const auto one = random_walk_regression(rows, 4, Vector::Constant(4, inf));
  const auto nearly = random_walk_regression(rows, 4, Vector::Constant(4, 1e6));
  for (size_t g = 0; g < rows.size(); ++g) {
    EXPECT_EQ(one[g], one[0]);
    EXPECT_LT((one[g] - nearly[g]).norm(), 1e-9);  // the limit is reached as 1/stiffness²
  }
}

TEST(RandomWalk, a_coefficient_without_data_is_zero) {
  Random random(3);
  auto rows = random_rows(random, {6, 7, 8}, 5);
  for (Matrix& block : rows) block.col(1).setZero();
  for (const auto& x : random_walk_regression(rows, 4, Vector::Constant(4, 2.0)))
    EXPECT_LT(std::abs(x(1, 0)), 100 * epsilon);
}

// Steps that do not show a coefficient have that of their neighbours, however weak the coupling: squares of 1e-160 are
// zero.
TEST(RandomWalk, weak_coupling_is_no_less_exact) {
  const Matrix blind{{0.0, 0.0, 0.0}, {0.0, 1.0, 1.0}}, seeing{{1.0, 0.0, 1.0}, {0.0, 1.0, 1.0}};
  for (const double stiffness : {1.0, 1e-100, 1e-150, 1e-155, 1e-160, 1e-200, 1e-300})
    for (const Matrix& x : random_walk_regression({blind, blind, seeing}, 2, Vector::Constant(2, stiffness)))
      EXPECT_LT((x - Matrix::Ones(2, 1)).norm(), 100 * epsilon) << stiffness;
}

TEST(RandomWalk, refuses_what_does_not_fit) {
  Random random(4);
  const auto rows = random_rows(random, {6, 6}, 5);
  EXPECT_THROW(random_walk_regression(rows, 4, Vector::Ones(3)), std::invalid_argument);
  EXPECT_THROW(random_walk_regression(rows, 4, Vector::Constant(4, -1.0)), std::invalid_argument);
  EXPECT_THROW(random_walk_regression(rows, 6, Vector::Ones(6)), std::invalid_argument);
  EXPECT_THROW(random_walk_regression(rows, 4, Vector::Unit(4, 2)), std::invalid_argument);
  EXPECT_THROW(random_walk_regression(std::vector<Matrix>{rows[0], random.matrix(3, 4)}, 4, Vector::Ones(4)),
               std::invalid_argument);
  EXPECT_TRUE(random_walk_regression(std::vector<Matrix>{}, 4, Vector::Ones(4)).empty());
}

}  // namespace tokid::testing
