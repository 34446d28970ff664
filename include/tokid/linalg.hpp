// The only interface to a dense linear algebra backend. Every routine is single-threaded and deterministic.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "tokid/types.hpp"

namespace tokid::linalg {

// Thin singular value decomposition a = u · diag(s) · vᵀ, singular values in decreasing order.
struct Svd {
  Matrix u;  // (rows × k), k = min(rows, cols)
  Vector s;  // (k)
  Matrix v;  // (cols × k)
};
Svd svd(const ConstMatrixRef& a);

// Singular values only, in decreasing order.
Vector singular_values(const ConstMatrixRef& a);

// Overwrites a (rows × cols) by its Householder QR factorisation and returns the upper triangular, or for
// rows < cols upper trapezoidal, factor (min(rows, cols) × cols). The lower part of `a` is left undefined.
Matrix triangular_factor(Matrix& a);

// [above; below] of matrices with equally many columns; either may have no rows.
Matrix stacked(const ConstMatrixRef& above, const ConstMatrixRef& below);
// [left right] of matrices with equally many rows; either may have no columns.
Matrix beside(const ConstMatrixRef& left, const ConstMatrixRef& right);

// (cols of a): inverse norms of the columns; 1 for zero columns, so that scaled zero columns stay zero.
Vector inverse_norms(const ConstMatrixRef& a);

// The triangular factor of rows that arrive in blocks. The memory does not grow with the number of rows.
class RowStack {
 public:
  explicit RowStack(Index cols) : rows_(0, cols) {}
  void add(const ConstMatrixRef& block);
  Matrix factor();  // (min(rows, cols) × cols)

 private:
  Matrix rows_;  // only the first used_ rows are valid
  Index used_ = 0;
};

// Orthonormal factor (rows × cols) of a full QR factorisation; needs rows ≥ cols.
Matrix orthonormal_factor(Matrix a);

// Least-squares solution of a·x = b with the smallest norm, by a complete orthogonal decomposition.
// Pivots below `tolerance` times the largest count as zero.
struct MinimumNorm {
  Matrix x;                // (cols of a × cols of b)
  Index rank = 0;          // numerical rank of a
  double condition = 0.0;  // upper estimate ‖T‖_F ‖T⁻¹‖_F of the condition number of the part of rank `rank`
  Matrix inverse_t;  // (cols of a × rank): X with X·Xᵀ = (aᵀa)⁺; the covariance of x is proportional to X·Xᵀ
};
MinimumNorm minimum_norm(const ConstMatrixRef& a, const ConstMatrixRef& b, double tolerance);

// Moore-Penrose inverse (cols × rows); singular values below tolerance·s_max count as zero. The default is
// 8·ε·max(rows, cols).
Matrix pseudo_inverse(const ConstMatrixRef& a, double tolerance = -1.0);

// A matrix W (n × n) with W·S·Wᵀ = I for a symmetric positive definite S. So that whitening never divides by zero, the
// size of rounding errors is first added to the diagonal of S, and S = 0 gives the identity.
Matrix whitener(const ConstMatrixRef& s);

// A matrix F (n × n) with F·Fᵀ = S for a symmetric positive semidefinite S; empty for any other S. Asymmetries and
// negative eigenvalues up to 1e-10 of the diagonal count as rounding errors. Eigenvalues below 4·n·ε times the largest
// eigenvalue of the correlation matrix count as zero.
std::optional<Matrix> covariance_factor(const ConstMatrixRef& s);

// a⁻¹·b for a (n × n) and b (n × cols), by an LU decomposition with partial pivoting. Not finite, or very large, if a
// is singular.
Matrix solve(const ConstMatrixRef& a, const ConstMatrixRef& b);

// s = vectors · diag(values) · vectorsᵀ for a symmetric s (n × n); only the lower triangle is read.
struct SymmetricEigensystem {
  Vector values;   // (n), in increasing order
  Matrix vectors;  // (n × n), orthogonal
};
SymmetricEigensystem symmetric_eigensystem(const ConstMatrixRef& s);
Vector symmetric_eigenvalues(const ConstMatrixRef& s);  // ascending

// Eigenvalues (n) of a (n × n), in arbitrary order, with conjugate pairs together. All are NaN if a is not finite or
// the iteration does not converge. \throws std::invalid_argument where a is not square
Eigen::VectorXcd eigenvalues(const ConstMatrixRef& a);

// The same eigenvalues, with right and left eigenvectors: a·right = right·diag(values), left = right⁻¹ (rows, so that
// left·right = I). If a has no basis of eigenvectors, left is not finite or very large.
struct Eigensystem {
  Eigen::VectorXcd values;       // (n)
  Eigen::MatrixXcd right, left;  // (n × n)
};
Eigensystem eigensystem(const ConstMatrixRef& a);

// Orthogonal matrix Q (a.cols × b.cols, a.cols = b.cols) that minimises ‖a·Q - b‖_F (orthogonal Procrustes).
Matrix procrustes(const ConstMatrixRef& a, const ConstMatrixRef& b);

}  // namespace tokid::linalg
