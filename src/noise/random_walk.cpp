// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/random_walk.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "linalg/reflection.hpp"
#include "noise/random_walk_lanes.hpp"

namespace tokid {

namespace {

const double loose_share = std::sqrt(loose_penalty);  // of the stiffness

void check(const std::vector<Matrix>& rows, Index regressors, const Vector& stiffness) {
  if (stiffness.size() != regressors || !(stiffness.array() >= 0).all())
    throw std::invalid_argument(
        fmt::format("stiffness: {} entries found, {} needed, none of them negative", stiffness.size(), regressors));
  // Without a penalty, a coefficient is undetermined at steps whose data do not determine it.
  if (stiffness.size() > 0 && stiffness.minCoeff() == 0 && stiffness.maxCoeff() > 0)
    throw std::invalid_argument("stiffness: zero and positive entries found, all zero or all positive needed");
  for (const Matrix& block : rows)
    if (block.cols() != rows.front().cols() || block.cols() < regressors)
      throw std::invalid_argument(fmt::format("rows: {} columns found, {} needed in every step, {} or more",
                                              block.cols(), rows.front().cols(), regressors));
}

// After the elimination of X_g, these equations give X_g from X_{g+1}: U X_g = w - V X_{g+1}, with U upper and V lower
// triangular.
struct Eliminated {
  Matrix triangles;   // (L × L): U on and above the diagonal, V below
  Vector v_diagonal;  // (L)
  Matrix w;           // (L × q)
};

// Turns the rows [R z] that determine X_g from the data up to step g into rows that determine X_{g+1}, by the QR
// factorisation
//   [  R   0  z ]      [ U  V   w  ]
//   [ -S   S  0 ]  =  Q[ 0  R'  z' ]          S = diag(stiffness)
// The zeros are kept: reflection j involves row j of the upper block and the rows 0 … j of the lower block.
class Eliminator {
 public:
  Eliminator(const Vector& stiffness, Index right)
      : stiffness_(stiffness), above_(stiffness.size(), 2 * stiffness.size() + right), below_(above_) {}

  // `share`: of the stiffness
  Eliminated run(const Matrix& triangle, Matrix& next, double share = 1.0) {
    const Index l = stiffness_.size(), right = above_.cols() - 2 * l;
    above_.setZero();
    above_.topLeftCorner(triangle.rows(), l) = triangle.leftCols(l);
    above_.topRightCorner(triangle.rows(), right) = triangle.rightCols(right);
    below_.setZero();
    below_.leftCols(l).diagonal() = -share * stiffness_;
    below_.middleCols(l, l).diagonal() = share * stiffness_;
    for (Index j = 0; j < l; ++j) {
      const double tau = linalg::make_reflection(above_(j, j), below_.col(j).data(), j + 1);
      if (tau == 0.0) continue;
      reflect(j, j + 1, l - j - 1, tau);
      reflect(j, l, j + 1, tau);
      reflect(j, 2 * l, right, tau);
    }
    next = below_.rightCols(l + right);
    Eliminated e{above_.leftCols(l).triangularView<Eigen::Upper>(), above_.middleCols(l, l).diagonal(),
                 above_.rightCols(right)};
    e.triangles += above_.middleCols(l, l).triangularView<Eigen::StrictlyLower>();
    return e;
  }

 private:
  void reflect(Index j, Index first, Index count, double tau) {
    if (count == 0) return;
    linalg::reflect(below_.col(j).data(), j + 1, tau,
                    {&above_(j, first), above_.outerStride(), &below_(0, first), below_.outerStride()}, count);
  }

  const Vector& stiffness_;
  Matrix above_, below_;
};

Matrix triangular(const Matrix& rows) {
  if (rows.rows() <= rows.cols() && rows.isUpperTriangular(0.0)) return rows;
  Matrix copy = rows;
  return linalg::triangular_factor(copy);
}

// The triangular factor of what is known about the coefficients and of the rows of a step. The triangle of the step
// begins `known.rows()` rows lower, so no entry is further below the diagonal.
Matrix with_step(const Matrix& known, const Matrix& rows) {
  Matrix both = linalg::stacked(known, triangular(rows));
  linalg::triangularise(both, known.rows());
  return both.topRows(std::min(both.rows(), both.cols())).triangularView<Eigen::Upper>();
}

}  // namespace

std::vector<Matrix> random_walk_regression(const std::vector<Matrix>& rows, Index regressors, const Vector& stiffness,
                                           const std::vector<Index>& loose) {
  check(rows, regressors, stiffness);
  const size_t steps = rows.size();
  std::vector<Matrix> x(steps);
  if (steps == 0) return x;
  if ((stiffness.array() == 0).all()) {
    for (size_t g = 0; g < steps; ++g) x[g] = determined_by(rows[g], regressors);
    return x;
  }
  if (!stiffness.allFinite()) {
    Matrix all = triangular(rows[0]);
    for (size_t g = 1; g < steps; ++g) all = with_step(all, rows[g]);
    x.assign(steps, determined_by(all, regressors));
    return x;
  }

  std::vector<Eliminated> eliminated(steps - 1);
  Eliminator eliminator(stiffness, rows[0].cols() - regressors);
  Matrix known = triangular(rows[0]);
  for (size_t g = 0; g + 1 < steps; ++g) {
    Matrix next;
    const bool is_loose = std::binary_search(loose.begin(), loose.end(), Index(g) + 1);
    eliminated[g] =
        eliminator.run(known.topRows(std::min(known.rows(), regressors)), next, is_loose ? loose_share : 1.0);
    known = with_step(next, rows[g + 1]);
  }
  x[steps - 1] = determined_by(known.topRows(std::min(known.rows(), regressors)), regressors);
  for (size_t g = steps - 1; g-- > 0;) {
    const Eliminated& e = eliminated[g];
    x[g] = e.w - e.v_diagonal.asDiagonal() * x[g + 1];
    x[g] -= e.triangles.triangularView<Eigen::StrictlyLower>() * x[g + 1];
    e.triangles.triangularView<Eigen::Upper>().solveInPlace(x[g]);
  }
  return x;
}

namespace {

// What each step and the steps before it say about its coefficients: rows [R z].
std::vector<Matrix> known_up_to(const std::vector<Matrix>& rows, const Vector& stiffness) {
  const Index l = stiffness.size();
  std::vector<Matrix> known;
  Eliminator eliminator(stiffness, rows[0].cols() - l);
  Matrix next(0, rows[0].cols());
  for (const Matrix& own : rows) {
    const Matrix both = with_step(next, own);
    known.emplace_back(both.topRows(std::min(both.rows(), l)));
    eliminator.run(known.back(), next);
  }
  return known;
}

// The least sum of squares of rows about X_{g-1}, of the rows about the steps from g on, and of the penalties between
// them.
double least_squares(Matrix known, const std::vector<const Matrix*>& rows, Index regressors, Eliminator& eliminator,
                     double share) {
  double sum = 0.0;
  Matrix next;
  for (const Matrix* own : rows) {
    eliminator.run(known, next, share);
    const Matrix both = with_step(next, *own);
    const Index left = std::max<Index>(0, both.rows() - regressors);
    sum += both.bottomRightCorner(left, both.cols() - regressors).squaredNorm();
    known = both.topRows(both.rows() - left);
  }
  return sum;
}

}  // namespace

Vector loosening_gains(const std::vector<Matrix>& rows, const Vector& stiffness, Index width) {
  const Index l = stiffness.size();
  check(rows, l, stiffness);
  if (!(stiffness.array() > 0).all() || !stiffness.allFinite())
    throw std::invalid_argument("stiffness: zero, negative or infinite entries found, positive and finite needed");
  if (width < 1) throw std::invalid_argument(fmt::format("width: {} found, at least 1 needed", width));
  const size_t steps = rows.size();
  Vector gains = Vector::Zero(Index(steps));
  if (steps < 2) return gains;
  const std::vector<Matrix> before = known_up_to(rows, stiffness);
  const std::vector<Matrix> after = known_up_to({rows.rbegin(), rows.rend()}, stiffness);
  Eliminator eliminator(stiffness, rows[0].cols() - l);
  for (size_t g = 1; g < steps; ++g) {
    const size_t last = std::min(g + size_t(width), steps) - 1;
    std::vector<const Matrix*> between;
    for (size_t i = g; i < last; ++i) between.push_back(&rows[i]);
    between.push_back(&after[steps - 1 - last]);
    gains(Index(g)) = least_squares(before[g - 1], between, l, eliminator, 1.0) -
                      least_squares(before[g - 1], between, l, eliminator, loose_share);
  }
  return gains;
}

}  // namespace tokid
