// Small symmetric matrices: roots, logarithms and bounds of covariances and of moments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// (A + Aᵀ)/2, in place.
void symmetrise(Matrix& a);

// Adds XᵀX to the lower triangle of the sum. Eigen divides by zero if X has no rows and many columns.
inline void add_squares(const Matrix& x, Matrix& sum) {
  if (x.rows() > 0) sum.selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
}

// W (n × n, lower triangular) with W·S·Wᵀ = I; returns log det S. A direction whose variance is zero, or a rounding
// error, has a zero row in W and does not count in the determinant. Wᵀ·W is then a generalised inverse of S.
double inverse_root(const Matrix& s, Matrix& w);

// Replaces a positive semidefinite S (n × n) by U, upper triangular with Uᵀ·U = S. The row of a direction without
// variance is zero.
void take_upper_root(Eigen::Ref<Matrix> s);

// The most likely covariance for the sample covariance S that has at least the variance of F = diag(floor) in every
// direction. The eigenvalues of F^{-1/2} S F^{-1/2} below 1 are raised to 1. `raised` is set to true if any eigenvalue
// was raised.
Matrix bounded_below(const Matrix& s, const Vector& floor, bool* raised = nullptr);

// log(W·S·Wᵀ) for an invertible W, and the S that has a given logarithm. The logarithm may be any symmetric matrix, so
// that an iteration can change it freely.
Matrix logarithm(const Matrix& s, const Matrix& w);
Matrix exponential(const Matrix& log, const Matrix& w_inverse);

}  // namespace tokid::linalg
