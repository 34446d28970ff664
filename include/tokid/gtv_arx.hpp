// Ensemble → GTV-ARX model of every step (16)-(19).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "tokid/windows.hpp"

namespace tokid {

// y_k = D_k u_k + Σ_{j=1..p_k} ( h̄¹_{k,k-j} u_{k-j} - h̄²_{k,k-j} y_{k-j} ) + ε_k      (16), (17)
struct GtvArxStep {
  Index lags = 0;        // p_k
  Index rows = 0;        // N_k: experiments with every sample of the step
  Index freedom = 0;     // N_k - rank - GtvArxOptions::spent, but at least 0
  Index rank = 0;        // numerical rank of W_k with columns scaled to norm 1
  double condition = 0;  // condition number of the part of rank `rank` of the scaled W_k, in Frobenius norms
};

// The regressions of all steps. Their matrices are stored side by side, in slots for the largest lag order. Steps that
// share a model share a slot. Each accessor returns a view of the slot of one step.
class GtvArx {
 public:
  using View = Eigen::Map<const Matrix>;
  using VectorView = Eigen::Map<const Vector>;

  Index inputs = 0, outputs = 0;
  bool feedthrough = true;       // false: D_k = 0 is known, and u_k is not a regressor at step k
  Index k_begin = 0;             // first step with a regression: 0, or p where initial states are unknown
  std::vector<GtvArxStep> step;  // (T), default-constructed before k_begin
  // If one model serves all steps: the triangular factor of its windows [v_{k-p} … v_k].
  std::shared_ptr<const Matrix> window_factor;

  // Allocates T steps with r inputs, m outputs and at most `lags_max` lags, after `feedthrough` is set. Coefficients
  // and noise shapes are uninitialised. All other numbers are zero, and so is D without feedthrough. Noise shapes are
  // stored if `noise_shape` is true. Leverages are stored if `experiments`, the largest N_k, is positive. With a
  // positive `period`, the steps k and k+period share a model, unless k < lags_max. Neither noise shapes nor leverages
  // are then stored.
  void resize(Index T, Index r, Index m, Index lags_max, bool noise_shape, Index experiments = 0, Index period = 0);
  // The slot of step k, and their number.
  Index slot(Index k) const { return k < single_ + period_ ? k : single_ + (k - single_) % period_; }
  Index slots() const { return Index(output_rms_.cols()); }
  // Removes the regressions of the steps before k.
  void begin_at(Index k);
  // Frees most of the memory. Call it after the variances of the Markov parameters are computed: nothing later needs
  // noise shapes.
  void forget_noise_shapes();

  Index steps() const { return static_cast<Index>(step.size()); }
  Index regressors(Index k) const {  // L_k; 0 without a regression
    return k < k_begin ? 0 : step[size_t(k)].lags * (inputs + outputs) + (feedthrough ? inputs : 0);
  }

  // M_k (m × L_k), columns as in W_k = [v_{k-p} … v_{k-1} u_k], without u_k where there is no feedthrough          (18)
  View coefficients(Index k) const { return columns(k, 0, regressors(k)); }
  Eigen::Map<Matrix> coefficients(Index k) {
    return {coefficients_.data() + slot(k) * slot_ * outputs, outputs, regressors(k)};
  }
  View D(Index k) const { return columns(k, step[size_t(k)].lags * (inputs + outputs), inputs); }  // (m × r)
  // h̄¹_{k,k-j} (m × r) and -h̄²_{k,k-j} (m × m), 1 ≤ j ≤ p_k, with the signs that they have in M_k         (15)
  View input_block(Index k, Index j) const {
    return columns(k, (step[size_t(k)].lags - j) * (inputs + outputs), inputs);
  }
  View output_block(Index k, Index j) const {
    return columns(k, (step[size_t(k)].lags - j) * (inputs + outputs) + inputs, outputs);
  }

  // (m × m): EᵀE / freedom; zero without a degree of freedom
  View residual_cov(Index k) const { return {residual_cov_.data() + slot(k) * outputs * outputs, outputs, outputs}; }
  Eigen::Map<Matrix> residual_cov(Index k) {
    return {residual_cov_.data() + slot(k) * outputs * outputs, outputs, outputs};
  }

  // Noise shape X (L_k × rank) with X·Xᵀ = (W_kᵀW_k)⁺: the covariance of the coefficients is residual_cov ⊗ X·Xᵀ. (L_k
  // × 0) if noise shapes are not stored.
  View noise_shape(Index k) const {
    return {noise_shape_.data() + k * slot_ * shape_rows_, regressors(k), shape_rank(k)};
  }
  Eigen::Map<Matrix> noise_shape(Index k) {
    return {noise_shape_.data() + k * slot_ * shape_rows_, regressors(k), shape_rank(k)};
  }
  bool has_noise_shape() const { return shape_rows_ > 0; }
  // \throws std::invalid_argument if noise shapes are not stored
  void require_noise_shape() const;

  // (m): RMS of y_k over the experiments used
  VectorView output_rms(Index k) const { return {output_rms_.data() + slot(k) * outputs, outputs}; }
  Eigen::Map<Vector> output_rms(Index k) { return {output_rms_.data() + slot(k) * outputs, outputs}; }

  // (N_k): diagonal of W_k W_k⁺, for exact leave-one-out errors; empty if leverages are not stored
  VectorView leverages(Index k) const { return {leverages_.data() + k * leverages_.rows(), leverage_count(k)}; }
  Eigen::Map<Vector> leverages(Index k) { return {leverages_.data() + k * leverages_.rows(), leverage_count(k)}; }

 private:
  View columns(Index k, Index from, Index count) const {  // of M_k
    return {coefficients_.data() + (slot(k) * slot_ + from) * outputs, outputs, count};
  }
  Index shape_rank(Index k) const { return has_noise_shape() ? step[size_t(k)].rank : 0; }
  Index leverage_count(Index k) const { return leverages_.rows() > 0 ? step[size_t(k)].rows : 0; }

  Index slot_ = 0;                 // L, the largest L_k
  Index shape_rows_ = 0;           // L if noise shapes are stored, else 0
  Index single_ = 0, period_ = 0;  // the steps from single_ on share slots with this period
  Matrix coefficients_;            // (m × slots·L)
  Matrix residual_cov_;            // (m × slots·m)
  Matrix noise_shape_;             // (L × T·L)
  Matrix output_rms_;              // (m × slots)
  Matrix leverages_;               // (largest N_k × T)
};

struct GtvArxOptions {
  // p_k for every step, or a single entry for all steps. With zero initial states, step k uses min(p_k, k) lags. With
  // unknown initial states, (17) holds only at steps k ≥ p_k. The regressions then begin at the first step from which
  // on every step has k ≥ p_k.
  std::vector<Index> lags = {1};
  Index lags_of(Index k) const { return lags[lags.size() == 1 ? 0 : size_t(k)]; }
  InitialState initial_state = InitialState::zero;
  bool feedthrough = true;  // false: D_k = 0 is known
  // Pivots of the scaled W_k below tolerance·√L_k count as zero. If there are any, the solution is the one with the
  // smallest norm in the scaled coordinates.
  double tolerance = 1.5e-14;
  bool noise_shape = true;  // store noise shapes, for variances of later results: L_k² numbers for each step
  bool leverages = false;
  // b: number of successive steps that share one factorisation, if they have the same lag order and no sample is
  // missing. 1: each step alone; 0: the number with the smallest computing time.
  Index block = 0;
  Index spent = 0;  // degrees of freedom used before the regression: 1 if a mean motion was removed
  Execution execution = {};
};

// Orthogonal factorisations [W_k Y_k] = Q [R_WW R_Wy; 0 R_yy]; M_kᵀ = R_WW⁺ R_Wy                          (19)
// The windows of successive steps overlap. The window of p+b steps is therefore factorised once, and its factor gives
// the factors of b steps. Steps with fewer complete experiments than regressors get the minimum-norm solution; see
// `rank` and `rows`. \throws std::invalid_argument for lag orders below 1 or of the wrong number, or an ensemble
// without steps, inputs or outputs
GtvArx gtv_arx(const Ensemble& ensemble, const GtvArxOptions& options = {});
// Regressions from windows, with a factorisation for each step.
GtvArx gtv_arx(const Windows& windows, const GtvArxOptions& options = {});

// N_min = r + p·(r+m): the number of experiments that a full-rank step needs; without feedthrough p·(r+m)
Index minimum_experiments(Index inputs, Index outputs, Index lags, bool feedthrough = true);
// The largest p with N_min(p) ≤ N; zero if there is none
Index largest_lag_order(Index experiments, Index inputs, Index outputs, bool feedthrough = true);

}  // namespace tokid
