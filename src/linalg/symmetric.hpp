// Small symmetric matrices: roots, logarithms and bounds of covariances and of moments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// (A + Aᵀ)/2, in place.
void symmetrise(Matrix& a);

// W (n × n, lower triangular) with W·S·Wᵀ = I, and log det S. A direction without variance, or with one at rounding
// level, has a row of zeros in W, and no part in the determinant: W·Wᵀ is then some generalised inverse of S.
double inverse_root(const Matrix& s, Matrix& w);

// U (n × n, upper triangular) with Uᵀ·U = S, positive semidefinite; rows of zeros for what has no variance.
Matrix upper_root(const Matrix& s);

// The covariance closest to S in likelihood, none of whose variances is below that of diag(floor): with F =
// diag(floor), the eigenvalues of F^{-1/2} S F^{-1/2} are raised to 1. `raised` tells whether any was.
Matrix bounded_below(const Matrix& s, const Vector& floor, bool* raised = nullptr);

// log(W·S·Wᵀ) for an invertible W, and the S of a given logarithm: coordinates of covariances without bounds.
Matrix logarithm(const Matrix& s, const Matrix& w);
Matrix exponential(const Matrix& log, const Matrix& w_inverse);

}  // namespace tokid::linalg
