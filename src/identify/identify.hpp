// What the library itself asks of identify() beside the public one.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/identify.hpp"

namespace tokid {

// identify() of a part of an ensemble, whose experiments have other numbers there: nothing is said of single ones.
// Where the choices alone are wanted it is not validated.
Identification identify_part(const Ensemble& ensemble, const IdentifyOptions& options, bool validated);

}  // namespace tokid
