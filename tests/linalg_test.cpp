// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/linalg.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <complex>

#include "testing.hpp"

namespace tokid::testing {
namespace {

struct Shape {
  Index rows, cols;
};
class Factorisations : public ::testing::TestWithParam<Shape> {
 protected:
  const Index rows = GetParam().rows, cols = GetParam().cols;
  Matrix a = Random(std::uint64_t(1 + rows * 100 + cols)).matrix(rows, cols);
  // Backward errors of orthogonal factorisations: a modest multiple of ε × size × norm.
  const double tolerance = 10 * epsilon * double(std::max(rows, cols)) * a.norm();
};

TEST_P(Factorisations, SvdReproducesTheMatrix) {
  const linalg::Svd d = linalg::svd(a);
  const Index k = std::min(rows, cols);
  EXPECT_LE((d.u * d.s.asDiagonal() * d.v.transpose() - a).norm(), tolerance);
  EXPECT_LE((d.u.transpose() * d.u - Matrix::Identity(k, k)).norm(), tolerance);
  EXPECT_LE((d.v.transpose() * d.v - Matrix::Identity(k, k)).norm(), tolerance);
  for (Index i = 1; i < k; ++i) EXPECT_LE(d.s(i), d.s(i - 1));
}

TEST_P(Factorisations, TriangularFactorHasTheGramMatrix) {
  Matrix copy = a;
  const Matrix r = linalg::triangular_factor(copy);
  ASSERT_EQ(r.rows(), std::min(rows, cols));
  EXPECT_LE((r.transpose() * r - a.transpose() * a).norm(), tolerance * a.norm());
  for (Index i = 0; i < r.rows(); ++i)
    for (Index j = 0; j < i; ++j) EXPECT_EQ(r(i, j), 0.0);
}

TEST(Solve, LeavesResidualsOfRounding) {
  for (const Index n : {1, 2, 5, 12, 40}) {
    Random random(std::uint64_t(300 + n));
    const Matrix a = random.matrix(n, n), b = random.matrix(n, 3), x = linalg::solve(a, b);
    // Partial pivoting is stable but for a growth of the pivots, which is modest in random matrices.
    EXPECT_LE((a * x - b).norm(), 10 * epsilon * double(n) * (a.norm() * x.norm() + b.norm())) << n;
  }
}

// What is said of a singular matrix: the solution is not finite, or huge, and never passes for a sound one.
TEST(Solve, OfASingularMatrixIsNotFiniteOrHuge) {
  for (const Index n : {1, 2, 5, 12, 40}) {
    SCOPED_TRACE(n);
    Random random(std::uint64_t(350 + n));
    const Matrix b = random.matrix(n, 3);
    EXPECT_FALSE(linalg::solve(Matrix::Zero(n, n), b).allFinite());
    Matrix row = random.matrix(n, n);
    row.row(n / 2).setZero();
    EXPECT_FALSE(linalg::solve(row, b).allFinite());
    if (n == 1) continue;
    // Of rank n - 1 within rounding: a pivot of n ε at most times the largest entries stands for zero.
    const Matrix rank = random.matrix(n, n - 1) * random.matrix(n - 1, n), x = linalg::solve(rank, b);
    EXPECT_TRUE(!x.allFinite() || x.norm() * rank.norm() > 1e-3 / epsilon / double(n * n) * b.norm());
  }
}

TEST(SymmetricEigensystem, ReproducesTheMatrixOfItsLowerTriangle) {
  for (const Index n : {1, 2, 5, 12, 40}) {
    Random random(std::uint64_t(400 + n));
    const Matrix half = random.matrix(n, n);
    const Matrix s = half + half.transpose();
    Matrix lower = s;
    for (Index j = 1; j < n; ++j) lower.col(j).head(j).setConstant(nan);
    const auto [values, vectors] = linalg::symmetric_eigensystem(lower);
    const double tolerance = 10 * epsilon * double(n);
    EXPECT_LE((vectors * values.asDiagonal() * vectors.transpose() - s).norm(), tolerance * s.norm()) << n;
    EXPECT_LE((vectors.transpose() * vectors - Matrix::Identity(n, n)).norm(), tolerance) << n;
    for (Index i = 1; i < n; ++i) EXPECT_LE(values(i - 1), values(i)) << n;
  }
}

// Of every number of columns beside one another, odd and even lengths, more columns than rows, zeros among them; and
// one that is too large for the caches.
TEST(TriangularFactor, IsThatOfEigen) {
  Random random(7);
  for (const auto& [rows, cols] : std::vector<std::pair<Index, Index>>{{1, 1},
                                                                       {1, 7},
                                                                       {2, 3},
                                                                       {5, 5},
                                                                       {6, 11},
                                                                       {9, 4},
                                                                       {17, 8},
                                                                       {30, 14},
                                                                       {41, 26},
                                                                       {70, 54},
                                                                       {60, 90},
                                                                       {400, 100}}) {
    Matrix a = random.matrix(rows, cols);
    if (cols > 3) a.col(2).setZero(), a.row(rows / 2).setZero();
    Matrix copy = a;
    const Matrix r = linalg::triangular_factor(copy);
    const Matrix expected =
        Eigen::HouseholderQR<Matrix>(a).matrixQR().topRows(std::min(rows, cols)).triangularView<Eigen::Upper>();
    // Both are backward stable, and the condition of these matrices is that of random ones, below their size.
    EXPECT_LE((r - expected).norm(), 10 * epsilon * double(std::max(rows, cols)) * a.norm()) << rows << " x " << cols;
  }
}

// Every column keeps its own digits, whatever its size and that of the others, and whether squares leave the range of
// double precision or not.
TEST(TriangularFactor, KeepsTheDigitsOfEveryColumn) {
  Random random(8);
  for (const double size : {1e-300, 1e-200, 1e-160, 1e-150, 1.0, 1e150, 1e160, 1e300})
    for (const bool graded : {false, true}) {
      const Index rows = 20, cols = 8;
      const Matrix plain = random.matrix(rows, cols);
      Vector scale = Vector::Constant(cols, size);
      for (Index j = 1; graded && j < cols; j += 2) scale(j) = 1.0;
      Matrix a = plain * scale.asDiagonal(), copy = a;
      const Matrix r = linalg::triangular_factor(copy);
      ASSERT_TRUE(r.allFinite()) << size;
      const Matrix unscaled = r * scale.cwiseInverse().asDiagonal();
      EXPECT_LE((unscaled.transpose() * unscaled - plain.transpose() * plain).norm(),
                10 * epsilon * double(rows) * plain.squaredNorm())
          << size << ", graded " << graded;
    }
}

TEST(TriangularFactor, ShowsWhatIsNotFinite) {
  for (const double wrong : {std::nan(""), std::numeric_limits<double>::infinity()})
    for (const Index at : {0, 3}) {
      Matrix a = Random(9).matrix(6, 3);
      a.col(0).setZero();
      a(at, 0) = wrong;
      EXPECT_FALSE(linalg::triangular_factor(a).allFinite()) << wrong << " at " << at;
    }
}

TEST_P(Factorisations, MinimumNormSolutionSolvesTheNormalEquationsAndHasNoNullPart) {
  const Matrix b = Random(5).matrix(rows, 2);
  const linalg::MinimumNorm solution = linalg::minimum_norm(a, b, 1e-13);
  EXPECT_EQ(solution.rank, std::min(rows, cols));
  EXPECT_LE((a.transpose() * (a * solution.x - b)).norm(), tolerance * a.norm() * b.norm());
  EXPECT_LE((solution.x - linalg::pseudo_inverse(a) * b).norm(), 100 * tolerance * solution.condition);
}

TEST_P(Factorisations, InverseFactorCarriesTheInverseGramMatrix) {
  const linalg::MinimumNorm solution = linalg::minimum_norm(a, Matrix::Zero(rows, 1), 1e-13);
  const Matrix gram_inverse = linalg::pseudo_inverse(a.transpose() * a, 1e-10);
  const Matrix x = solution.inverse_t;
  EXPECT_LE((x * x.transpose() - gram_inverse).norm(),
            100 * tolerance * solution.condition * solution.condition * gram_inverse.norm());
}

TEST_P(Factorisations, RowStackHasTheGramMatrixOfAllItsBlocks) {
  linalg::RowStack stack(cols);
  EXPECT_EQ(stack.factor().rows(), 0);
  for (Index row = 0; row < rows; ++row) stack.add(a.row(row));
  for (int block = 0; block < 9; ++block) stack.add(a);
  const Matrix r = stack.factor();
  ASSERT_LE(r.rows(), cols);
  EXPECT_LE((r.transpose() * r - 10 * a.transpose() * a).norm(), 10 * tolerance * a.norm());
}

INSTANTIATE_TEST_SUITE_P(Shapes, Factorisations,
                         ::testing::Values(Shape{1, 1}, Shape{5, 1}, Shape{1, 5}, Shape{7, 7}, Shape{50, 12},
                                           Shape{12, 30}, Shape{40, 40}),
                         [](const auto& test) {
                           return std::to_string(test.param.rows) + "x" + std::to_string(test.param.cols);
                         });

// Divide-and-conquer routines have failed here: matrices whose rank is deficient to the last bit.
TEST(Svd, ReproducesMatricesWithExactlyDependentRows) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random random(seed);
    Matrix a(16, 48);
    a.topRows(12) = random.matrix(12, 48);
    a.bottomRows(4) = 0.1 * random.matrix(4, 12) * a.topRows(12);
    const linalg::Svd d = linalg::svd(a);
    EXPECT_LE((d.u * d.s.asDiagonal() * d.v.transpose() - a).norm(), 500 * epsilon * a.norm()) << seed;
  }
}

TEST(MinimumNorm, RankDeficientProblemsGetTheSmallestSolution) {
  Random random(2);
  const Matrix a = random.matrix(20, 4) * random.matrix(4, 9), b = random.matrix(20, 3);
  const linalg::MinimumNorm solution = linalg::minimum_norm(a, b, 1e-12);
  EXPECT_EQ(solution.rank, 4);
  EXPECT_LE((solution.x - linalg::pseudo_inverse(a, 1e-12) * b).norm(), 1e4 * epsilon * solution.x.norm());
  const Matrix x = solution.inverse_t, gram = a.transpose() * a;
  EXPECT_EQ(x.cols(), 4);
  // X Xᵀ is the pseudo-inverse of the Gram matrix: G X Xᵀ G = G.
  EXPECT_LE((gram * x * x.transpose() * gram - gram).norm(), 1e5 * epsilon * gram.norm());
}

TEST(MinimumNorm, ConditionIsWithinTheDimensionOfTheTrueOne) {
  Random random(3);
  for (const double smallest : {1.0, 1e-4, 1e-9}) {
    const Vector s = Vector::LinSpaced(6, 0.0, std::log(smallest)).array().exp();
    const Matrix a = random.orthogonal(6) * s.asDiagonal() * random.orthogonal(6);
    const double condition = linalg::minimum_norm(a, Matrix::Zero(6, 1), 1e-14).condition;
    EXPECT_GE(condition, 0.99 / smallest);
    EXPECT_LE(condition, 6.1 / smallest);
  }
}

TEST(MinimumNorm, ZeroMatrixHasRankZeroAndSolutionZero) {
  const linalg::MinimumNorm solution = linalg::minimum_norm(Matrix::Zero(5, 3), Matrix::Ones(5, 1), 1e-13);
  EXPECT_EQ(solution.rank, 0);
  EXPECT_EQ(solution.x.norm(), 0.0);
}

TEST(MinimumNorm, EmptyMatricesHaveEmptySolutions) {
  EXPECT_EQ(linalg::minimum_norm(Matrix(4, 0), Matrix::Ones(4, 2), 1e-13).x.rows(), 0);
  EXPECT_EQ(linalg::minimum_norm(Matrix(0, 3), Matrix(0, 2), 1e-13).x, Matrix::Zero(3, 2));
}

TEST(Whitener, WhitensAndSurvivesSingularCovariances) {
  const Matrix root = Random(4).matrix(3, 3), s = root * root.transpose();
  const Matrix w = linalg::whitener(s);
  EXPECT_LE((w * s * w.transpose() - Matrix::Identity(3, 3)).norm(), 1e4 * epsilon);
  EXPECT_EQ(linalg::whitener(Matrix::Zero(2, 2)), Matrix::Identity(2, 2));
  const Matrix singular = Vector::Ones(3) * Vector::Ones(3).transpose();
  EXPECT_TRUE(linalg::whitener(singular).allFinite());
  // Units that differ by twelve orders of magnitude change nothing.
  const Vector units{{1e6, 1.0, 1e-6}};
  const Matrix scaled = units.asDiagonal() * s * units.asDiagonal();
  const Matrix v = linalg::whitener(scaled);
  EXPECT_LE((v * scaled * v.transpose() - Matrix::Identity(3, 3)).norm(), 1e4 * epsilon);
}

TEST(CovarianceFactor, SquaresToTheCovarianceOrRefuses) {
  Random random(12);
  for (const Index rank : {0, 1, 3, 5}) {
    const Matrix f = random.matrix(5, rank);
    Vector unit{{1e-9, 1.0, 1e9, 1.0, 0.0}};
    const Matrix s = unit.asDiagonal() * (f * f.transpose()) * unit.asDiagonal();
    const std::optional<Matrix> factor = linalg::covariance_factor(s);
    ASSERT_TRUE(factor) << rank;
    // Entry by entry, in units of the standard deviations: small channels keep their digits beside large ones.
    const Vector size = s.diagonal().cwiseSqrt();
    const Matrix error = (*factor * factor->transpose() - s).cwiseAbs();
    EXPECT_LE((error.array() - 100 * epsilon * (size * size.transpose()).array()).maxCoeff(), 0.0) << rank;
  }
  EXPECT_TRUE(linalg::covariance_factor(Matrix(0, 0)));
  EXPECT_FALSE(linalg::covariance_factor(Matrix{{1, 2}, {2, 1}}));    // an eigenvalue of -1
  EXPECT_FALSE(linalg::covariance_factor(Matrix{{1, 0.5}, {0, 1}}));  // not symmetric
  EXPECT_FALSE(linalg::covariance_factor(Matrix{{0, 0.5}, {0.5, 1}}));
  EXPECT_FALSE(linalg::covariance_factor(Matrix::Constant(1, 1, -1.0)));
  EXPECT_FALSE(linalg::covariance_factor(Matrix::Ones(2, 3)));
  EXPECT_FALSE(linalg::covariance_factor(Matrix::Constant(1, 1, std::numeric_limits<double>::quiet_NaN())));
}

// Random matrices have distinct eigenvalues; the rounding errors of the left vectors grow with the condition of the
// right.
TEST(Eigensystem, DiagonalisesFromBothSides) {
  Random random(8);
  for (const Index n : {1, 2, 3, 6, 12}) {
    const Matrix a = random.matrix(n, n);
    const linalg::Eigensystem system = linalg::eigensystem(a);
    const Eigen::MatrixXcd identity = Eigen::MatrixXcd::Identity(n, n);
    const double condition = system.right.norm() * system.left.norm();
    EXPECT_LE((a * system.right - system.right * system.values.asDiagonal()).norm(),
              1e2 * epsilon * double(n) * a.norm())
        << n;
    EXPECT_LE((system.left * system.right - identity).norm(), 1e2 * epsilon * double(n) * condition) << n;
    EXPECT_LE((system.values - linalg::eigenvalues(a)).norm(), 1e2 * epsilon * double(n) * a.norm() * condition) << n;
  }
  EXPECT_EQ(linalg::eigensystem(Matrix(0, 0)).values.size(), 0);
}

TEST(Eigensystem, SaysWhereThereIsNone) {
  const Matrix chain{{1, 1}, {0, 1}};  // one eigenvector for two eigenvalues
  const linalg::Eigensystem none = linalg::eigensystem(chain);
  EXPECT_EQ(none.values, Eigen::VectorXcd::Ones(2));
  EXPECT_FALSE(none.left.norm() < 1 / (10 * epsilon));
  for (const double wrong : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    Matrix a = Random(9).matrix(6, 6);
    a(3, 1) = wrong;
    EXPECT_TRUE(linalg::eigenvalues(a).array().isNaN().all());
    const linalg::Eigensystem system = linalg::eigensystem(a);
    EXPECT_TRUE(system.values.array().isNaN().all());
    EXPECT_TRUE(system.right.array().isNaN().all() && system.left.array().isNaN().all());
    EXPECT_EQ(system.values.size(), 6);
  }
  EXPECT_THROW(linalg::eigenvalues(Matrix(2, 3)), std::invalid_argument);
  EXPECT_THROW(linalg::eigensystem(Matrix(3, 2)), std::invalid_argument);
  EXPECT_THROW(linalg::eigenvalues(Matrix(0, 3)), std::invalid_argument);
}

TEST(Procrustes, FindsTheRotation) {
  Random random(6);
  const Matrix a = random.matrix(10, 4), q = random.orthogonal(4);
  EXPECT_LE((linalg::procrustes(a, a * q) - q).norm(), 1e3 * epsilon);
}

}  // namespace
}  // namespace tokid::testing
