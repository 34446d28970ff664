// Gains of the Kalman filter for a model in innovations form whose states have additional noise. Covariances are stored
// as roots (model/kalman_step.hpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// Smallest noise of any combination of outputs, relative to their sizes and to the noisiest combination. A combination
// with less noise counts as if it had this much. Otherwise its gain would only fit the errors of a model with too few
// states.
inline constexpr double least_noise = 1e-6;

// Sets columns of residuals (rows × m) to zero if they are only rounding errors of the outputs, or if an output is
// zero. The outputs have the norms `size` (m). Otherwise, the gains would depend on these errors.
void drop_rounding(Matrix& residuals, const Vector& size);

// The residuals of the regressions for a model in innovations form, as roots of the covariances Σ and Q'.
struct NoiseRoots {
  std::vector<Matrix> innovation;  // (S) of (· × m)
  std::vector<Matrix> state;       // (S) of (· × n_{k+1}), in addition to the innovations
  Vector output_size;              // (m) RMS over all steps
};

// Treats the residuals of the regressions on states as process noise. Without process noise, the gain of the
// innovations form is optimal. With it, the gain of the Kalman filter is, and it keeps the observer stable however
// noisy the regression for the gain was.
//   w = -G ε + w',  v = ε:   S = C P Cᵀ + Σ,  G⁺ = (G Σ - A P Cᵀ) S⁻¹,  P⁺ = A P Aᵀ + G Σ Gᵀ + Q' - G⁺ S G⁺ᵀ
// Replaces G of every step by the gain for a noise of at least least_noise, and sets innovation_cov to S. A periodic
// model gets the steady periodic gains of the filter.
void filter_gains(Model& model, const NoiseRoots& noise);

}  // namespace tokid
