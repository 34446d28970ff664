// Numbers and lists for people: in warnings, verdicts and pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tokid/types.hpp"

namespace tokid::words {

// "3, 5–9 and 12", a few ranges at most
std::string ranges(const std::vector<Index>& numbers);
// "steps 3, 5–9 and 12"
std::string step_list(const std::vector<Index>& steps);
// "u1, u2 and u3"
std::string listed(const std::vector<std::string>& names);
// "83 %", "97.1 %", cut rather than rounded, with at least so many digits, and as many as tell it from 100 %
std::string percent(double fit, int digits = 0);
// "83–97.1 %"; a dash where there is none
std::string percent_range(const Vector& fits);
// "0.0123", "1.4·10⁵"; a dash for NaN
std::string figure(double value, int digits = 4);
std::string probability(double p);  // "p = 0.02", "p < 0.0001"
std::string plural(Index count, std::string_view noun);
// A name from a file amid other text: cut to 80 characters, without marks that turn the direction of the text around
// it, and where it runs from right to left isolated from its neighbours.
std::string quoted(std::string_view name);
// An experiment: "16", or where the data have another name for it than its row, "\"17\" (row 16)". Beside "experiment".
std::string experiment(Index row, std::string_view name);
std::string superscript(int exponent);  // "⁻¹²"

}  // namespace tokid::words
