// Suggests known words for a word that the command line does not know.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tokid::app {

// ". Did you mean a or b?" with known names of similar spelling, or known names for a term of other programs. Empty if
// there are none.
std::string did_you_mean(std::string_view word, const std::vector<std::string>& known);

}  // namespace tokid::app
