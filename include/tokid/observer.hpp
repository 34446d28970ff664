// Observers for a known or identified model: deadbeat (Appendix B) and Kalman (Appendix A).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// ‖Ā_{k+p-1} … Ā_k‖_F for k = k_begin … k_end-p (76)
std::vector<double> deadbeat_products(const Model& model, Index p);

// The gains of a deadbeat observer of the model: Ā_{k+p-1} … Ā_k = 0 for every k (76). p is the number of steps after
// which the outputs determine the state. N_0 = Rⁿ and N_{j+1}(k+1) = A_k (N_j(k) ∩ ker C_k) contain the states that j
// outputs do not determine. G_k = -A_k Z_k is chosen so that Ā_k maps N_j(k) into N_{j+1}(k+1); Z_k maps the outputs
// back to the states, along these subspaces. If p·m = n, the gain is unique, and it is the gain that the paper
// identifies. Otherwise the Z_k with the smallest norms are chosen.
struct DeadbeatGain {
  std::vector<Matrix> G;  // (S) n_{k+1} × m
  // p: the number of steps after which every state error is zero; more than S if the outputs do not determine some
  // state
  Index steps = 0;
};
// Directions below tolerance·‖C_k‖ count as unobserved; directions below tolerance·‖A_k‖ count as zero.
DeadbeatGain deadbeat_gain(const Model& model, double tolerance = 1e-10);

// The Kalman filter of a model with known noise (54), (55):
//   x_{k+1} = A_k x_k + B_k u_k + w_k,   E[w_k w_kᵀ] = Q_k, with Γ_k of the paper in w_k
//   y_k     = C_k x_k + D_k u_k + v_k,   E[v_k v_kᵀ] = R_k,   w and v white and independent of each other
// P_k is propagated as a square root in Joseph's form. It therefore stays symmetric and positive semidefinite despite
// rounding errors. A singular innovation covariance gives the gain of smallest norm.
struct KalmanFilter {
  std::vector<Matrix> P;  // (S+1) n_k × n_k: covariance of x_k - x̂_k before y_k is known
  std::vector<Matrix> K;  // (S) n_k × m: P_k C_kᵀ (C_k P_k C_kᵀ + R_k)⁻¹                          (69)
  std::vector<Matrix> innovation_cov;  // (S) m × m: C_k P_k C_kᵀ + R_k
};
// P of the first step is model.x0_cov, or zero if x0_cov is empty. \throws std::invalid_argument where Q or R is
// missing, or one of the three is not a covariance
KalmanFilter kalman_filter(const Model& model);

// The model with its Kalman filter as observer: K_k, G_k = -A_k K_k, innovation_cov. With this observer, predict() is
// optimal.
Model kalman_observer(Model model);

}  // namespace tokid
