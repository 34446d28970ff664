// GTV-ARX model + data → A_k, B_k, C_k, D_k, G_k of every step. This is the weighted predictor subspace realisation,
// for noisy data and unknown initial states.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

struct SubspaceOptions {
  Index states = 0;  // largest number of states per step; 0: the numerical rank, which is too large for noisy data
  // f: block rows of the predictor. 0: p, but with Weighting::one_step only as many as give 24 singular values, if these
  // are at least twice as many as the states.
  Index future = 0;
  Weighting weighting = Weighting::one_step;
  TimeVariation variation = {};  // variation of the ARX model
  // λ of the regressions for the matrices. Negative: state_share times the λ of the ARX model. A weaker penalty is
  // enough, because the states of neighbouring steps are in a common frame and vary slowly.
  double state_smoothing = -1.0;
  static constexpr double state_share = 1.0 / 30;
  // (m) Weights of the outputs, over the largest. Empty: all outputs count alike. An output of weight w counts as if
  // independent noise increased the variance of its innovations by the factor 1/w.
  Vector output_weights = {};
  // false: the data have no noise, so their residuals are rounding errors. The outputs are then weighted by their size
  // instead, and the observer comes from the ARX model.
  bool noisy = true;
  Execution execution = {};
};

// At step k, the p past samples z_k (oldest first, zeros before the experiment) predict the next f outputs with the ARX
// coefficients. The predictor M_k (f·m × p·d) has the coefficients of the lags that reach back before step k. With
// Weighting::many_steps, it also predicts the outputs between step k and the predicted output. Z_k (N × p·d) has the
// z_k of all experiments, and Σ is the covariance of the innovations, the weight of the outputs. With
// `output_weights`, each diagonal element of Σ is divided by the weight of its output. The weighted prediction is
//   Σ^{-1/2} M_k Z_kᵀ = U S Vᵀ,   and the state samples are   X_k = S^{-1/2} Uᵀ Σ^{-1/2} M_k Z_k  (n_k × N).
struct PredictorFactor {
  Vector singular_values;  // (q)
  Matrix observability;    // (f·m × q): U S^{1/2}, in the units of the weighted outputs
  Matrix state;            // (q × p·d): x_k = state · z_k
};
struct PredictorFactors {
  Index lags = 0, future = 0;
  Index k_begin = 0;                   // first step with a state
  std::vector<PredictorFactor> group;  // one for each group of steps that share a model (T if the model varies)
};
// \throws std::invalid_argument where the ARX model and the data disagree, the data are shorter than p + P, or
// projections are requested without an ensemble
PredictorFactors predictor_factors(const Windows& windows, const GtvArx& arx, const SubspaceOptions& options);

// Two regressions per step: y_k on [x_k; u_k] → C_k, D_k and the innovations ε_k; x_{k+1} on [x_k; u_k; ε_k] → A_k,
// B_k, -G_k. Without noise the matrices are exact for every p ≥ p_min and any initial states. The state dimension is
// the smallest of four numbers: `states`, the rank, and the largest dimensions that the samples before step k and from
// step k on can determine.
Model realise(const Windows& windows, const GtvArx& arx, const PredictorFactors& factors,
              const SubspaceOptions& options);

// predictor_factors() and realise() in one call.
Model subspace(const Windows& windows, const GtvArx& arx, const SubspaceOptions& options = {});

}  // namespace tokid
