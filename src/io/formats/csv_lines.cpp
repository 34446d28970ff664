// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/csv_lines.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <numeric>

#include "io/text.hpp"

namespace tokid::io {

namespace {

constexpr std::string_view checksum_begin = "# checksum = ";

// The checksum in the first line; empty for another kind of line. If one character before the digits is damaged, the
// result is "", which matches no text.
std::optional<std::string> checksum_in(std::string_view line) {
  if (line.size() < checksum_begin.size()) return std::nullopt;
  const auto same = std::inner_product(checksum_begin.begin(), checksum_begin.end(), line.begin(), size_t{0},
                                       std::plus<>(), std::equal_to<>());
  if (same + 1 < checksum_begin.size()) return std::nullopt;
  return same < checksum_begin.size() ? "" : std::string(line.substr(checksum_begin.size()));
}

}  // namespace

std::string_view stripped(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") + 1 - begin);
}

std::string checksum_line(std::string_view digits) { return fmt::format("{}{}\n", checksum_begin, digits); }

CsvLines::CsvLines(const std::filesystem::path& path) : file_(path, std::ios::binary) {
  if (!file_ || csv_init(&parser_, CSV_STRICT | CSV_STRICT_FINI) != 0) fail("can't be read");
}

CsvLines::~CsvLines() { csv_free(&parser_); }

bool CsvLines::read_line() {
  if (!std::getline(file_, text_)) return false;
  ++number_;
  open_end_ = file_.eof() && !text_.ends_with('"') && !text_.ends_with('\r');
  if (checksum_) rest_.add(text_), rest_.add(file_.eof() ? "" : "\n");
  constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";
  if (number_ == 1 && text_.starts_with(byte_order_mark)) text_.erase(0, byte_order_mark.size());
  const bool ascii = std::all_of(text_.begin(), text_.end(), [](unsigned char c) { return c < 0x80; });
  if (!ascii && !utf32_from(text_)) fail("line {}: bytes found that are not UTF-8", number_);
  return true;
}

bool CsvLines::next() {
  blank_ = 0;
  while (read_line()) {
    if (number_ == 1 && (checksum_ = checksum_in(text()))) continue;
    if (text_.find_first_not_of(" \r") != std::string::npos) return true;  // a row of tabs has empty cells
    blank_ = number_;
  }
  return false;
}

const Names& CsvLines::cells(char separator) {
  const auto on_cell = [](void* text, size_t size, void* self) {
    static_cast<CsvLines*>(self)->cells_.emplace_back(static_cast<const char*>(text), size);
  };
  const auto on_row = [](int, void* self) { static_cast<CsvLines*>(self)->row_ended_ = true; };
  cells_.clear();
  row_ended_ = false;
  csv_set_delim(&parser_, static_cast<unsigned char>(separator));
  do {
    text_ += '\n';
    if (csv_parse(&parser_, text_.data(), text_.size(), on_cell, on_row, this) != text_.size())
      fail("line {}: misplaced quotation mark found, plain or quoted cells needed", number_);
  } while (!row_ended_ && read_line());
  if (!row_ended_) fail("line {}: the end found within a quoted cell, a closing quotation mark needed", number_);
  return cells_;
}

}  // namespace tokid::io
