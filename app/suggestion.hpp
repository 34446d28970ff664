// What the user may have meant by a word that the command line does not know.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tokid::app {

// ". Did you mean a or b?" with the known names that are spelled almost like the word, or that other programs call so;
// empty where there are none.
std::string did_you_mean(std::string_view word, const std::vector<std::string>& known);

}  // namespace tokid::app
