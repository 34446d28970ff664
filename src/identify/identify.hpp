// Identification for other parts of the library, beside the public functions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/identify.hpp"

namespace tokid {

// Runs identify() on a part of an ensemble. It reports nothing about single experiments, because the part has other row
// numbers. `validated`: false if only the choices are needed, without a validation.
Identification identify_part(const Ensemble& ensemble, const IdentifyOptions& options, bool validated);

// The provenance of the model of a result, apart from its data. `chosen`: the choices of the plan are those of this
// identification.
Provenance origin_of(const IdentifyOptions& options, bool chosen, const Identification& result);

}  // namespace tokid
