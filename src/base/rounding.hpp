// Limits of rounding errors in double precision.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid {

// If the residuals are below this share of the outputs, they are rounding errors, and the data are free of noise.
inline constexpr double rounding_share = 1e-9;
// Windows with a larger condition number leave fewer than eight digits for the coefficients.
inline constexpr double ill_conditioned = 1e8;

}  // namespace tokid
