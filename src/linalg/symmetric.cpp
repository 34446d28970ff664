// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/symmetric.hpp"

#include <cmath>
#include <limits>

#include "linalg/elementary.hpp"

namespace tokid::linalg {

namespace {

// A pivot is a rounding error if it is below this factor, times n, times the variance of its row.
constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();

// Replaces l by its lower Cholesky factor. A column becomes zero if its pivot is a rounding error.
void cholesky(Eigen::Ref<Matrix> l) {
  const Index n = l.rows();
  for (Index j = 0; j < n; ++j) {
    const double variance = l(j, j), pivot = variance - l.row(j).head(j).squaredNorm();
    if (!(pivot > rounding * double(n) * variance)) {
      l.col(j).tail(n - j).setZero();
      continue;
    }
    const double root = std::sqrt(pivot);
    l(j, j) = root;
    for (Index i = j + 1; i < n; ++i) l(i, j) = (l(i, j) - l.row(i).head(j).dot(l.row(j).head(j))) / root;
  }
  l.triangularView<Eigen::StrictlyUpper>().setZero();
}

}  // namespace

void symmetrise(Matrix& a) {
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < j; ++i) a(i, j) = a(j, i) = 0.5 * (a(i, j) + a(j, i));
}

double inverse_root(const Matrix& s, Matrix& w) {
  w = s;
  cholesky(w);
  double log_det = 0.0;
  // Computes the inverse from the first row down: its row i needs the rows above it and row i of the factor.
  for (Index i = 0; i < w.rows(); ++i) {
    if (w(i, i) == 0) {
      w.row(i).head(i).setZero();
      continue;
    }
    const double root = w(i, i);
    log_det += 2 * log(root);
    for (Index j = 0; j < i; ++j) {
      double sum = 0.0;
      for (Index k = j; k < i; ++k) sum += w(i, k) * w(k, j);
      w(i, j) = -sum / root;  // entries (i, k < j) of the factor are no longer needed
    }
    w(i, i) = 1 / root;
  }
  return log_det;
}

void take_upper_root(Eigen::Ref<Matrix> s) {
  cholesky(s);
  s.transposeInPlace();
}

Matrix bounded_below(const Matrix& s, const Vector& floor, bool* raised) {
  if (raised) *raised = false;
  if (s.size() == 0) return s;
  const Vector root = floor.cwiseSqrt();
  const auto scaled =
      linalg::symmetric_eigensystem(root.cwiseInverse().asDiagonal() * s * root.cwiseInverse().asDiagonal());
  if (scaled.values(0) >= 1) return s;
  if (raised) *raised = true;
  const Matrix vectors = root.asDiagonal() * scaled.vectors;
  return vectors * scaled.values.cwiseMax(1.0).asDiagonal() * vectors.transpose();
}

Matrix logarithm(const Matrix& s, const Matrix& w) {
  if (s.size() == 0) return s;
  const auto scaled = linalg::symmetric_eigensystem(w * s * w.transpose());
  const Vector logs = scaled.values.cwiseMax(std::numeric_limits<double>::min()).unaryExpr(&linalg::log);
  return scaled.vectors * logs.asDiagonal() * scaled.vectors.transpose();
}

Matrix exponential(const Matrix& log, const Matrix& w_inverse) {
  if (log.size() == 0) return log;
  const auto scaled = linalg::symmetric_eigensystem(log);
  const Matrix vectors = w_inverse * scaled.vectors;
  return vectors * scaled.values.unaryExpr(&linalg::exp).asDiagonal() * vectors.transpose();
}

}  // namespace tokid::linalg
