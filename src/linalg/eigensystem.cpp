// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "tokid/linalg.hpp"

namespace tokid::linalg {

namespace {

void check_square(const ConstMatrixRef& a) {
  if (a.rows() != a.cols())
    throw std::invalid_argument(
        fmt::format("a: {} rows and {} columns found, a square matrix needed", a.rows(), a.cols()));
}

// False if `a` is not finite or the iteration does not converge. The results of the solver are then uninitialised.
bool solves(Eigen::EigenSolver<Matrix>& solver, const ConstMatrixRef& a, bool with_vectors) {
  return a.allFinite() && solver.compute(a, with_vectors).info() == Eigen::Success;
}

}  // namespace

SymmetricEigensystem symmetric_eigensystem(const ConstMatrixRef& s) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(s);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Vector symmetric_eigenvalues(const ConstMatrixRef& s) {
  return Eigen::SelfAdjointEigenSolver<Matrix>(s, Eigen::EigenvaluesOnly).eigenvalues();
}

Eigen::VectorXcd eigenvalues(const ConstMatrixRef& a) {
  check_square(a);
  if (a.size() == 0) return {};
  Eigen::EigenSolver<Matrix> solver;
  if (!solves(solver, a, false)) return Eigen::VectorXcd::Constant(a.rows(), nan);
  return solver.eigenvalues();
}

Eigensystem eigensystem(const ConstMatrixRef& a) {
  check_square(a);
  if (a.size() == 0) return {};
  Eigen::EigenSolver<Matrix> solver;
  if (!solves(solver, a, true)) {
    const Eigen::MatrixXcd none = Eigen::MatrixXcd::Constant(a.rows(), a.rows(), nan);
    return {none.col(0), none, none};
  }
  Eigen::MatrixXcd right = solver.eigenvectors(), left = right.inverse();
  return {solver.eigenvalues(), std::move(right), std::move(left)};
}

}  // namespace tokid::linalg
