// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/table_start.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "io/formats/cells.hpp"
#include "io/formats/time_stamp.hpp"

namespace tokid::io {

namespace {

std::string line_range(Index first, Index last) {
  return first == last ? fmt::format("line {}", first) : fmt::format("lines {} to {}", first, last);
}

// Reads the comments, and returns the last one that is no note.
std::optional<TableText::Line> read_comments(TableText& text, Notes& notes) {
  std::optional<TableText::Line> last;
  while (!text.ahead().empty()) {
    const TableText::Line& line = text.ahead().front();
    const std::string_view content = stripped(line.text);
    if (!content.empty() && !content.starts_with('#')) break;
    if (line.text.starts_with('#')) {
      read_note(line.number, line.text.substr(1), notes);
      if (line.text.find('=') == std::string::npos) last = line;
    } else if (!content.empty()) {
      break;
    }
    text.skip();
  }
  return last;
}

Names wanted_titles(const ReadOptions& options) {
  Names wanted = options.inputs;
  wanted.insert(wanted.end(), options.outputs.begin(), options.outputs.end());
  if (!options.time.empty()) wanted.push_back(options.time);
  if (!options.experiment.empty()) wanted.push_back(options.experiment);
  return wanted;
}

bool are_named(const Cells& cells, const ReadOptions& options) {
  const Names wanted = wanted_titles(options);
  return !wanted.empty() &&
         std::all_of(wanted.begin(), wanted.end(), [&](const std::string& name) { return contains(cells, name); });
}

// What most cells of a column in the first rows are. Empty cells and words for missing samples do not count.
class ContentCount {
 public:
  void add(std::string_view cell) {
    if (is_missing(cell) || is_word_for_missing(cell)) return;
    const std::optional<Stamp> stamp = number_from(cell, '.') ? std::nullopt : stamp_from(cell);
    ++cells_;
    if (!stamp) return;
    ++(!stamp->has_date ? clocks_ : stamp->has_clock ? both_ : dates_);
  }
  Content result() const {
    if (const int stamps = both_ + dates_ + clocks_; 2 * stamps < cells_ || stamps == 0) return Content::other;
    if (both_ > 0) return Content::date_and_clock;
    return dates_ > 0 ? Content::date : clocks_ > 0 ? Content::clock : Content::other;
  }

 private:
  int cells_ = 0, both_ = 0, dates_ = 0, clocks_ = 0;
};

std::vector<Column> columns_of(const Cells& titles, const Cells& units, const std::deque<TableText::Line>& rows,
                               char separator) {
  std::vector<Column> columns(titles.size());
  for (size_t c = 0; c < titles.size(); ++c) {
    columns[c].title = titles[c];
    columns[c].label = label_from(titles[c]);
    if (c >= units.size() || !columns[c].label.unit.empty()) continue;
    const Label unit = label_from("x " + units[c]);  // without brackets
    columns[c].label.unit = unit.unit.empty() ? std::string(stripped(units[c])) : unit.unit;
  }
  for (Column& column : columns)
    if (column.label.unit == "-" || column.label.unit == "1") column.label.unit.clear();
  std::vector<ContentCount> content(columns.size());
  constexpr size_t most = 50;
  for (size_t i = 0; i < std::min(most, rows.size()); ++i) {
    const Cells cells = cells_of(rows[i].text, separator);
    for (size_t c = 0; c < std::min(cells.size(), columns.size()); ++c) content[c].add(stripped(cells[c]));
  }
  for (size_t c = 0; c < columns.size(); ++c) columns[c].content = content[c].result();
  return columns;
}

// Columns without a title at the end, whose cells are empty, come from separators at the ends of the lines.
void drop_empty_end(const std::deque<TableText::Line>& rows, char separator, Cells& titles) {
  if (titles.empty() || !titles.back().empty()) return;
  constexpr size_t most = 50;
  size_t used = 0;
  for (size_t i = 0; i < std::min(most, rows.size()); ++i) {
    const Cells cells = cells_of(rows[i].text, separator);
    for (size_t c = 0; c < cells.size(); ++c)
      if (!cells[c].empty()) used = std::max(used, c + 1);
  }
  while (titles.size() > used && titles.back().empty()) titles.pop_back();
}

}  // namespace

TableStart table_start(TableText& text, const ReadOptions& options) {
  TableStart start;
  const std::optional<TableText::Line> comment = read_comments(text, start.notes);
  if (text.ahead().empty()) fail("no header line found: a line with the names of the columns needed");
  Dialect& dialect = start.dialect = dialect_of(text.ahead(), {options.missing, wanted_titles(options)});
  const Index first = text.ahead().front().number;
  for (size_t i = 0; i < dialect.header; ++i) text.skip();
  Cells titles = cells_of(text.ahead().front().text, dialect.separator), units;
  if (!dialect.has_header && !are_named(titles, options)) {
    titles = comment ? cells_of(comment->text.substr(1), dialect.separator) : Cells{};
    if (titles.size() != dialect.columns)
      fail(
          "line {}: samples found, but no line above them names the columns; a line with the names of the columns needed",
          first);
    start.header_line = comment->number, start.last_line = first - 1;
  } else {
    const Index line = text.ahead().front().number;
    const std::optional<Row> header = text.next(dialect.separator);
    if (!header) fail("no header line found: a line with the names of the columns needed");
    titles = header->cells;
    start.header_line = line, start.last_line = header->line;
    if (line > first)
      start.remarks.push_back(fmt::format("{} {} skipped, because the names of the columns are in line {}",
                                          line_range(first, line - 1), line - 1 > first ? "were" : "was", line));
  }
  if (dialect.has_units_row)
    if (const std::optional<Row> row = text.next(dialect.separator)) {
      units = row->cells;
      start.last_line = row->line;
      start.remarks.push_back(fmt::format("line {} was read as the units of the columns", row->line));
    }
  drop_empty_end(text.ahead(), dialect.separator, titles);
  start.columns = columns_of(titles, units, text.ahead(), dialect.separator);
  return start;
}

}  // namespace tokid::io
