// Outliers → findings.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/finding.hpp"
#include "tokid/outlier.hpp"

namespace tokid {

// `reported`: experiments that are already reported; they are left out, unless they were dropped or downweighted.
Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported = {});

}  // namespace tokid
