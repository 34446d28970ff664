// Least squares whose coefficients may vary from step to step, but not freely: the regularisation over time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid {

// X_0 … X_{G-1} (L × q each) that minimise  Σ_g ‖R_g X_g - Z_g‖² + Σ_g ‖diag(stiffness)·(X_{g+1} - X_g)‖²,  where
// rows[g] = [R_g Z_g] (any number of rows × (L + q)); none where a step has no data. The stiffness (L) of a coefficient
// is √λ times its unit. Where all of it is zero each step stands alone (minimum norm), where any of it is infinite all
// steps share one solution. Square-root information recursion, orthogonal throughout: O(G·(L+q)·L²) time, O(G·L·(L+q))
// memory. \throws std::invalid_argument for rows or a stiffness of the wrong size, negative entries, or zero ones among
// others
std::vector<Matrix> random_walk_regression(const std::vector<Matrix>& rows, Index regressors, const Vector& stiffness);

}  // namespace tokid
