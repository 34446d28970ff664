// The lines of a .csv file, and their cells.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <csv.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>

#include "io/arrays.hpp"
#include "io/guard/text_checksum.hpp"

namespace tokid::io {

std::string_view stripped(std::string_view text);  // without spaces and tabs at both ends

// The first line of a .csv that tokid wrote: the checksum of the rest.
std::string checksum_line(std::string_view digits);

class CsvLines {
 public:
  explicit CsvLines(const std::filesystem::path& path);
  ~CsvLines();
  CsvLines(const CsvLines&) = delete;
  CsvLines& operator=(const CsvLines&) = delete;

  // Goes to the next line that is not blank. False: there is none. \throws IoError for a text that is not UTF-8
  bool next();
  std::string_view text() const { return stripped(text_); }
  Index number() const { return number_; }  // of this line, from 1
  Index blank() const { return blank_; }    // the blank line before this line; 0: none
  // The cells of this line, and of those after it that a quoted cell spans. \throws IoError for a misplaced quotation
  // mark
  const Names& cells(char separator);

  // After the last line: is the text different from that for which the checksum was written?
  bool is_changed() { return checksum_ && *checksum_ != rest_.digits(); }
  // Does the file end with this line, without a line break or a closing quotation mark?
  bool has_open_end() const { return open_end_; }

 private:
  bool read_line();

  std::ifstream file_;
  csv_parser parser_{};
  std::string text_;
  Index number_ = 0, blank_ = 0;
  bool open_end_ = false, row_ended_ = false;
  Names cells_;
  std::optional<std::string> checksum_;
  TextChecksum rest_;  // checksum of the text after the first line
};

}  // namespace tokid::io
