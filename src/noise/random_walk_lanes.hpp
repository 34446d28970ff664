// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "linalg/matrix_list.hpp"

namespace tokid {

// Right-hand sides that share their rows and differ in their stiffness.
struct WalkRows {
  const linalg::MatrixList& rows;  // (G) [R_g Z_g] (L × (L+q)), R_g upper triangular
  const Matrix& stiffness;         // (L × q) all entries positive and finite
};

// The least squares of random_walk_regression() for the steps begin … end-1 of the rows. Each result has end - begin
// matrices X_g (q × L): row j is the solution for column j of Z_g and of the stiffness. All are computed together, one
// in each lane of the vector instructions. O(G·q·L³) time, O(G·q·L²) memory.
// \throws std::logic_error for rows, steps or a stiffness that do not fit, or a stiffness that is not positive and
// finite
std::vector<linalg::MatrixList> random_walk_regressions(std::span<const WalkRows> walks, Index begin, Index end);

// The X (L × q) of smallest norm that the rows [R Z] (any number × (L+q)) determine. Small pivots of R count as zero:
// they are rounding errors.
Matrix determined_by(const ConstMatrixRef& rows, Index regressors);

}  // namespace tokid
