// The candidates that an identification compared to choose p, λ, n and EM, as tables of a page.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "tokid/identify.hpp"

namespace tokid::report {

// HTML; empty if the identification compared no candidates.
std::string selection_tables(const Identification& identified);

}  // namespace tokid::report
