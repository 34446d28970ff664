// SPDX-License-Identifier: BSD-3-Clause
#include "noise/random_walk_lanes.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "linalg/lane_random_walk.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

namespace {

// Pivots below this share of the largest contain no information about a coefficient.
constexpr double unseen = 1.5e-14;

// Solves for the right-hand sides first … first+count-1. The regressors are measured in units in which the first one
// has the stiffness 1. Squares then stay within the range of double precision.
void solve_together(const linalg::MatrixList& rows, Index begin, const Matrix& stiffness, Index first, Index count,
                    linalg::MatrixList& x) {
  const Index steps = x.size(), l = stiffness.rows();
  linalg::LaneRandomWalk walk(steps, l);
  const Vector unit = stiffness.col(0);
  for (Index lane = 0; lane < walk.lanes(); ++lane)
    for (Index i = 0; i < l; ++i) walk.stiffness(i, lane) = lane < count ? stiffness(i, first + lane) / unit(i) : 1.0;
  for (Index g = 0; g < steps; ++g) {
    const auto block = rows[size_t(begin + g)];
    for (Index j = 0; j < l; ++j)
      for (Index i = 0; i <= j; ++i) walk.r(g, i, j) = block(i, j) / unit(j);
    for (Index i = 0; i < l; ++i)
      for (Index lane = 0; lane < walk.lanes(); ++lane)
        walk.z(g, i, lane) = lane < count ? block(i, l + first + lane) : 0.0;
  }
  walk.eliminate();
  for (Index lane = 0; lane < count; ++lane) {
    const Matrix last = determined_by(walk.last(lane), l);
    for (Index i = 0; i < l; ++i) walk.z(steps - 1, i, lane) = last(i, 0);
  }
  walk.substitute();
  for (Index g = 0; g < steps; ++g)
    for (Index i = 0; i < l; ++i)
      for (Index lane = 0; lane < count; ++lane) x[size_t(g)](first + lane, i) = walk.z(g, i, lane) / unit(i);
}

}  // namespace

Matrix determined_by(const ConstMatrixRef& rows, Index regressors) {
  if (regressors == 0) return Matrix(0, rows.cols());
  return linalg::minimum_norm(rows.leftCols(regressors), rows.rightCols(rows.cols() - regressors),
                              unseen * std::sqrt(double(std::max<Index>(1, regressors))))
      .x;
}

linalg::MatrixList random_walk_regressions(const linalg::MatrixList& rows, Index begin, Index end,
                                           const Matrix& stiffness) {
  const Index l = stiffness.rows(), q = stiffness.cols(), lanes = linalg::LaneRandomWalk::lanes();
  if (!(stiffness.array() > 0).all() || !stiffness.allFinite())
    throw std::logic_error("random_walk_regressions: a stiffness is not positive and finite");
  if (rows.rows() != l || rows.cols() != l + q || begin < 0 || end < begin || end > rows.size())
    throw std::logic_error("random_walk_regressions: the rows do not fit the stiffness or the steps");
  linalg::MatrixList x(end - begin, q, l);
  if (x.size() == 0 || stiffness.size() == 0) return x;
  for (Index first = 0; first < q; first += lanes)
    solve_together(rows, begin, stiffness, first, std::min(lanes, q - first), x);
  return x;
}

}  // namespace tokid
