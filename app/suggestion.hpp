// Suggests known words for a word that the command line does not know.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tokid::app {

// ". Did you mean a or b?", where a and b are known names: the options for this term of other programs, or else names
// with a similar spelling. Empty if there is no such name.
std::string did_you_mean(std::string_view word, const std::vector<std::string>& known);

}  // namespace tokid::app
