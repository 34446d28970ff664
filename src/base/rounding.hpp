// Limits of rounding errors in double precision.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid {

// Residuals below this share of the outputs are rounding errors: the data are free of noise.
inline constexpr double rounding_share = 1e-9;
// Windows with a larger condition number leave fewer than eight digits for the coefficients.
inline constexpr double ill_conditioned = 1e8;

}  // namespace tokid
