// The content of the cells of a table: numbers, words for missing samples, names with units.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "io/arrays.hpp"

namespace tokid::io {

std::string_view stripped(std::string_view text);  // without spaces and tabs at both ends

// Reads the whole text as a number with the given decimal mark, '.' or ','. "NaN" is a number, too.
std::optional<double> number_from(std::string_view text, char decimal_mark);

// Can the one mark in this number, a point or a comma, group thousands: "1,000", "-25.125"?
bool may_be_thousands(std::string_view number);

// The state of a switch: 1 for "on" and "true", 0 for "off" and "false", in any letters; empty for another text.
std::optional<double> switch_state(std::string_view text);

// Does this text stand for a missing sample in tables of any program? These are an empty cell, "NaN" and "NA".
bool is_missing(std::string_view text);
// Is this a word that probably stands for a missing sample, such as "Bad", "---", "null", "#N/A" or "I/O Timeout"?
bool is_word_for_missing(std::string_view text);

// Is this a number with any decimal mark, a time stamp, or a word for a missing sample?
bool is_value(std::string_view text);

struct Label {
  std::string name, unit;
};

// Separates "p [bar]" and "T (degC)" into name and unit. Square brackets contain a unit unless they contain a number,
// round brackets only if their content is a known unit. For any other name, the unit is empty.
Label label_from(std::string_view column);

// Is this a unit that is known, a product or a quotient of known units, or any text in brackets?
bool is_unit(std::string_view text);

}  // namespace tokid::io
