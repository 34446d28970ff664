// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

Eigen::VectorXcd eigenvalues(const ConstMatrixRef& a) {
  if (a.size() == 0) return {};
  return Eigen::EigenSolver<Matrix>(a, false).eigenvalues();
}

Eigensystem eigensystem(const ConstMatrixRef& a) {
  if (a.size() == 0) return {};
  const Eigen::EigenSolver<Matrix> solver(a);
  const Eigen::MatrixXcd right = solver.eigenvectors();
  return {solver.eigenvalues(), right, right.inverse()};
}

}  // namespace tokid::linalg
