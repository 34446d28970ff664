// Makes the choices of a stream from a few stretches of the record.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/stream.hpp"

namespace tokid::stream {

struct Decision {
  Plan plan;
  Identification evidence;  // of the stretch whose choices are used, with the plan and findings for all
};

// \throws std::invalid_argument as identify(), and for options that need all steps of the record at once
Decision decide(const EnsembleFile& data, const IdentifyOptions& options);

}  // namespace tokid::stream
