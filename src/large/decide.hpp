// Makes the choices of a stream from a few stretches of the record.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/stream.hpp"

namespace tokid::stream {

struct Decision {
  Plan plan;
  Identification evidence;  // of the stretch whose choices are used, with the plan and findings for all
};

// Every member of the team must call this function. The members share the stretches, and only the first one gets the
// decision. It has the same bits for any number of members.
// \throws std::invalid_argument as identify(), and for options that need all steps of the record at once
Decision decide(const EnsembleFile& data, const IdentifyOptions& options, const Team& team);

}  // namespace tokid::stream
