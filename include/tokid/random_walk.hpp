// Least squares with a penalty on the variation of the coefficients over time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid {

// Computes the X_0 … X_{G-1} (L × q each) that minimise  Σ_g ‖R_g X_g - Z_g‖² + Σ_g ‖diag(stiffness)·(X_{g+1} - X_g)‖².
// rows[g] = [R_g Z_g] (any number of rows × (L + q)) has no rows if step g has no data. The stiffness (L) of a
// coefficient is √λ times its unit. If all stiffnesses are zero, each step is solved alone (minimum norm). If any is
// infinite, all steps share one solution. The method is a square-root information recursion by orthogonal
// transformations: O(G·(L+q)·L²) time, O(G·L·(L+q)) memory. `loose`: ascending g; at each of them, the penalty on
// X_g - X_{g-1} is only the share `loose_penalty`. \throws std::invalid_argument for rows or a stiffness of the wrong
// size, negative entries, or zero entries beside positive ones
std::vector<Matrix> random_walk_regression(const std::vector<Matrix>& rows, Index regressors, const Vector& stiffness,
                                           const std::vector<Index>& loose = {});
inline constexpr double loose_penalty = 1.0 / 30;

// (G) By how much the minimum falls if `width` successive penalties are loose, from that on X_g - X_{g-1} on. Zero at
// step 0. Fewer penalties are loose where the steps end. The stiffness (L) is positive and finite. O(G·width·(L+q)·L²)
// time. \throws std::invalid_argument as random_walk_regression(), or for a width below 1
Vector loosening_gains(const std::vector<Matrix>& rows, const Vector& stiffness, Index width);

}  // namespace tokid
