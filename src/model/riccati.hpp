// The gains of the Kalman filter of a model in innovations form whose states have noise beyond the innovations.
// Covariances are carried as roots (model/kalman_step.hpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// The least noise of any combination of outputs, as shares of their sizes, beside that of the noisiest. One that has
// less counts as if it had this: its gain would fit nothing but how a model of few states errs.
inline constexpr double least_noise = 1e-6;

// Sets columns of residuals (rows × m) to zero that are nothing but rounding errors of the outputs, whose norms are
// `size` (m), and those of outputs at rest: gains would be read off them.
void drop_rounding(Matrix& residuals, const Vector& size);

// What the regressions of a model in innovations form leave, by roots of the covariances Σ and Q'.
struct NoiseRoots {
  std::vector<Matrix> innovation;  // (S) of (· × m)
  std::vector<Matrix> state;       // (S) of (· × n_{k+1}), beyond the innovations
  Vector output_size;              // (m) root mean square over all steps
};

// What the regressions on states leave unexplained is process noise: the gain of the innovations form is right without
// it; with it the Kalman filter's is, which keeps the observer stable however noisy the regression for the gain was.
//   w = -G ε + w',  v = ε:   S = C P Cᵀ + Σ,  G⁺ = (G Σ - A P Cᵀ) S⁻¹,  P⁺ = A P Aᵀ + G Σ Gᵀ + Q' - G⁺ S G⁺ᵀ
// Replaces G of every step, which is that for at least least_noise, and sets innovation_cov, S. A periodic model gets
// the gains that the filter settles on.
void filter_gains(Model& model, const NoiseRoots& noise);

}  // namespace tokid
