// Recognises the names of columns of times, with their unit: "time", "t [s]", "time_ms", "Time (min)", "seconds". Also
// recognises the names of columns of step numbers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tokid::io {

// A unit of `seconds` / `over` seconds. One of the two numbers is 1, so that a conversion rounds once.
struct TimeUnit {
  std::string name = "s";  // "ms"
  double seconds = 1.0, over = 1.0;

  double in_seconds(double time) const { return time * seconds / over; }
  double from_seconds(double time) const { return time * over / seconds; }
};

// Empty for the name of another column. The word is "time", "t", "timestamp", "elapsed", "elapsed time", "time elapsed"
// or "time since start". Capitals are allowed, except for "t", because T is a temperature or a period. The unit follows
// in brackets, or after " ", "_", "-", "/", "in". Without a unit it is the second. "sec" and plural units up to the
// second, "seconds", "milliseconds since start", need no word. \throws IoError for "time" with an unknown unit in
// brackets
std::optional<TimeUnit> time_unit(std::string_view column);

// "step" or "sample", alone or followed by "number", "no" or "index", in small letters or capitals. An "index" counts
// the rows of a whole table.
bool is_step_number(std::string_view column);

}  // namespace tokid::io
