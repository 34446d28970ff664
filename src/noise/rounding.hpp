// Limits of rounding errors in the subspace methods, relative to the largest numbers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid::rounding {

// Pivots and singular values of regressors count as zero below this share of the largest one.
inline constexpr double negligible = 1e-12;
// Singular values of data without noise count as zero below this share of the largest one of all steps.
inline constexpr double arithmetic = 1e-9;

}  // namespace tokid::rounding
