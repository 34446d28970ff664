// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/matrix_list.hpp"

namespace tokid {

// The least squares of random_walk_regression() for right-hand sides that differ in their stiffness (L × q, all entries
// positive and finite): row j of each X_g (q × L) is the solution for column j of Z_g and of the stiffness. rows[g] =
// [R_g Z_g] (L × (L+q)), R_g upper triangular, for the steps g from `begin` on. The result begins with the step
// `begin`. The rows are solved together, one in each lane of the vector instructions.
// O(G·q·L³) time, O(G·q·L²) memory.
// \throws std::invalid_argument for rows or a stiffness of the wrong size, or entries that are not positive and finite
linalg::MatrixList random_walk_regressions(const linalg::MatrixList& rows, Index begin, Index end,
                                           const Matrix& stiffness);

// The X (L × q) of smallest norm that rows [R Z] determine. Small pivots count as zero: they are rounding errors.
Matrix determined_by(const ConstMatrixRef& rows, Index regressors);

}  // namespace tokid
