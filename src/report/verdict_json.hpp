// Verdicts as JSON, for the output of the tool and for its pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/json.hpp"
#include "tokid/report.hpp"

namespace tokid {

// Numbers, and the words of in_words(). docs/formats.md lists the keys.
Json json_of(const VerdictCheck& check);
Json json_of(const std::vector<VerdictCheck>& checks);
// The verdict without its checks.
Json json_of(const Verdict& verdict);
Json with_checks(const Verdict& verdict);

}  // namespace tokid
