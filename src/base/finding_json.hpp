// Findings and conclusions as JSON: the same for the tool and the pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/json.hpp"
#include "tokid/conclusion.hpp"
#include "tokid/finding.hpp"

namespace tokid {

Json json_of(const Finding& finding);
Json json_of(const std::optional<Explanation>& explanation);  // null without one
Json json_of(const Findings& findings);
// One object for each test, by the name of the test.
Json json_of(const Conclusions& conclusions);

}  // namespace tokid
