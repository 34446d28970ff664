// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/matrix_list.hpp"

namespace tokid {

// The least squares of random_walk_regression() for the steps begin … end-1 of the rows, and for right-hand sides that
// differ in their stiffness (L × q, all entries positive and finite). rows[g] = [R_g Z_g] (L × (L+q)), R_g upper
// triangular. The result has end - begin matrices X_g (q × L): row j is the solution for column j of Z_g and of the
// stiffness. The solutions are computed together, one in each lane of the vector instructions.
// O(G·q·L³) time, O(G·q·L²) memory.
// \throws std::logic_error for rows, steps or a stiffness that do not fit, or a stiffness that is not positive and
// finite
linalg::MatrixList random_walk_regressions(const linalg::MatrixList& rows, Index begin, Index end,
                                           const Matrix& stiffness);

// The X (L × q) of smallest norm that the rows [R Z] (any number × (L+q)) determine. Small pivots of R count as zero:
// they are rounding errors.
Matrix determined_by(const ConstMatrixRef& rows, Index regressors);

}  // namespace tokid
