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
// transformations: O(G·(L+q)·L²) time, O(G·L·(L+q)) memory. \throws std::invalid_argument for rows or a stiffness of
// the wrong size, negative entries, or zero entries beside positive ones
std::vector<Matrix> random_walk_regression(const std::vector<Matrix>& rows, Index regressors, const Vector& stiffness);

// (G) By how much the minimum falls for one column q = 1 if X may jump between the steps g-1 and g; 0 at step 0. The
// steps before g alone give X_{g-1} with the covariance P₁, the steps from g on alone give X_g with P₂, for rows of
// unit noise. Then the decrease is
//   dᵀ (P₁ + P₂ + diag(stiffness)⁻²)⁻¹ d,   d = X_g - X_{g-1},
// and if X is this random walk, it is a χ² number of L degrees of freedom. The stiffness (L) is positive and finite.
// \throws std::invalid_argument as random_walk_regression()
Vector jump_gains(const std::vector<Matrix>& rows, const Vector& stiffness);

}  // namespace tokid
