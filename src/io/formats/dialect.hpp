// How a table is written: what separates its cells, and in which lines its columns are named.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "io/arrays.hpp"
#include "io/formats/table_text.hpp"

namespace tokid::io {

struct Dialect {
  char separator = ',';
  size_t header = 0;           // position of the line with the names of the columns among the lines ahead
  bool has_units_row = false;  // the next line that is not blank contains the units of the columns
  bool has_header = true;      // false: the first of the lines ahead contains samples already
  size_t columns = 0;          // the usual number of cells
};

// What the caller states about a table: words for missing samples, and the columns that it must have.
struct Known {
  Names missing, columns;
};

// Finds the dialect in the first lines of a file, after its comments. The separator is that for which most cells are
// numbers, time stamps or missing. The header is the first line with all known columns; without them, the last line
// before the rows of numbers, or the only line of names below a preamble of numbers.
Dialect dialect_of(const std::deque<TableText::Line>& lines, const Known& known);

}  // namespace tokid::io
