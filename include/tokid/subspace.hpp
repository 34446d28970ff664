// GTV-ARX model + data → A_k, B_k, C_k, D_k, G_k of every step: the weighted predictor subspace realisation, for noisy
// data and unknown initial states.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

// Which outputs the states must explain, where there are more of them than a model is to have.
enum class Weighting {
  one_step,    // each from the samples up to the step before it: what the observer needs (canonical variates)
  many_steps,  // all from the past alone: what the simulation needs
  // All from the past alone, by projections of the data instead of the ARX model; needs a period. The matrices are
  // those of PO-MOESP: poles do not depend on noise models, and B, D simulate best.
  projection,
};

struct SubspaceOptions {
  Index states = 0;  // at most so many per step; 0: the numerical rank, which noisy data do not show
  // f: block rows of the predictor; 0: p, and with Weighting::one_step no more than show 24 singular values
  Index future = 0;
  Weighting weighting = Weighting::one_step;
  TimeVariation variation = {};  // of the ARX model
  // λ of the regressions that give the matrices. The states of neighbouring steps share a frame and are smooth already:
  // a weaker penalty does. Negative: state_share of the ARX model's.
  double state_smoothing = -1.0;
  static constexpr double state_share = 1.0 / 30;
  // Without noise the residuals say nothing: outputs are weighed by their size, and the observer is the ARX model's
  // own.
  bool noisy = true;
  Execution execution = {};
};

// At step k the p past samples z_k (oldest first, zeros before the experiment) predict the next f outputs by the ARX
// blocks that act on them; with Weighting::many_steps, the outputs in between are predictions, too. That predictor
// times the data, the outputs weighed by their innovations, is
//   Σ^{-1/2} M_k Z_kᵀ = U S Vᵀ,   and the state samples are   X_k = S^{-1/2} Uᵀ Σ^{-1/2} M_k Z_k  (n_k × N).
struct PredictorFactor {
  Vector singular_values;  // (q)
  Matrix observability;    // (f·m × q): U S^{1/2}, in the units of the weighted outputs
  Matrix state;            // (q × p·d): x_k = state · z_k
};
struct PredictorFactors {
  Index lags = 0, future = 0;
  Index k_begin = 0;                   // of the first step with a state
  std::vector<PredictorFactor> group;  // of each group of steps that share their model (T where they vary)
};
// \throws std::invalid_argument where the ARX model and the data disagree, the data are shorter than p + P, or
// projections are to be made without an ensemble
PredictorFactors predictor_factors(const Windows& windows, const GtvArx& arx, const SubspaceOptions& options);

// Two regressions per step: y_k on [x_k; u_k] → C_k, D_k and the innovations ε_k; x_{k+1} on [x_k; u_k; ε_k] → A_k,
// B_k, -G_k. Exact without noise for every p ≥ p_min and for any initial states. The state dimension is the smallest of
// `states`, the rank, what the samples before k can tell and what those from k on can show.
Model realise(const Windows& windows, const GtvArx& arx, const PredictorFactors& factors,
              const SubspaceOptions& options);

// Both in one call.
Model subspace(const Windows& windows, const GtvArx& arx, const SubspaceOptions& options = {});

}  // namespace tokid
