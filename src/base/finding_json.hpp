// Findings and conclusions as JSON, for the output of the tool and for its pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/json.hpp"
#include "tokid/conclusion.hpp"
#include "tokid/finding.hpp"

namespace tokid {

Json json_of(const Finding& finding);
Json json_of(const Findings& findings);
Json json_of(const std::vector<FindingChannel>& channels);
// An object with one member for each test, under the name of the test.
Json json_of(const Conclusions& conclusions);

}  // namespace tokid
