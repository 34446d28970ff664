// What is nothing but errors of double precision.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid {

// Residuals below this share of the outputs are errors of arithmetic: the data are free of noise.
inline constexpr double rounding_share = 1e-9;
// Windows worse conditioned than this leave fewer than eight digits to the coefficients.
inline constexpr double ill_conditioned = 1e8;

}  // namespace tokid
