// Experiments that repeat the inputs of others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// Different courses of the inputs, equal to the last bit; missing samples equal each other. Hashes rule most out.
Index input_courses(const Ensemble& ensemble);

// `needed` are the experiments that it takes at this lag order, 0 where steps lend each other theirs.
Findings findings_of_repeats(const Ensemble& ensemble, Index needed, Index lags);

}  // namespace tokid
