// The probability and the eigenvalues of intervals.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// \throws std::invalid_argument unless 0 < level < 1
void check_level(double level);

// Decides which eigenvalues of Ā'_k are clearly simple, and makes the bounds of the other eigenvalues infinite. `norm`
// is the norm of Ā'_k. An eigenvalue is not simple if a neighbour is within half the sum of the two standard errors. A
// stricter rule would accept few eigenvalues, and mostly those whose standard errors are too small. The zeros of a
// deadbeat observer do not move and do not count as neighbours. The interval of every real part is widened by rounding
// errors.
void find_simple(SpectrumBounds::Step& step, double norm);

}  // namespace tokid::uncertainty
