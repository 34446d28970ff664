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
  size_t columns = 0;        // the most frequent number of cells in the lines of samples
  std::vector<bool> values;  // columns whose cells there mostly are values
  double share = 0.0;        // of the cells there, those that are values
};

// Lines that probably are of samples: the second half, or the last lines of equal width if fewer are equally wide.
size_t samples_begin(const std::vector<Cells>& cells) {
  size_t begin = cells.size();
  while (begin > 0 && cells[begin - 1].size() == cells.back().size()) --begin;
  const size_t half = cells.size() / 2;
  return begin + 2 <= cells.size() ? std::max(half, begin) : half;
}

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

Candidate candidate(const std::deque<TableText::Line>& lines, char separator, const Names& missing) {
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
  const size_t half = samples_begin(c.cells);
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
      const bool is_filled = !cell.empty(), is = is_filled && (is_value(cell) || contains(missing, cell));
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

// The cells of the line with all these columns, whose names may have a unit; empty if there is none.
std::optional<size_t> line_with(const Candidate& c, const Names& columns) {
  const auto is_in = [](const Cells& cells, const std::string& name) {
    return std::any_of(cells.begin(), cells.end(), [&](const std::string& cell) {
      const std::string_view title = stripped(cell);
      return title == name || label_from(title).name == name || label_from(title).name == label_from(name).name;
    });
  };
  for (size_t i = 0; i < c.cells.size() && !columns.empty(); ++i)
    if (std::all_of(columns.begin(), columns.end(), [&](const std::string& name) { return is_in(c.cells[i], name); }))
      return i;
  return std::nullopt;
}

// Is this a line of names: as wide as the samples, with a text in each cell, which is no value in columns of values?
bool is_line_of_names(const Candidate& c, const Cells& cells) {
  if (width(c, cells) != c.columns || !is_filled(cells, c.columns)) return false;
  size_t texts = 0, of_values = 0;
  for (size_t column = 0; column < c.columns; ++column)
    if (c.values[column]) ++of_values, texts += !is_value(stripped(cells[column]));
  return texts > 0 && texts == of_values;
}

// The first row of samples. A preamble may be as wide as the samples and consist of numbers. The line of names then is
// below it, and is the only one.
size_t first_sample(const Candidate& c, const Names& columns) {
  if (const auto header = line_with(c, columns)) return *header + 1;
  const size_t first = first_row(c);
  if (first == c.cells.size() || (first > 0 && width(c, c.cells[first - 1]) == c.columns)) return first;
  std::optional<size_t> names;
  for (size_t i = first; i < c.cells.size(); ++i) {
    if (!is_line_of_names(c, c.cells[i])) continue;
    if (names) return first;
    names = i;
  }
  if (names && *names + 1 < c.cells.size()) return *names + 1;
  // A table whose channels have numbers for names: "time,1,2" below a title.
  const Cells& row = c.cells[first];
  const bool has_text =
      first > 0 && c.values.front() && !stripped(row.front()).empty() && !is_value(stripped(row.front()));
  return has_text && first + 1 < c.cells.size() ? first + 1 : first;
}

Dialect dialect(const Candidate& c, const Names& columns) {
  Dialect d;
  d.separator = c.separator, d.columns = c.columns;
  size_t first = first_sample(c, columns);
  if (first < c.cells.size() && first > 0 && first + 1 < c.cells.size() && line_with(c, columns) == first - 1 &&
      width(c, c.cells[first]) == c.columns && is_units_row(c.cells[first]))
    ++first;
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

Dialect dialect_of(const std::deque<TableText::Line>& lines, const Known& known) {
  Candidate best = candidate(lines, ',', known.missing);
  for (const char separator : {';', '\t'}) {
    const bool occurs = std::any_of(lines.begin(), lines.end(), [&](const TableText::Line& line) {
      return line.text.find(separator) != std::string::npos;
    });
    if (!occurs) continue;
    Candidate other = candidate(lines, separator, known.missing);
    const bool more = other.columns > 1 && (best.columns < 2 || other.share > best.share ||
                                            (other.share == best.share && other.columns > best.columns));
    if (more) best = std::move(other);
  }
  return dialect(best, known.columns);
}

}  // namespace tokid::io
