// Gains of the Kalman filter for a model in innovations form whose states have additional noise. Covariances are stored
// as roots (model/kalman_step.hpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// The smallest noise of any combination of outputs, relative to the sizes of the outputs and to the noisiest
// combination. A combination with less noise is treated as if it had this much noise. Otherwise its gain would only fit
// the errors of a model with too few states.
inline constexpr double least_noise = 1e-6;

// Sets a column of residuals (rows × m) to zero if it contains only rounding errors of its output, or if the output is
// zero. `size` (m) are the norms of the outputs. Without this, the gains would depend on rounding errors.
void drop_rounding(Matrix& residuals, const Vector& size);

// The residuals of the regressions for a model in innovations form, as roots of the covariances Σ and Q': of each step,
// or of the steps of one period.
struct NoiseRoots {
  std::vector<Matrix> innovation;  // of (· × m)
  std::vector<Matrix> state;       // of (· × n_{k+1}), in addition to the innovations
  Vector output_size;              // (m) RMS over all steps
};

// Treats the residuals of the regressions on states as process noise w'. Without process noise, the gain G of the
// innovations form is optimal. With process noise, the gain of the Kalman filter is optimal. It also keeps the observer
// stable, even if the regression for G was noisy.
// w = -G ε + w', v = ε: S = C P Cᵀ + Σ, G⁺ = (G Σ - A P Cᵀ) S⁻¹, P⁺ = A P Aᵀ + G Σ Gᵀ + Q' - G⁺ S G⁺ᵀ
// Replaces G of every step by the gain for a noise of at least least_noise, and sets innovation_cov to S. A periodic
// model gets the steady periodic gains of the filter.
void filter_gains(Model& model, const NoiseRoots& noise);

}  // namespace tokid
