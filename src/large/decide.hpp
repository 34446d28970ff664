// Makes the choices of a stream on a few stretches of the record.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/stream.hpp"

namespace tokid::stream {

struct Decision {
  Plan plan;
  Identification evidence;  // of the stretch with the adopted choices, with the choices for all
};

// \throws std::invalid_argument as identify(), and for options that need all steps at once
Decision decide(const EnsembleFile& data, const IdentifyOptions& options);

}  // namespace tokid::stream
