// The text of a table: its lines as UTF-8, and its rows of cells.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <csv.h>

#include <deque>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/guard/text_checksum.hpp"
#include "tokid/types.hpp"

namespace tokid::io {

using Cells = std::vector<std::string>;

struct Row {
  Index line = 0;  // number of the line where the row ends, counted from 1
  Cells cells;
};

// The first line of a .csv that tokid wrote: the checksum of the rest.
std::string checksum_line(std::string_view digits);
// Does this look like a checksum of tokid? One character of it may be damaged, and a spreadsheet program may have added
// empty cells. A checksum of another program looks different.
bool is_our_checksum(std::string_view digits);

// The cells of one line, whose quotation marks may be misplaced.
Cells cells_of(std::string_view line, char separator);

class TableText {
 public:
  struct Line {
    std::string text;  // UTF-8
    Index number = 0;
    bool open_end = false;  // the file ends here, without a line break or a closing quotation mark
  };

  explicit TableText(const std::filesystem::path& path);  // \throws IoError for UTF-16
  ~TableText();
  TableText(const TableText&) = delete;
  TableText& operator=(const TableText&) = delete;

  // The next lines, at most 200 and about 1 MB, blank lines included.
  const std::deque<Line>& ahead();
  // Removes the next line.
  void skip();
  // The next row that is not blank.
  std::optional<Row> next(char separator);

  // Is the text different from that for which the checksum was written? Must be called after the last row.
  bool is_changed() { return checksum_ && *checksum_ != rest_.digits(); }
  // Does the file end with this row, and without a line break or a closing quotation mark?
  bool has_open_end(const Row& row) const { return open_end_ && row.line == line_; }
  // The first line that is not UTF-8 and was read as Latin-1, more exactly as Windows-1252.
  std::optional<Index> latin_line() const { return latin_line_; }

 private:
  std::optional<Line> read_line();
  bool fill(size_t lines, size_t bytes);
  void to_utf8(Line& line);
  void parse_line(char separator);

  std::ifstream file_;
  csv_parser parser_{};
  std::deque<Line> ahead_;
  size_t bytes_ahead_ = 0;
  Index read_ = 0;         // lines read from the file
  Index line_ = 0;         // the line that is parsed
  bool open_end_ = false;  // of this line
  Cells cells_;
  std::deque<Row> rows_;
  std::optional<std::string> checksum_;
  TextChecksum rest_;  // checksum of the text after the first line
  std::optional<Index> latin_line_;
};

}  // namespace tokid::io
