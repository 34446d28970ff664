// What a column is called that holds times, and in which unit: "time", "t [s]", "time_ms", "Time (min)", "seconds"; and
// what one is called that holds step numbers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tokid::io {

// So many seconds over so many: either is one, so that a conversion rounds once.
struct TimeUnit {
  std::string name = "s";  // "ms"
  double seconds = 1.0, over = 1.0;

  double in_seconds(double time) const { return time * seconds / over; }
  double from_seconds(double time) const { return time * over / seconds; }
};

// Empty for the name of another column. The word is "time", "t", "timestamp", "elapsed", "elapsed time", "time elapsed"
// or "time since start"; capitals are allowed, but not of "t", for T is a temperature or a period. The unit follows in
// brackets, or after " ", "_", "-", "/", "in"; without one it is the second. "sec" and units up to the second in the
// plural, "seconds", "milliseconds since start", need no word. \throws IoError for "time" with a unit in brackets that
// is not known
std::optional<TimeUnit> time_unit(std::string_view column);

// "step" or "sample", alone or with "number", "no" or "index" behind it, in small letters or capitals. An "index"
// counts the rows of a whole table.
bool is_step_number(std::string_view column);

}  // namespace tokid::io
