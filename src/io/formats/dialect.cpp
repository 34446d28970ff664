// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/dialect.hpp"

#include <algorithm>
#include <map>

#include "io/formats/cells.hpp"

namespace tokid::io {

namespace {

struct Candidate {
  char separator = ',';
  std::vector<size_t> at;    // positions of the lines that are not blank
  std::vector<Cells> cells;  // of these lines
  size_t columns = 0;        // the most frequent number of cells in the second half of the lines
  std::vector<bool> values;  // columns whose cells in the second half mostly are values
  double share = 0.0;        // of the cells in the second half, those that are values
};

// The text from line i on until all quotation marks are closed, because a quoted cell may span several lines. Sets i to
// the last of these lines. A mark that is not closed soon is misplaced.
std::string whole_row(const std::deque<TableText::Line>& lines, size_t& i) {
  constexpr size_t most = 20;
  const auto marks = [](const std::string& text) { return std::count(text.begin(), text.end(), '"'); };
  std::string text = lines[i].text;
  for (size_t end = i + 1; marks(text) % 2 != 0 && end < std::min(i + most, lines.size()); ++end) {
    text += '\n' + lines[end].text;
    if (marks(text) % 2 == 0) i = end;
  }
  return marks(text) % 2 == 0 ? text : lines[i].text;
}

Candidate candidate(const std::deque<TableText::Line>& lines, char separator) {
  Candidate c;
  c.separator = separator;
  for (size_t i = 0; i < lines.size(); ++i) {
    const size_t begin = i;
    Cells cells = cells_of(whole_row(lines, i), separator);
    const bool blank = std::all_of(cells.begin(), cells.end(), [](const std::string& cell) { return cell.empty(); });
    if (blank && cells.size() < 2) continue;
    c.at.push_back(begin);
    c.cells.push_back(std::move(cells));
  }
  const size_t half = c.cells.size() / 2;
  std::map<size_t, size_t> count;
  for (size_t i = half; i < c.cells.size(); ++i) ++count[c.cells[i].size()];
  size_t most = 0;
  for (const auto& [columns, lines_of] : count)
    if (lines_of >= most) most = lines_of, c.columns = columns;
  std::vector<size_t> found(c.columns), filled(c.columns);
  size_t all = 0;
  double sum = 0;
  for (size_t i = half; i < c.cells.size(); ++i) {
    if (c.cells[i].size() != c.columns) continue;
    for (size_t column = 0; column < c.columns; ++column) {
      const std::string_view cell = stripped(c.cells[i][column]);
      const bool is_filled = !cell.empty(), is = is_filled && is_value(cell);
      filled[column] += is_filled, found[column] += is, all += is_filled, sum += is;
    }
  }
  c.share = all > 0 ? sum / double(all) : 0.0;
  while (c.columns > 1 && filled[c.columns - 1] == 0) --c.columns;  // from separators at the ends of lines
  for (size_t column = 0; column < c.columns; ++column) c.values.push_back(2 * found[column] > filled[column]);
  return c;
}

// The number of cells, but for empty ones after the last column.
size_t width(const Candidate& c, const Cells& cells) {
  size_t count = cells.size();
  while (count > c.columns && stripped(cells[count - 1]).empty()) --count;
  return count;
}

// Are most cells of the columns of values in this line values? Empty cells and dashes, which also stand for "no unit",
// do not count.
bool is_data(const Candidate& c, const Cells& cells) {
  size_t found = 0, filled = 0;
  for (size_t column = 0; column < std::min(c.columns, cells.size()); ++column) {
    const std::string_view cell = stripped(cells[column]);
    if (!c.values[column] || cell.empty() || cell == "-") continue;
    ++filled, found += is_value(cell);
  }
  return 2 * found > filled;
}

// Position of the first row of samples; the number of lines if there is none.
size_t first_row(const Candidate& c) {
  std::optional<size_t> first;
  for (size_t i = 0; i < c.cells.size(); ++i) {
    if (!is_data(c, c.cells[i])) continue;
    if (!first) first = i;
    // A line of the preamble may contain numbers, but then the next line usually does not.
    if (width(c, c.cells[i]) == c.columns || i + 1 == c.cells.size() || is_data(c, c.cells[i + 1])) return i;
  }
  return first.value_or(c.cells.size());
}

bool is_filled(const Cells& cells, size_t columns) {
  return cells.size() >= columns && std::all_of(cells.begin(), cells.begin() + std::ptrdiff_t(columns),
                                                [](const std::string& cell) { return !stripped(cell).empty(); });
}

// At least half of the cells that are not empty are units, and none is long.
bool is_units_row(const Cells& cells) {
  constexpr size_t longest = 12;
  size_t filled = 0, units = 0;
  for (const std::string& cell : cells) {
    if (stripped(cell).empty()) continue;
    if (cell.size() > longest) return false;
    ++filled, units += is_unit(cell);
  }
  return filled > 0 && 2 * units >= filled;
}

bool are_names(const Cells& cells) {
  return std::none_of(cells.begin(), cells.end(), [](const std::string& cell) { return number_from(cell, '.'); });
}

Dialect dialect(const Candidate& c) {
  Dialect d;
  d.separator = c.separator, d.columns = c.columns;
  const size_t first = first_row(c);
  if (first == c.cells.size()) {
    d.header = c.at.empty() ? 0 : c.at.front();
    return d;
  }
  if (first == 0) {
    d.header = c.at.front();
    d.has_header = !std::all_of(c.cells.front().begin(), c.cells.front().end(),
                                [](const std::string& cell) { return is_value(stripped(cell)); });
    return d;
  }
  const Cells& above = c.cells[first - 1];
  d.has_units_row = first > 1 && width(c, above) == c.columns && is_units_row(above) &&
                    is_filled(c.cells[first - 2], c.columns) && are_names(c.cells[first - 2]);
  d.header = c.at[first - (d.has_units_row ? 2 : 1)];
  return d;
}

}  // namespace

Dialect dialect_of(const std::deque<TableText::Line>& lines) {
  Candidate best = candidate(lines, ',');
  for (const char separator : {';', '\t'}) {
    const bool occurs = std::any_of(lines.begin(), lines.end(), [&](const TableText::Line& line) {
      return line.text.find(separator) != std::string::npos;
    });
    if (!occurs) continue;
    Candidate other = candidate(lines, separator);
    const bool more = other.columns > 1 && (best.columns < 2 || other.share > best.share ||
                                            (other.share == best.share && other.columns > best.columns));
    if (more) best = std::move(other);
  }
  return dialect(best);
}

}  // namespace tokid::io
