// SPDX-License-Identifier: BSD-3-Clause
#include "model/kalman_step.hpp"

#include "linalg/symmetric.hpp"

namespace tokid::kalman {

namespace {

// Directions of the innovations are only rounding errors below this share of the largest direction.
constexpr double singular = 1e-12;

}  // namespace

// F P Fᵀ + Q
void propagate(const Matrix& p, const Matrix& f, const ConstMatrixRef& q, Matrix& fp, Matrix& result) {
  fp.noalias() = f * p;
  result = q;
  result.noalias() += fp * f.transpose();
  linalg::symmetrise(result);
}

// S = H P Hᵀ + R,   K = P Hᵀ S⁻¹ (69),   P' = (I - K H) P (I - K H)ᵀ + K R Kᵀ. Then A P' Aᵀ + Q is (61).
void correct(const Matrix& p, const Matrix& h, const Matrix& r, Workspace& work, Correction& c) {
  propagate(p, h, r, work.hp, work.innovation);
  c.log_det = linalg::inverse_root(work.innovation, c.whitener);
  work.whp.noalias() = c.whitener * work.hp;
  c.gain.noalias() = work.whp.transpose() * c.whitener;
  work.left.setIdentity(p.rows(), p.rows());
  work.left.noalias() -= c.gain * h;
  work.product.noalias() = work.left * p;
  c.filtered.noalias() = work.product * work.left.transpose();
  work.noise.noalias() = c.gain * r;
  c.filtered.noalias() += work.noise * c.gain.transpose();
  linalg::symmetrise(c.filtered);
}

void leave_out_missing(const std::vector<Index>& there, Matrix& h, Matrix& r) {
  each_missing(there, h.rows(), [&](Index j) {
    h.row(j).setZero();
    r.row(j).setZero();
    r.col(j).setZero();
    r(j, j) = 1.0;
  });
}

// The gain K of the best prediction of `rest` by `seen` (69), for roots of covariances: Kᵀ = seen⁺ rest. What it cannot
// predict remains in `rest`, the root of the covariance after the update, which (61) propagates.
Matrix prediction_gain(const Matrix& seen, Matrix& rest) {
  Vector scale = seen.colwise().norm();  // makes the result independent of the units of the outputs
  scale = (scale.array() > 0).select(scale.cwiseInverse(), 1.0);
  const Matrix transposed = scale.asDiagonal() * linalg::minimum_norm(seen * scale.asDiagonal(), rest, singular).x;
  rest -= seen * transposed;
  return transposed.transpose();
}

Matrix next_root(const Matrix& rest, const Matrix& noise) {
  Matrix both = linalg::stacked(rest, noise);
  return linalg::triangular_factor(both);
}

Matrix covariance_of(const Matrix& root) {
  Matrix product = Matrix::Zero(root.cols(), root.cols());
  linalg::add_squares(root, product);
  product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
  return product;
}

}  // namespace tokid::kalman
