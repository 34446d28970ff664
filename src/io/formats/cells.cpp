// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/cells.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include "io/formats/time_stamp.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

constexpr std::array known_units{
    // of SI and with SI prefixes
    "m", "g", "s", "A", "K", "mol", "cd", "Hz", "N", "Pa", "J", "W", "C", "V", "F", "Ohm", "ohm", "\u03A9", "\u2126",
    "S", "Wb", "T", "H", "lm", "lx", "Bq", "rad", "bar", "l", "L", "t", "eV", "Nm", "VA", "var", "cal", "Ah", "Wh", "a",
    "M",
    // without prefixes
    "%", "min", "h", "hr", "d", "sec", "deg", "\u00B0", "\u00B0C", "\u00B0F", "\u00BAC", "degC", "degF", "DegC", "DEG",
    "rpm", "RPM", "psi", "psig", "psia", "barg", "bara", "barG", "in", "inch", "ft", "lb", "lbs", "gal", "gpm", "ppm",
    "ppb", "pH", "rev", "U", "Umdr", "counts", "count", "-", "1", "pu", "p.u.", "dB", "mmHg", "inH2O", "Nm3", "Nl",
    "kgf", "px", "atm", "Torr", "torr", "cP", "cSt", "Std", "Grad", "vol%", "Vol%", "wt%", "mol%", "scfm", "cfm", "BTU",
    "hp", "kn", "mph", "g0", "deg C", "deg F", "bits", "steps", "months", "weeks"};
constexpr size_t with_prefix = 40;  // the first entries

bool is_known(std::string_view unit) {
  const auto begin = known_units.begin();
  if (std::find(begin, known_units.end(), unit) != known_units.end()) return true;
  for (const std::string_view prefix :
       {"m", "k", "M", "G", "\u00B5", "\u03BC", "u", "n", "p", "c", "d", "h", "T", "da"})
    if (unit.starts_with(prefix) &&
        std::find(begin, begin + with_prefix, unit.substr(prefix.size())) != begin + with_prefix)
      return true;
  return false;
}

// Removes an exponent: "m3", "s^-1", "s-2", "m\u00B2".
std::string_view without_exponent(std::string_view unit) {
  for (const std::string_view power : {"\u00B2", "\u00B3", "\u207B\u00B9", "\u207B\u00B2"})
    if (unit.size() > power.size() && unit.ends_with(power)) return unit.substr(0, unit.size() - power.size());
  const size_t last = unit.find_last_not_of("0123456789");
  if (last == std::string_view::npos || last + 1 == unit.size()) return unit;
  size_t end = last + 1;
  if (end > 1 && unit[end - 1] == '-') --end;
  if (end > 1 && unit[end - 1] == '^') --end;
  return unit.substr(0, end);
}

bool is_bracketed(std::string_view text) {
  return text.size() > 2 &&
         ((text.front() == '[' && text.back() == ']') || (text.front() == '(' && text.back() == ')'));
}

}  // namespace

std::string_view stripped(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") + 1 - begin);
}

std::optional<double> number_from(std::string_view text, char decimal_mark) {
  if (text.starts_with('+')) text.remove_prefix(1);
  std::string with_point;
  if (decimal_mark == ',' && text.find_first_of(".,") != std::string_view::npos) {
    if (text.find('.') != std::string_view::npos) return std::nullopt;
    with_point = text;
    std::replace(with_point.begin(), with_point.end(), ',', '.');
    text = with_point;
  }
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

bool may_be_thousands(std::string_view number) {
  if (number.starts_with('+') || number.starts_with('-')) number.remove_prefix(1);
  const size_t mark = number.find_first_of(".,");
  if (mark == std::string_view::npos || mark < 1 || mark > 3 || number.front() == '0') return false;
  const std::string_view digits = "0123456789", behind = number.substr(mark + 1);
  return behind.size() == 3 && number.substr(0, mark).find_first_not_of(digits) == std::string_view::npos &&
         behind.find_first_not_of(digits) == std::string_view::npos;
}

std::optional<double> switch_state(std::string_view text) {
  if (text.size() > 5) return std::nullopt;
  const std::string lower = in_lower_case(std::string(text));
  if (lower == "on" || lower == "true") return 1.0;
  return lower == "off" || lower == "false" ? std::optional(0.0) : std::nullopt;
}

bool is_missing(std::string_view text) { return text.empty() || text == "NA"; }

bool is_word_for_missing(std::string_view text) {
  static const Names words{
      "bad",         "bad input",  "bad data",    "bad quality", "baddata",    "bad value",   "na",         "n/a",
      "#n/a",        "#na",        "#n/a n/a",    "#nv",         "nan",        "-nan",        "null",       "none",
      "nil",         "<null>",     "(null)",      "no data",     "nodata",     "no value",    "no sample",  "missing",
      "void",        "invalid",    "error",       "err",         "fault",      "fail",        "failed",     "timeout",
      "offline",     "off-line",   "unavailable", "stale",       "uncertain",  "i/o timeout", "io timeout", "io error",
      "comm fail",   "comm error", "scan off",    "not connect", "shutdown",   "pt created",  "?",          "??",
      "???",         "over range", "overrange",   "under range", "underrange", "1.#qnan",     "1.#ind",     "-1.#ind",
      "#value!",     "#div/0!",    "#ref!",       "#num!",       "#wert!",     "<na>",        "nat",        "configure",
      "calc failed", "no result",  "arc off-line"};
  if (text.empty() || text.size() > 16) return false;
  if (text.find_first_not_of('-') == std::string_view::npos) return true;  // "-", "---"
  if (text == "\u2013" || text == "\u2014") return true;
  return contains(words, in_lower_case(std::string(text)));
}

bool is_value(std::string_view text) {
  return number_from(text, '.') || number_from(text, ',') || is_missing(text) || is_word_for_missing(text) ||
         switch_state(text) || stamp_from(text);
}

bool is_unit(std::string_view text) {
  text = stripped(text);
  if (is_bracketed(text)) return true;
  if (text.empty() || text.size() > 20) return false;
  if (is_known(text)) return true;
  while (!text.empty()) {
    const size_t end = std::min(text.find_first_of("/*. "), text.find("\u00B7"));
    std::string_view part = text.substr(0, end);
    if (part.starts_with('(')) part.remove_prefix(1);
    if (part.ends_with(')')) part.remove_suffix(1);
    if (!is_known(part) && !is_known(without_exponent(part))) return false;
    if (end == std::string_view::npos) return true;
    text.remove_prefix(end + (text.substr(end).starts_with("\u00B7") ? 2 : 1));
  }
  return false;
}

Label label_from(std::string_view column) {
  const std::string_view whole = stripped(column);
  const bool square = whole.ends_with(']');
  if (!square && !whole.ends_with(')')) return {std::string(whole), ""};
  const size_t begin = whole.rfind(square ? '[' : '(');
  if (begin == std::string_view::npos || begin == 0) return {std::string(whole), ""};
  const std::string_view name = stripped(whole.substr(0, begin));
  const std::string_view unit = stripped(whole.substr(begin + 1, whole.size() - begin - 2));
  const bool is_index = unit.find_first_not_of("0123456789,: ") == std::string_view::npos;
  if (name.empty() || is_index || (!square && !is_unit(unit))) return {std::string(whole), ""};
  return {std::string(name), std::string(unit)};
}

}  // namespace tokid::io
