// Experiments that repeat the inputs of others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// Number of different input courses. Equal courses agree to the last bit; missing samples equal each other. Hashes
// avoid most comparisons.
Index input_courses(const Ensemble& ensemble);

// `needed`: the number of experiments that this lag order needs, 0 where steps share a model.
Findings findings_of_repeats(const Ensemble& ensemble, Index needed, Index lags);

}  // namespace tokid
