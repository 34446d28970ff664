// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/table_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <utility>

#include "io/arrays.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

constexpr std::string_view checksum_begin = "# checksum = ";

// The checksum in this line; empty for another kind of line. If one character before the digits is damaged, the result
// is "", which matches no text.
std::optional<std::string> checksum_in(std::string_view line) {
  if (line.size() < checksum_begin.size()) return std::nullopt;
  const auto same = std::inner_product(checksum_begin.begin(), checksum_begin.end(), line.begin(), size_t{0},
                                       std::plus<>(), std::equal_to<>());
  if (same + 1 < checksum_begin.size()) return std::nullopt;
  std::string_view digits = line.substr(checksum_begin.size());
  digits.remove_suffix(digits.ends_with('\r') ? 1 : 0);
  if (!is_our_checksum(digits)) return std::nullopt;
  return same < checksum_begin.size() ? "" : std::string(digits);
}

bool is_ascii(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0x80U) == 0; });
}

// Windows-1252 is Latin-1 with printable characters in the place of U+0080 … U+009F.
std::string utf8_from_windows(std::string_view bytes) {
  constexpr std::array<char32_t, 32> printable{0x20AC, 0x81,   0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021,
                                               0x02C6, 0x2030, 0x0160, 0x2039, 0x0152, 0x8D,   0x017D, 0x8F,
                                               0x90,   0x2018, 0x2019, 0x201C, 0x201D, 0x2022, 0x2013, 0x2014,
                                               0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0x9D,   0x017E, 0x0178};
  std::u32string characters;
  for (const char c : bytes) {
    const char32_t code = static_cast<unsigned char>(c);
    characters.push_back(code >= 0x80 && code < 0xA0 ? printable[code - 0x80] : code);
  }
  return utf8_from(characters).value_or(std::string());
}

void check_encoding(std::string_view first_line) {
  const bool marked = first_line.starts_with("\xFF\xFE") || first_line.starts_with("\xFE\xFF");
  const bool unmarked =
      first_line.size() > 3 && (first_line[1] == '\0' || first_line[0] == '\0') && first_line[0] != first_line[1];
  if (marked || unmarked)
    fail("UTF-16 found, UTF-8 needed. Save the table as 'CSV UTF-8', or convert it: iconv -f UTF-16 -t UTF-8");
}

void add_cell(void* text, size_t size, void* cells) {
  static_cast<Cells*>(cells)->emplace_back(static_cast<const char*>(text), size);
}

}  // namespace

std::string checksum_line(std::string_view digits) { return fmt::format("{}{}\n", checksum_begin, digits); }

bool is_our_checksum(std::string_view digits) {
  digits = digits.substr(0, digits.find_last_not_of(",;\t ") + 1);
  const auto is_digit = [](char c) { return std::string_view("0123456789abcdef").find(c) != std::string_view::npos; };
  return digits.size() <= 16 &&
         std::count_if(digits.begin(), digits.end(), is_digit) + 1 >= std::ptrdiff_t(digits.size());
}

Cells cells_of(std::string_view line, char separator) {
  csv_parser parser{};
  Cells cells;
  if (csv_init(&parser, 0) != 0) return cells;
  csv_set_delim(&parser, static_cast<unsigned char>(separator));
  const auto end_of_row = [](int, void*) {};
  csv_parse(&parser, line.data(), line.size(), add_cell, end_of_row, &cells);
  csv_fini(&parser, add_cell, end_of_row, &cells);
  csv_free(&parser);
  return cells;
}

TableText::TableText(const std::filesystem::path& path) : file_(path, std::ios::binary) {
  if (!file_ || csv_init(&parser_, CSV_STRICT | CSV_STRICT_FINI) != 0) fail("can't be read");
  constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";
  std::string line;
  if (!std::getline(file_, line)) return;
  check_encoding(line);
  if (line.starts_with(byte_order_mark)) line.erase(0, byte_order_mark.size());
  checksum_ = checksum_in(line);
  ++read_;
  if (checksum_) return;
  const bool open = file_.eof() && !line.ends_with('"') && !line.ends_with('\r');
  ahead_.push_back({std::move(line), read_, open});
  to_utf8(ahead_.front());
  bytes_ahead_ = ahead_.front().text.size();
}

TableText::~TableText() { csv_free(&parser_); }

std::optional<TableText::Line> TableText::read_line() {
  Line line;
  if (!std::getline(file_, line.text)) return std::nullopt;
  line.number = ++read_;
  if (checksum_) rest_.add(line.text), rest_.add(file_.eof() ? "" : "\n");
  line.open_end = file_.eof() && !line.text.ends_with('"') && !line.text.ends_with('\r');
  return line;
}

// Reads lines until there are so many, or so many bytes; returns whether there is any line.
bool TableText::fill(size_t lines, size_t bytes) {
  while (ahead_.size() < lines && (ahead_.empty() || bytes_ahead_ < bytes)) {
    std::optional<Line> line = read_line();
    if (!line) break;
    to_utf8(*line);
    bytes_ahead_ += line->text.size();
    ahead_.push_back(*std::move(line));
  }
  return !ahead_.empty();
}

void TableText::to_utf8(Line& line) {
  if (is_ascii(line.text) || utf32_from(line.text)) return;
  if (!latin_line_) latin_line_ = line.number;
  line.text = utf8_from_windows(line.text);
}

const std::deque<TableText::Line>& TableText::ahead() {
  constexpr size_t lines = 200, bytes = 1 << 20;
  fill(lines, bytes);
  return ahead_;
}

void TableText::skip() {
  if (!fill(1, 1)) return;
  bytes_ahead_ -= ahead_.front().text.size();
  ahead_.pop_front();
}

std::optional<Row> TableText::next(char separator) {
  while (rows_.empty() && fill(1, 1)) parse_line(separator);
  if (rows_.empty()) return std::nullopt;
  Row row = std::move(rows_.front());
  rows_.pop_front();
  return row;
}

// Parses one line at a time, so that every row knows its line. A quoted cell may span several lines.
void TableText::parse_line(char separator) {
  Line line = std::move(ahead_.front());
  bytes_ahead_ -= line.text.size();
  ahead_.pop_front();
  line_ = line.number, open_end_ = line.open_end;
  const auto on_cell = [](void* text, size_t size, void* self) {
    add_cell(text, size, &static_cast<TableText*>(self)->cells_);
  };
  const auto on_row = [](int, void* self) {
    auto& t = *static_cast<TableText*>(self);
    t.rows_.push_back({t.line_, std::exchange(t.cells_, {})});
  };
  csv_set_delim(&parser_, static_cast<unsigned char>(separator));
  line.text += '\n';
  if (csv_parse(&parser_, line.text.data(), line.text.size(), on_cell, on_row, this) != line.text.size())
    fail("line {}: misplaced quotation mark found, plain or quoted cells needed", line_);
  if (!fill(1, 1) && csv_fini(&parser_, on_cell, on_row, this) != 0)
    fail("line {}: the end found within a quoted cell, a closing quotation mark needed", line_);
}

}  // namespace tokid::io
