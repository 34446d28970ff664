// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/table_numbers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/words.hpp"

namespace tokid::io {

namespace {

constexpr double missing_number = std::numeric_limits<double>::quiet_NaN();

}  // namespace

std::string remark_on_guesses(const Guesses& guesses) {
  Index cells = 0;
  Names words;
  for (const auto& [word, guess] : guesses) {
    cells += guess.cells;
    words.push_back(word);
  }
  const auto first = std::min_element(guesses.begin(), guesses.end(), [](const auto& a, const auto& b) {
    return std::pair(a.second.file, a.second.line) < std::pair(b.second.file, b.second.line);
  });
  return fmt::format("{} with {} {}. The first one is at {}", words::plural(cells, "cell"), quoted(words),
                     cells == 1 ? "was read as a missing sample" : "were read as missing samples", first->second.first);
}

void add_guesses(const Guesses& more, size_t number, const std::string& file, Guesses& to) {
  for (const auto& [word, guess] : more) {
    Guess& sum = to[word];
    if (sum.cells == 0) sum = {0, number, guess.line, fmt::format("{}, {}", file, guess.first)};
    sum.cells += guess.cells;
  }
}

void ColumnValues::add(std::string_view text) {
  const char first = text.front();
  const bool is_letter = (first >= 'A' && first <= 'Z') || (first >= 'a' && first <= 'z') || (first & 0x80) != 0;
  only_words_ = only_words_ && is_letter;
  if (texts_.size() <= most && !contains(texts_, text)) texts_.emplace_back(text);
}

void ColumnValues::add(const ColumnValues& more) {
  for (const std::string& text : more.texts_) add(std::string_view(text));
  only_words_ = only_words_ && more.only_words_;
  low_ = std::min(low_, more.low_), high_ = std::max(high_, more.high_);
}

std::string ColumnValues::described() const {
  Names parts;
  if (has_numbers())
    parts.push_back(low_ < high_ ? fmt::format("numbers from {:.6g} to {:.6g}", low_, high_)
                                 : fmt::format("the number {:.6g}", low_));
  Names shown;
  for (const std::string& text : texts_) shown.push_back(fmt::format("'{}'", words::quoted(text)));
  if (has_more()) shown.back() = "others";
  if (!shown.empty()) parts.push_back(fmt::format("the text{} {}", shown.size() > 1 ? "s" : "", words::listed(shown)));
  return parts.empty() ? "only missing samples" : words::listed(parts);
}

NumberReader::NumberReader(const Names& missing_words) : words_(missing_words) {
  for (const std::string& word : words_)
    if (const auto number = number_from(word, '.')) numbers_.push_back(*number);
}

double NumberReader::number(std::string_view cell, Index line, const std::string& column) {
  if (is_missing(cell) || contains(words_, cell)) return missing_number;
  if (const auto value = counted_value(cell, line, column)) {
    const bool stated = std::find(numbers_.begin(), numbers_.end(), *value) != numbers_.end();
    return stated ? missing_number : *value;
  }
  if (const auto state = switch_state(cell)) {
    has_switches_ = true;
    return *state;
  }
  if (!stands_for_missing(cell, line, column)) fail_number(cell, line, column, true);
  return missing_number;
}

double NumberReader::time(std::string_view cell, Index line, const std::string& column) {
  if (const auto value = counted_value(cell, line, column)) return *value;
  if (!is_missing(cell) && !is_word_for_missing(cell)) fail_number(cell, line, column, false);
  return missing_number;
}

bool NumberReader::stands_for_missing(std::string_view text, Index line, const std::string& column) {
  if (is_missing(text) || contains(words_, text)) return true;
  if (!is_word_for_missing(text)) return false;
  Guess& guess = guesses_[std::string(text)];
  if (guess.cells++ == 0) guess.line = line, guess.first = fmt::format("line {}, column '{}'", line, column);
  return true;
}

std::optional<std::string> NumberReader::remark_on_marks(char separator) const {
  if (mark_ == '\0' || (mark_ == '.' && (separator == ',' || !only_thousands_))) return std::nullopt;
  if (mark_ == ',' && separator == ',' && only_thousands_)
    fail(
        "line {}: '{}' found; its comma and the commas of all numbers may group thousands or be decimal commas; numbers "
        "without marks of thousands and with a decimal point needed",
        mark_line_, words::quoted(mark_cell_));
  const auto mixed = std::find_if(marked_.begin(), marked_.end(),
                                  [&](const std::string& column) { return below_thousand_.count(column) > 0; });
  if (only_thousands_ && mixed != marked_.end())
    fail(
        "line {}: '{}' found; this mark and those of all numbers seem to group thousands, because column '{}' has "
        "whole numbers below 1000 without one; numbers without marks of thousands needed",
        mark_line_, words::quoted(mark_cell_), *mixed);
  const char* name = mark_ == ',' ? "comma" : "point";
  return only_thousands_
             ? fmt::format(
                   "{0}s in numbers were read as decimal {0}s, so 1{1}000 is 1. If they group thousands, remove the {0}s",
                   name, mark_)
             : fmt::format("{0}s in numbers were read as decimal {0}s, so 1{1}5 is 1.5", name, mark_);
}

std::optional<std::string> NumberReader::remark_on_switches() const {
  if (!has_switches_) return std::nullopt;
  return "cells with on and true were read as 1, and cells with off and false as 0";
}

std::string NumberReader::with_point(std::string text) const {
  if (mark_ == ',') std::replace(text.begin(), text.end(), ',', '.');
  return text;
}

std::optional<double> NumberReader::counted_value(std::string_view cell, Index line, const std::string& column) {
  const auto value = value_of(cell, line, column);
  if (!value || !only_thousands_) return value;
  const bool marked = mark_ != '\0' && cell.find(mark_) != std::string_view::npos;
  if (marked) only_thousands_ = may_be_thousands(cell);
  const bool below_thousand = !marked && cell.find_first_not_of("0123456789+-") == std::string_view::npos &&
                              std::abs(*value) < 1000 && *value != 0;
  if (marked)
    marked_.insert(column);
  else if (below_thousand)
    below_thousand_.insert(column);
  return value;
}

std::optional<double> NumberReader::value_of(std::string_view cell, Index line, const std::string& column) {
  if (mark_ != ',') {
    const auto value = number_from(cell, '.');
    if (value && mark_ == '\0' && cell.find('.') != std::string_view::npos) decide('.', line, cell);
    if (value || mark_ == '.') return value;
  }
  const auto value = number_from(cell, ',');
  if (value && mark_ == '\0' && cell.find(',') != std::string_view::npos) decide(',', line, cell);
  if (!value && number_from(cell, '.'))
    fail("line {}, column '{}': '{}' found, but '{}' in line {}; the same decimal mark in the whole table needed", line,
         column, words::quoted(cell), words::quoted(mark_cell_), mark_line_);
  return value;
}

void NumberReader::fail_number(std::string_view cell, Index line, const std::string& column,
                               bool may_be_missing) const {
  const std::string at = fmt::format("line {}, column '{}': '{}' found", line, column, words::quoted(cell));
  if (mark_ == '.' && number_from(cell, ','))
    fail("{}, but '{}' in line {}; the same decimal mark in the whole table needed", at, words::quoted(mark_cell_),
         mark_line_);
  if (number_from(cell, '.') || number_from(cell, ',') || !may_be_missing) fail("{}, a number needed", at);
  const bool has_digits = cell.find_first_of("0123456789") != std::string_view::npos;
  throw TextFound(fmt::format("{}, a number needed", at),
                  has_digits ? "" : fmt::format("; --missing '{}' reads it as a missing sample", words::quoted(cell)));
}

}  // namespace tokid::io
