// The recursion of a GTV-ARX model (17): forwards on samples, and backwards on weights of its outputs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/gtv_arx.hpp"

namespace tokid::uncertainty {

Index largest_lag_order(const GtvArx& arx);

// The covariance of the innovation of step k (m × m), at least the covariance of rounding errors of the outputs. The
// covariance is unknown if the step has no degree of freedom.
Matrix innovation_cov(const GtvArx& arx, Index k);

// Rows of samples with the layout of an ensemble, from step `origin` on.
struct Rows {
  Rows(const GtvArx& arx, Index count, Index first, Index steps)
      : origin(first), samples(Matrix::Zero(count, steps * (arx.inputs + arx.outputs))) {}
  Index origin;
  Matrix samples;
};
// The window of step k (rows × L_k), and u_k, y_k within the samples.
inline auto window(const GtvArx& arx, const Rows& rows, Index k) {
  const Index d = arx.inputs + arx.outputs, lags = arx.step[size_t(k)].lags;
  return rows.samples.middleCols((k - lags - rows.origin) * d, lags * d + (arx.feedthrough ? arx.inputs : 0));
}
inline auto input(const GtvArx& arx, Rows& rows, Index k) {
  return rows.samples.middleCols((k - rows.origin) * (arx.inputs + arx.outputs), arx.inputs);
}
inline auto output(const GtvArx& arx, Rows& rows, Index k) {
  return rows.samples.middleCols((k - rows.origin) * (arx.inputs + arx.outputs) + arx.inputs, arx.outputs);
}

// Computes the outputs of the steps begin … end-1 in `rows`.
void run(const GtvArx& arx, Index begin, Index end, Rows& rows);

// ωᵀ X Xᵀ ω for each row ω of `windows`: the variance of M_k ω for innovations of variance one.
Vector leverages(const GtvArx& arx, Index k, const ConstMatrixRef& windows);

// Computes Σ_{k ≥ l} Ψ_{k,l}ᵀ ℓ_k for l = begin … end-1, by a backward recursion. `weights` contains ℓ_k (m × any
// each), and the results replace them.
void run_backwards(const GtvArx& arx, Index begin, Index end, std::vector<Matrix>& weights);

}  // namespace tokid::uncertainty
