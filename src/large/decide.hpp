// Makes the choices of a stream from the first steps of the record.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/stream.hpp"

namespace tokid::stream {

struct Decision {
  Plan plan;                // for all blocks
  Identification evidence;  // of the first steps, whose findings say so
};

// \throws std::invalid_argument as identify(), and for options that need all steps of the record at once
Decision decide(const EnsembleFile& data, const IdentifyOptions& options);

}  // namespace tokid::stream
