// Numbers and lists as text for users: in warnings, verdicts and pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tokid/types.hpp"

namespace tokid::words {

// "3, 5–9 and 12", at most six ranges
std::string ranges(const std::vector<Index>& numbers);
// "steps 3, 5–9 and 12"
std::string step_list(const std::vector<Index>& steps);
// "u1, u2 and u3"
std::string listed(const std::vector<std::string>& names);
// "83 %", "97.1 %": rounded down. Has at least `digits` decimals, and enough decimals to differ from 100 %.
std::string percent(double fit, int digits = 0);
// "83–97.1 %"; a dash if no fit is finite
std::string percent_range(const Vector& fits);
// "0.0123", "1.4·10⁵", "10⁸"; a dash for NaN. All integer digits of a number below 10⁴ are written.
std::string figure(double value, int digits = 3);
std::string probability(double p);  // "p = 0.02", "p < 0.0001"
std::string plural(Index count, std::string_view noun);
// A name from a file, for use within other text. It is cut to 80 characters. Characters that change the text direction
// are removed, and a name that runs from right to left is isolated from the text around it.
std::string quoted(std::string_view name);
// An experiment: "16", or "\"17\" (row 16)" if its name in the data is not its row. The word "experiment" is written
// before it.
std::string experiment(Index row, std::string_view name);
std::string superscript(int exponent);  // "⁻¹²"

}  // namespace tokid::words
