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

// A right-hand side: column `column` of Z in walk number `walk`.
struct Lane {
  size_t walk = 0;
  Index column = 0;
};

// Solves for a right-hand side in each lane. The regressors are measured in units in which their stiffness is 1.
// Squares then stay within the range of double precision. Walks with fewer regressors than others get regressors that
// are zero.
void solve_together(std::span<const WalkRows> walks, std::span<const Lane> lanes, Index begin, Index most,
                    std::vector<linalg::MatrixList>& x) {
  const Index steps = x.front().size();
  linalg::LaneRandomWalk walk(steps, most);
  Matrix inverse = Matrix::Ones(most, walk.lanes());  // of the stiffness
  for (size_t i = 0; i < lanes.size(); ++i) {
    const Matrix& stiffness = walks[lanes[i].walk].stiffness;
    inverse.col(Index(i)).head(stiffness.rows()) = stiffness.col(lanes[i].column).cwiseInverse();
  }
  for (Index g = 0; g < steps; ++g)
    for (Index lane = 0; lane < walk.lanes(); ++lane) {
      Index own = 0;
      if (size_t(lane) < lanes.size()) {
        const auto& [number, column] = lanes[size_t(lane)];
        const auto block = walks[number].rows[size_t(begin + g)];
        own = block.rows();
        for (Index j = 0; j < own; ++j)
          for (Index i = 0; i <= j; ++i) walk.r(g, i, j, lane) = block(i, j) * inverse(j, lane);
        for (Index i = 0; i < own; ++i) walk.z(g, i, lane) = block(i, own + column);
      }
      for (Index i = own; i < most; ++i) walk.r(g, i, i, lane) = 1.0;
    }
  walk.eliminate();
  for (size_t lane = 0; lane < lanes.size(); ++lane) {
    const Index own = walks[lanes[lane].walk].stiffness.rows();
    const Matrix known = walk.last(Index(lane));
    const Matrix last = determined_by(linalg::beside(known.topLeftCorner(own, own), known.col(most).head(own)), own);
    for (Index i = 0; i < own; ++i) walk.z(steps - 1, i, Index(lane)) = last(i, 0);
  }
  walk.substitute();
  for (Index g = 0; g < steps; ++g)
    for (size_t i = 0; i < lanes.size(); ++i) {
      auto block = x[lanes[i].walk][size_t(g)];
      for (Index j = 0; j < block.cols(); ++j)
        block(lanes[i].column, j) = walk.z(g, j, Index(i)) * inverse(j, Index(i));
    }
}

}  // namespace

Matrix determined_by(const ConstMatrixRef& rows, Index regressors) {
  if (regressors == 0) return Matrix(0, rows.cols());
  return linalg::minimum_norm(rows.leftCols(regressors), rows.rightCols(rows.cols() - regressors),
                              unseen * std::sqrt(double(std::max<Index>(1, regressors))))
      .x;
}

std::vector<linalg::MatrixList> random_walk_regressions(std::span<const WalkRows> walks, Index begin, Index end) {
  std::vector<linalg::MatrixList> x;
  std::vector<Lane> lanes;
  Index most = 0;
  for (size_t number = 0; number < walks.size(); ++number) {
    const auto& [rows, stiffness] = walks[number];
    const Index l = stiffness.rows(), q = stiffness.cols();
    if (!(stiffness.array() > 0).all() || !stiffness.allFinite())
      throw std::logic_error("random_walk_regressions: a stiffness is not positive and finite");
    if (rows.rows() != l || rows.cols() != l + q || begin < 0 || end < begin || end > rows.size())
      throw std::logic_error("random_walk_regressions: the rows do not fit the stiffness or the steps");
    x.emplace_back(end - begin, q, l);
    most = std::max(most, l);
    if (l > 0)
      for (Index column = 0; column < q; ++column) lanes.push_back({number, column});
  }
  const size_t together = size_t(linalg::LaneRandomWalk::lanes());
  if (end > begin)
    for (size_t first = 0; first < lanes.size(); first += together)
      solve_together(walks, std::span(lanes).subspan(first, std::min(together, lanes.size() - first)), begin, most, x);
  return x;
}

}  // namespace tokid
