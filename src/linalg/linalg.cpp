// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/linalg.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "linalg/reflection.hpp"

namespace tokid::linalg {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

}  // namespace

Svd svd(const ConstMatrixRef& a) {
  if (a.size() == 0) return {Matrix(a.rows(), 0), Vector(0), Matrix(a.cols(), 0)};
  // Eigen's BDCSVD is not used. In Eigen 3.4, it returns wrong vectors for some exactly rank-deficient matrices, such
  // as the Hankel matrices H_k.
  const Eigen::JacobiSVD<Matrix> decomposition(a, Eigen::ComputeThinU | Eigen::ComputeThinV);
  return {decomposition.matrixU(), decomposition.singularValues(), decomposition.matrixV()};
}

Vector singular_values(const ConstMatrixRef& a) {
  if (a.size() == 0) return Vector(0);
  return Eigen::JacobiSVD<Matrix>(a).singularValues();
}

Matrix triangular_factor(Matrix& a) {
  const Index size = std::min(a.rows(), a.cols());
  if (size == 0) return Matrix(0, a.cols());
  constexpr Index cached = Index{1} << 15;  // entries in 256 KiB; Eigen factorises larger matrices in blocks of columns
  if (a.size() > cached)
    const Eigen::HouseholderQR<Eigen::Ref<Matrix>> in_place(a);
  else
    triangularise(a, a.rows());
  return a.topRows(size).triangularView<Eigen::Upper>();
}

Matrix stacked(const ConstMatrixRef& above, const ConstMatrixRef& below) {
  Matrix both(above.rows() + below.rows(), std::max(above.cols(), below.cols()));
  if (above.rows() > 0) both.topRows(above.rows()) = above;
  if (below.rows() > 0) both.bottomRows(below.rows()) = below;
  return both;
}

Matrix beside(const ConstMatrixRef& left, const ConstMatrixRef& right) {
  Matrix both(left.rows(), left.cols() + right.cols());
  both << left, right;
  return both;
}

Vector inverse_norms(const ConstMatrixRef& a) {
  Vector scales = a.colwise().norm();
  for (double& s : scales) s = s > 0 ? 1 / s : 1.0;
  return scales;
}

void RowStack::add(const ConstMatrixRef& block) {
  const Index cols = rows_.cols(), room = 4 * cols;
  if (used_ > 0 && used_ + block.rows() > room) factor();
  const Index needed = used_ + block.rows();
  if (needed > rows_.rows()) rows_.conservativeResize(std::max(needed, std::min(room, 2 * needed)), cols);
  rows_.middleRows(used_, block.rows()) = block;
  used_ = needed;
}

Matrix RowStack::factor() {
  Matrix all = rows_.topRows(used_);
  Matrix result = triangular_factor(all);
  used_ = result.rows();
  rows_.topRows(used_) = result;
  return result;
}

Matrix orthonormal_factor(Matrix a) {
  const Index rows = a.rows(), cols = a.cols();
  const Eigen::HouseholderQR<Eigen::Ref<Matrix>> in_place(a);
  return in_place.householderQ() * Matrix::Identity(rows, cols);
}

MinimumNorm minimum_norm(const ConstMatrixRef& a, const ConstMatrixRef& b, double tolerance) {
  if (a.size() == 0) return {Matrix::Zero(a.cols(), b.cols()), 0, 0.0, Matrix(a.cols(), 0)};
  Eigen::CompleteOrthogonalDecomposition<Matrix> cod;
  cod.setThreshold(tolerance);
  cod.compute(a);
  MinimumNorm result;
  result.rank = cod.rank();
  result.x = cod.solve(b);
  // a = Q [T 0; 0 0] Z Pᵀ, so (aᵀa)⁺ = P Zᵀ [T⁻¹T⁻ᵀ 0; 0 0] Z Pᵀ.
  const Index rank = result.rank;
  const auto t = cod.matrixT().topLeftCorner(rank, rank).template triangularView<Eigen::Upper>();
  const Matrix t_inverse = t.solve(Matrix::Identity(rank, rank));
  result.condition = rank > 0 ? Matrix(t).norm() * t_inverse.norm() : 0.0;
  Matrix padded = Matrix::Zero(a.cols(), rank);
  padded.topRows(rank) = t_inverse;
  if (rank < a.cols()) padded = cod.matrixZ().adjoint() * padded;  // at full rank, Eigen does not form Z
  result.inverse_t = cod.colsPermutation() * padded;
  return result;
}

Matrix solve(const ConstMatrixRef& a, const ConstMatrixRef& b) { return a.partialPivLu().solve(b); }

Matrix pseudo_inverse(const ConstMatrixRef& a, double tolerance) {
  const Svd d = svd(a);
  if (tolerance < 0) tolerance = 8 * epsilon * double(std::max(a.rows(), a.cols()));
  Vector inverse = Vector::Zero(d.s.size());
  for (Index i = 0; i < d.s.size(); ++i)
    if (d.s(i) > tolerance * d.s(0)) inverse(i) = 1 / d.s(i);
  return d.v * inverse.asDiagonal() * d.u.transpose();
}

Matrix whitener(const ConstMatrixRef& s) {
  const Index n = s.rows();
  const double trace = s.trace();
  if (!(trace > 0)) return Matrix::Identity(n, n);
  // Channels are scaled to equal variance before the diagonal is raised, because their units may be very different.
  Vector scale = s.diagonal().cwiseSqrt();
  for (double& value : scale) value = value > 0 ? 1 / value : 1.0;
  Matrix correlation = scale.asDiagonal() * s * scale.asDiagonal();
  correlation.diagonal().array() += epsilon * double(n);
  const Eigen::LLT<Matrix> cholesky(correlation);
  if (cholesky.info() != Eigen::Success) return scale.asDiagonal();
  return cholesky.matrixL().solve(Matrix(scale.asDiagonal()));
}

std::optional<Matrix> covariance_factor(const ConstMatrixRef& s) {
  constexpr double rounding = 1e-10;
  if (s.rows() != s.cols() || !s.allFinite() || (s.diagonal().array() < 0).any()) return std::nullopt;
  if (s.size() == 0) return Matrix(0, 0);
  // Uses the correlations, so that quantities with very different units keep their digits.
  const Vector size = s.diagonal().cwiseSqrt();
  const Vector inverse = (size.array() > 0).select(size.cwiseInverse(), 1.0);
  const Matrix correlation = inverse.asDiagonal() * s * inverse.asDiagonal();
  const SymmetricEigensystem decomposition = symmetric_eigensystem(correlation);
  if ((correlation - correlation.transpose()).cwiseAbs().maxCoeff() > rounding ||
      decomposition.values.minCoeff() < -rounding)
    return std::nullopt;
  // An eigenvalue that is zero within rounding (1e-16) must not get the root 1e-8. It becomes zero: a direction without
  // variance then stays without variance.
  const Vector& values = decomposition.values;
  const double zero = 4 * epsilon * double(s.rows()) * values(values.size() - 1);
  return size.asDiagonal() * decomposition.vectors *
         (values.array() > zero).select(values, 0.0).cwiseSqrt().asDiagonal();
}

Matrix procrustes(const ConstMatrixRef& a, const ConstMatrixRef& b) {
  const Svd d = svd(a.transpose() * b);
  return d.u * d.v.transpose();
}

}  // namespace tokid::linalg
