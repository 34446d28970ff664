// Printed text: lines of at most 100 columns, rows with labels, and tables.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tokid::app {

inline constexpr std::size_t line_columns = 100;

// Each code point counts as one column. This is wrong only for wide characters, such as Chinese ones, and for combining
// ones.
std::size_t width(std::string_view text);

// Breaks a text at its spaces into lines of at most `columns` columns, joined by `separator`. A longer word, such as
// the name of a file, is not broken. A number keeps its sign of equality and its percent sign.
std::string wrapped(std::string_view text, std::size_t columns, std::string_view separator);

// A printed text: rows with a label and its text, and tables.
class Page {
 public:
  void row(std::string_view label, std::string_view text);
  // A command to take next, after what it is for. It can be copied: a broken line ends with a backslash.
  void command(std::string_view label, std::string_view purpose, std::string_view command);
  // The first row is the heading. The first column is aligned to the left, the others to the right. A table that is too
  // wide is broken into parts, each with the first column.
  void table(const std::vector<std::vector<std::string>>& rows) { table("", rows); }
  void table(std::string_view label, const std::vector<std::vector<std::string>>& rows);
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

}  // namespace tokid::app
