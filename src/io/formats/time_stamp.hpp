// Time stamps in tables: "2026-11-27T13:12:05.123Z", "27.11.2026 13:12:05,123", "11/27/2026 1:12:05 PM", "27-Nov-26
// 13:12:05", a date alone, a time of day alone.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/arrays.hpp"

namespace tokid::io {

struct Stamp {
  bool has_date = false, has_clock = false;
  int year = 0, first = 0, second = 0;  // the numbers of the date: month and day, in this order unless `open`
  bool open = false;                    // the text does not tell which of the two numbers is the day
  std::int64_t nanoseconds = 0;         // since midnight, in UTC if the text has a time zone
  int decimals = 0;                     // of the seconds
  int hours = 0;                        // as written
  bool has_seconds = false;             // false: hours and minutes alone
  bool has_half = false;                // AM or PM
  bool has_zone = false;
};

// Reads the whole text; empty if it is no time stamp. Two-digit years lie in 1970 … 2069.
std::optional<Stamp> stamp_from(std::string_view text);

// A stamp made of a column of dates and a column of times of day.
std::optional<Stamp> joined(const std::optional<Stamp>& date, const std::optional<Stamp>& clock);

struct StampTimes {
  std::vector<double> seconds;        // since the first stamp
  int decimals = 0;                   // the most of any stamp
  std::optional<std::string> remark;  // on the order of day and month, and on midnight
};

// Times in seconds of the stamps of one column. `experiments`, `lines` and `texts` of the stamps are parallel to them.
//
// The dates of the column decide whether day or month comes first, unless `order` states it. If all dates are the same,
// the order does not matter.
//
// Times of day: where those of an experiment rise, each fall is a midnight. Where they fall, because the newest row is
// first, each rise is one. At least four fifths of the changes must show the direction.
// \throws IoError if the order of day and month is needed but open, if two dates contradict each other or `order`, for
// stamps with and without dates or time zones in one column, and for times of day that need dates
StampTimes times_of(const std::vector<Stamp>& stamps, const std::vector<Index>& experiments,
                    const std::vector<Index>& lines, const Names& texts, DateOrder order);

}  // namespace tokid::io
