// Ensemble → GTV-ARX model of every step (16)-(19).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

// y_k = D_k u_k + Σ_{j=1..p_k} ( h̄¹_{k,k-j} u_{k-j} - h̄²_{k,k-j} y_{k-j} ) + ε_k      (16), (17)
struct GtvArxStep {
  Index lags = 0;        // p_k
  Index rows = 0;        // experiments with every sample of the step, N_k
  Index freedom = 0;     // degrees of freedom left: N_k - rank, less those spent beforehand
  Index rank = 0;        // numerical rank of W_k with columns scaled to norm 1
  double condition = 0;  // condition number of the same (Frobenius norms; of its part of rank `rank`)
  Matrix coefficients;   // M_k (m × L_k), columns as in W_k = [v_{k-p} … v_{k-1} u_k]                 (18)
  Matrix residual_cov;   // (m × m): EᵀE / freedom; zero where no degree of freedom is left
  Matrix noise_shape;    // X (L_k × rank) with X·Xᵀ = (W_kᵀW_k)⁺: the covariance of the coefficients is
                         // residual_cov ⊗ X·Xᵀ
  Vector output_rms;     // (m): root mean square of y_k over the experiments used
  Vector leverages;      // (N_k): diagonal of W_k W_k⁺, for exact leave-one-out errors; empty unless asked for
};

struct GtvArx {
  Index inputs = 0, outputs = 0;
  Index k_begin = 0;             // first step with a regression: 0, or p where initial states are unknown
  std::vector<GtvArxStep> step;  // (T), default-constructed below k_begin

  Index steps() const { return static_cast<Index>(step.size()); }
  auto D(Index k) const { return step[size_t(k)].coefficients.rightCols(inputs); }  // (m × r)
  // h̄¹_{k,k-j} (m × r) and -h̄²_{k,k-j} (m × m), 1 ≤ j ≤ p_k, as they stand in M_k                     (15)
  auto input_block(Index k, Index j) const {
    const GtvArxStep& s = step[size_t(k)];
    return s.coefficients.middleCols((s.lags - j) * (inputs + outputs), inputs);
  }
  auto output_block(Index k, Index j) const {
    const GtvArxStep& s = step[size_t(k)];
    return s.coefficients.middleCols((s.lags - j) * (inputs + outputs) + inputs, outputs);
  }
};

struct GtvArxOptions {
  // p_k for every step, or a single entry for all of them. Step k uses min(p_k, k) lags where the initial states are
  // zero, and has no regression for k < p_k where they are unknown: (17) holds for k ≥ p whatever x_0 is.
  std::vector<Index> lags = {1};
  InitialState initial_state = InitialState::zero;
  // Pivots of the scaled W_k below tolerance·√L_k count as zero, and the solution of smallest norm in the scaled
  // coordinates is taken.
  double tolerance = 1.5e-14;
  bool leverages = false;
  // b: successive steps with a common lag order whose samples are factorised at once, where none is missing; 1: each
  // step by itself, 0: as many as cost least
  Index block = 0;
  Index spent = 0;  // degrees of freedom of the experiments that the data have lost before: 1 for a mean motion
  Execution execution = {};
};

// Orthogonal factorisations [W_k Y_k] = Q [R_WW R_Wy; 0 R_yy]; M_kᵀ = R_WW⁺ R_Wy                          (19)
// Successive steps share most of their window: that of p+b steps, factorised once, holds the factors of b steps.
// Steps with fewer complete experiments than regressors get the minimum-norm solution; see `rank` and `rows`.
// \throws std::invalid_argument for lag orders below 1 or of the wrong number, or an ensemble without steps, inputs or
// outputs
GtvArx gtv_arx(const Ensemble& ensemble, const GtvArxOptions& options = {});

// N_min = r + p·(r+m), the experiments that a full-rank step needs
Index minimum_experiments(Index inputs, Index outputs, Index lags);
// The largest p with N_min(p) ≤ N, zero if there is none
Index largest_lag_order(Index experiments, Index inputs, Index outputs);

// Exact leave-one-out one-step error for every lag order 1 … p_max at once: with the newest lag first, the leading
// columns of one QR factorisation serve all orders.
struct LagOrderErrors {
  std::vector<Index> steps;  // the steps examined (at most `LagOrderOptions::steps`, evenly spaced)
  Matrix error;    // (steps × p_max): mean over outputs of log( leave-one-out mean square / mean square of y )
  Vector mean;     // (p_max): column means of `error`
  Index best = 1;  // the smallest p within a standard error of the smallest mean
};
struct LagOrderOptions {
  Index p_max = 8;
  Index p_min = 1;
  Index steps = 64;
  // Relative errors below this count as exact: noise-free data choose the smallest exact order.
  double exact = 1e-10;
  Execution execution = {};
};
LagOrderErrors lag_order_errors(const Ensemble& ensemble, const LagOrderOptions& options = {});

}  // namespace tokid
