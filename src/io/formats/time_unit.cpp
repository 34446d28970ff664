// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/time_unit.hpp"

#include <algorithm>
#include <array>

#include "io/arrays.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

struct Known {
  TimeUnit unit;
  std::array<std::string_view, 6> names;
};

const std::array<Known, 7>& units() {
  static const std::array<Known, 7> table{{
      {{"s", 1.0, 1.0}, {"s", "sec", "secs", "second", "seconds"}},
      {{"ms", 1.0, 1e3}, {"ms", "msec", "msecs", "millisecond", "milliseconds", "millis"}},
      {{"us", 1.0, 1e6}, {"us", "\u00B5s", "\u03BCs", "usec", "microsecond", "microseconds"}},
      {{"ns", 1.0, 1e9}, {"ns", "nsec", "nsecs", "nanosecond", "nanoseconds", "nanos"}},
      {{"min", 60.0, 1.0}, {"min", "mins", "minute", "minutes"}},
      {{"h", 3600.0, 1.0}, {"h", "hr", "hrs", "hour", "hours"}},
      {{"d", 86400.0, 1.0}, {"d", "day", "days"}},
  }};
  return table;
}

std::optional<TimeUnit> unit_of(const std::string& name) {
  for (const auto& [unit, names] : units())
    if (std::find(names.begin(), names.end(), name) != names.end() && !name.empty()) return unit;
  return std::nullopt;
}

constexpr std::string_view between = " \t_-/,.:";

std::string_view stripped(std::string_view text, std::string_view marks) {
  const size_t begin = text.find_first_not_of(marks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(marks) + 1 - begin);
}

// Replaces each mark that may separate two words by a space.
std::string with_spaces(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '_' || c == '-' || c == '.'; }, ' ');
  return text;
}

// The text after a word for time; empty if `name` does not begin with such a word.
std::optional<std::string_view> behind_word(std::string_view name, std::string_view lower) {
  const std::string spaced = with_spaces(std::string(lower));
  for (const std::string_view word :
       {"time since start", "time elapsed", "elapsed time", "elapsed", "timestamp", "time", "zeit", "t"}) {
    if (!spaced.starts_with(word) || (word == "t" && name[0] != 't')) continue;
    const std::string_view rest = lower.substr(word.size());
    // This excludes words such as "temperature", "times_pressed" and "t1".
    if (rest.empty() || between.find(rest[0]) != std::string_view::npos || rest[0] == '[' || rest[0] == '(')
      return rest;
  }
  return std::nullopt;
}

// A unit that needs no word for time before it. Other units need one: "s" may be any quantity, "second" may mean the
// one after the first, and hours and minutes may be parts of a date.
std::optional<TimeUnit> unit_alone(const std::string& lower) {
  constexpr std::string_view origin = " since start";
  std::string word = with_spaces(lower);
  if (word.ends_with(origin)) word.resize(word.size() - origin.size());
  const bool is_plural = word.size() > 3 && word.ends_with('s');
  const auto unit = is_plural || word == "sec" ? unit_of(word) : std::nullopt;
  return unit && unit->seconds <= 1 ? unit : std::nullopt;
}

}  // namespace

std::optional<TimeUnit> time_unit(std::string_view column) {
  const std::string_view name = stripped(column, " \t");
  const std::string lower = in_lower_case(std::string(name));
  const auto behind = behind_word(name, lower);
  if (!behind) return unit_alone(lower);
  std::string_view rest = stripped(*behind, between);
  if (rest.empty()) return TimeUnit{};
  const bool in_brackets = (rest.front() == '[' && rest.back() == ']') || (rest.front() == '(' && rest.back() == ')');
  if (in_brackets) rest = stripped(rest.substr(1, rest.size() - 2), " \t");
  if (!in_brackets && rest.starts_with("in") && rest.size() > 2 && between.find(rest[2]) != std::string_view::npos)
    rest = stripped(rest.substr(2), between);
  const bool is_long_word = lower.size() - behind->size() > 1;
  if (auto unit = unit_of(std::string(rest))) {
    // "t_min" more likely means the smallest t than t in minutes.
    if (in_brackets || is_long_word || unit->seconds <= 1) return unit;
  }
  // A time in an unknown unit is refused, because it would be read in seconds. "t [m]" and "elapsed [m]" are no times,
  // but a thickness and a distance.
  if (in_brackets && lower.substr(0, lower.size() - behind->size()).find("time") != std::string::npos)
    fail("column '{}': the unit '{}' is not known; one of s, ms, us, ns, min, h, d needed", name, rest);
  return std::nullopt;
}

bool is_minutes_and_seconds(std::string_view unit) {
  const std::string lower = in_lower_case(std::string(unit));
  const size_t colon = lower.find(':');
  if (colon == std::string::npos) return false;
  const std::string minutes = lower.substr(0, colon), seconds = lower.substr(colon + 1);
  return (minutes == "m" || minutes == "mm" || minutes == "min") &&
         (seconds == "s" || seconds == "ss" || seconds == "sec");
}

bool is_step_number(std::string_view column) {
  const std::string name = with_spaces(in_lower_case(std::string(stripped(column, between))));
  for (const std::string word : {"step", "sample"})
    for (const char* behind : {"", " number", " no", " index"})
      if (name == word + behind) return true;
  return false;
}

}  // namespace tokid::io
