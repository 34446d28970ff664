// Recognises names of columns of times and their units: "time", "t [s]", "time_ms", "Time (min)", "seconds". Also
// recognises names of columns of step numbers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tokid::io {

// A unit of `seconds` / `over` seconds. One of these two numbers is 1, so that a conversion is rounded only once.
struct TimeUnit {
  std::string name = "s";  // "ms"
  double seconds = 1.0, over = 1.0;

  double in_seconds(double time) const { return time * seconds / over; }
  double from_seconds(double time) const { return time * over / seconds; }
};

// The unit of a column of times; empty for the name of another column. The name begins with "time", "t", "timestamp",
// "elapsed", "elapsed time", "time elapsed", "time since start" or "Zeit". Capital letters are allowed, except for "t",
// because T is a temperature or a period. The unit follows in brackets, or after " ", "_", "-", "/" or "in". Without a
// unit, times are in seconds. "sec" and the plurals of units up to the second ("seconds", "milliseconds since start")
// need no word before them. \throws IoError for "time" with an unknown unit in brackets
std::optional<TimeUnit> time_unit(std::string_view column);

// Is the unit that of minutes and seconds: "mm:ss", "min:s"? Without it, "05:10" is a time of hours and minutes.
bool is_minutes_and_seconds(std::string_view unit);

// Is the name "step" or "sample", alone or followed by "number", "no" or "index"? Capital letters are allowed. "index"
// alone is not accepted, because it counts the rows of a whole table.
bool is_step_number(std::string_view column);

}  // namespace tokid::io
