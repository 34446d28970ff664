// The lines of a table above its samples: notes, preamble, names and units of the columns.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "io/formats/columns.hpp"
#include "io/formats/dialect.hpp"
#include "io/formats/notes.hpp"
#include "io/formats/table_text.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// How the rows of a table begin.
struct TableStart {
  Dialect dialect;
  Notes notes;
  std::vector<Column> columns;
  Index header_line = 0, last_line = 0;  // lines of the names of the columns, and of the end of the header
  Names remarks;
};

// Reads these lines, so that the first row of samples is next. \throws IoError if no line names the columns
TableStart table_start(TableText& text, const ReadOptions& options);

}  // namespace tokid::io
