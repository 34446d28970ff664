// Checks of regressions and Markov parameters that a caller made, and noise shapes of any width.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/markov.hpp"

namespace tokid {

// Checks the steps from k_begin on: coefficients and noise shapes are finite, residual covariances are symmetric and
// positive semidefinite, and the RMS of the outputs are finite and not negative. \throws std::invalid_argument that
// names the matrix and the step
void check(const GtvArx& arx);

// Stores the noise shape X (L_k × q) of step k and sets its `rank`. If q > L_k, an orthogonal factorisation gives a
// triangular shape (L_k × L_k) with the same X·Xᵀ. \throws std::invalid_argument if X has other than L_k rows or a
// number that is not finite, or if `arx` stores no noise shapes
void set_noise_shape(GtvArx& arx, Index k, Matrix x);

// Checks the steps from i_begin on: Markov parameters and D are finite, and variances are finite and not negative.
// \throws std::invalid_argument that names the matrix and the step
void check(const Markov& markov);

}  // namespace tokid
