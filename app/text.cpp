// SPDX-License-Identifier: BSD-3-Clause
#include "text.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "tokid/printable.hpp"

namespace tokid::app {

namespace {

constexpr size_t label_width = 15, text_columns = line_columns - label_width;
constexpr size_t longest_cell = 40;  // in the first column of a table

// Do the words before and after this space belong to one number?
bool glued(std::string_view text, size_t space) {
  const std::string_view after = text.substr(space + 1), before = text.substr(0, space);
  return after.starts_with('%') || after.starts_with("= ") || after.starts_with("± ") || before.ends_with(" =") ||
         before.ends_with(" ±");
}

// The first `count` code points.
std::string_view first(std::string_view text, size_t count) {
  size_t end = 0;
  while (end < text.size() && width(text.substr(0, end + 1)) <= count) ++end;
  return text.substr(0, end);
}

// Names of channels may be long. Their ends often differ, so that the middle is left out.
std::string shortened(const std::string& cell) {
  const size_t all = width(cell);
  if (all <= longest_cell) return cell;
  const size_t kept = longest_cell / 2;
  return fmt::format("{}…{}", first(cell, kept), cell.substr(first(cell, all - kept + 1).size()));
}

}  // namespace

size_t width(std::string_view text) {
  return static_cast<size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

std::string wrapped(std::string_view text, size_t columns, std::string_view separator) {
  constexpr size_t none = std::string_view::npos;
  std::string lines;
  size_t begin = 0, last = none;  // of the present line; its last space that fits
  for (size_t at = text.find(' ');; at = text.find(' ', at + 1)) {
    if (at != none && glued(text, at)) continue;
    const size_t end = std::min(at, text.size());
    if (last != none && width(text.substr(begin, end - begin)) > columns) {
      lines += fmt::format("{}{}", text.substr(begin, last - begin), separator);
      begin = last + 1;
    }
    last = end;
    if (at == none) break;
  }
  return lines.append(text.substr(begin));
}

void Page::row(std::string_view label, std::string_view text) {
  const std::string separator = "\n" + std::string(label_width, ' ');
  std::string lines = fmt::format("{:<{}}{}", label, label_width, wrapped(printable(text), text_columns, separator));
  lines.erase(lines.find_last_not_of(' ') + 1);
  text_ += lines + '\n';
}

void Page::command(std::string_view label, std::string_view purpose, std::string_view command) {
  const std::string line = fmt::format("{}: {}", purpose, command);
  if (width(line) <= text_columns) return row(label, line);
  row(label, fmt::format("{}:", purpose));
  const std::string separator = " \\\n" + std::string(label_width + 2, ' ');
  text_ += std::string(label_width, ' ') + wrapped(printable(command), text_columns - 4, separator) + '\n';
}

void Page::table(std::string_view label, const std::vector<std::vector<std::string>>& rows) {
  constexpr size_t gap = 3;
  std::vector<std::string> names;
  std::vector<size_t> widths;
  for (const auto& row : rows) {
    names.push_back(shortened(row.front()));
    widths.resize(std::max(widths.size(), row.size()));
    for (size_t c = 1; c < row.size(); ++c) widths[c] = std::max(widths[c], width(row[c]));
    widths[0] = std::max(widths[0], width(names.back()));
  }
  for (size_t begin = 1; begin < std::max<size_t>(2, widths.size());) {
    size_t end = begin, columns = widths[0];
    while (end < widths.size() && (end == begin || columns + gap + widths[end] <= text_columns))
      columns += gap + widths[end++];
    for (size_t r = 0; r < rows.size(); ++r) {
      std::string line = fmt::format("{:<{}}{}", r == 0 && begin == 1 ? label : "", label_width, names[r]);
      line.append(widths[0] - width(names[r]), ' ');
      for (size_t c = begin; c < std::min(end, rows[r].size()); ++c)
        line.append(gap + widths[c] - width(rows[r][c]), ' ').append(rows[r][c]);
      line.erase(line.find_last_not_of(' ') + 1);
      text_ += line + '\n';
    }
    begin = std::max(end, begin + 1);
  }
}

}  // namespace tokid::app
