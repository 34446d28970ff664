// Reads .csv files as people have them: one ensemble from one table, or from many tables with an experiment each.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <unordered_map>

#include "base/words.hpp"
#include "io/formats/cells.hpp"
#include "io/formats/column_remarks.hpp"
#include "io/formats/columns.hpp"
#include "io/formats/dialect.hpp"
#include "io/formats/formats.hpp"
#include "io/formats/notes.hpp"
#include "io/formats/records.hpp"
#include "io/formats/table_text.hpp"
#include "io/formats/time_stamp.hpp"
#include "io/guard/descriptor.hpp"
#include "io/naming.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

namespace {

constexpr double missing = std::numeric_limits<double>::quiet_NaN();

// ---- the trigger ----

// "valve > 0.5": a column, a comparison, and a number or a text.
class Trigger {
 public:
  explicit Trigger(const std::string& text) : text_(text) {
    const size_t begin = text.find_first_of("<>=!");
    const size_t end = begin == std::string::npos ? begin : text.find_first_not_of("<>=!", begin);
    if (end == std::string::npos) fail_form();
    column = stripped(std::string_view(text).substr(0, begin));
    comparison_ = text.substr(begin, end - begin);
    value_ = stripped(std::string_view(text).substr(end));
    if (value_.size() > 1 && (value_.front() == '"' || value_.front() == '\'') && value_.back() == value_.front())
      value_ = value_.substr(1, value_.size() - 2);
    else
      number_ = number_from(value_, '.');
    const Names comparisons{">", ">=", "<", "<=", "==", "!=", "="};
    const bool of_text = comparison_ == "==" || comparison_ == "!=" || comparison_ == "=";
    if (column.empty() || value_.empty() || !contains(comparisons, comparison_) || (!number_ && !of_text)) fail_form();
  }

  bool of_number() const { return number_.has_value(); }
  bool holds(double value) const {
    if (comparison_ == ">") return value > *number_;
    if (comparison_ == ">=") return value >= *number_;
    if (comparison_ == "<") return value < *number_;
    if (comparison_ == "<=") return value <= *number_;
    return (value == *number_) != (comparison_ == "!=");
  }
  bool is_value(std::string_view cell) const { return cell == value_; }
  bool holds(std::string_view cell) const { return is_value(cell) != (comparison_ == "!="); }

  std::string column;

 private:
  [[noreturn]] void fail_form() const {
    throw std::invalid_argument(
        fmt::format("trigger: '{}' found, a column, one of > >= < <= == != and a number needed, as in 'valve > 0.5'; "
                    "with == and != a text is possible, too",
                    text_));
  }

  std::string text_, comparison_, value_;
  std::optional<double> number_;
};

}  // namespace

void check_options(const ReadOptions& options) {
  if (!options.trigger.empty()) Trigger trigger(options.trigger);
  const auto refuse = [](const char* name, const auto& found, const char* needed) {
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed", name, found, needed));
  };
  if (options.before < 0) refuse("before", options.before, "a number of steps from 0 on");
  if (options.before > 0 && options.trigger.empty())
    throw std::invalid_argument("before: no trigger found. Steps before the trigger can be kept only with a trigger");
  if (options.longest_gap && *options.longest_gap < 1)
    refuse("longest_gap", *options.longest_gap, "a number of steps from 1 on");
  if (options.dt && !(*options.dt > 0 && std::isfinite(*options.dt)))
    refuse("dt", *options.dt, "a positive sample time in seconds");
  if (options.dt && options.resample)
    throw std::invalid_argument(
        "dt: a sample time found together with resample, which states another one; leave one out");
  if (options.resample && !(*options.resample > 0 && std::isfinite(*options.resample)))
    refuse("resample", *options.resample, "a positive sample time in seconds");
}

namespace {

// ---- the header ----

std::string line_range(Index first, Index last) {
  return first == last ? fmt::format("line {}", first) : fmt::format("lines {} to {}", first, last);
}

struct Start {  // how the rows of a table begin
  Dialect dialect;
  Notes notes;
  std::vector<Column> columns;
  Index header_line = 0, last_line = 0;  // lines of the names of the columns, and of the end of the header
  Names remarks;
};

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
    columns[c].title = stripped(titles[c]);
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

Start start_of(TableText& text, const ReadOptions& options) {
  Start start;
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
      start.remarks.push_back(fmt::format("{} before the names of the columns in line {} {} skipped",
                                          line_range(first, line - 1), line, line - 1 > first ? "were" : "was"));
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

// ---- cells ----

void check_width(const Row& row, const Header& header) {
  const size_t found = row.cells.size(), needed = header.columns().size();
  if (found < needed)
    fail("line {}: {} cells found, {} needed; column '{}' has none", row.line, found, needed, header[found].title);
  const auto extra = std::find_if(row.cells.begin() + std::ptrdiff_t(needed), row.cells.end(),
                                  [](const std::string& cell) { return !cell.empty(); });
  if (extra != row.cells.end())
    fail("line {}: {} cells found, {} needed; '{}' after the last column '{}'", row.line, found, needed,
         words::quoted(*extra), header.columns().back().title);
}

// Words that were taken for missing samples without being stated.
struct Guess {
  Index cells = 0;
  size_t file = 0;    // number of the file of the first one
  Index line = 0;     // of the first one
  std::string first;  // where the first one stands
};
using Guesses = std::map<std::string, Guess>;

// Reads numbers. The first number with a decimal comma or a decimal point decides for the table.
class NumberReader {
 public:
  explicit NumberReader(const Names& missing_words) : words_(missing_words) {
    for (const std::string& word : words_)
      if (const auto number = number_from(word, '.')) numbers_.push_back(*number);
  }

  double number(std::string_view cell, Index line, const std::string& column) {
    if (is_missing(cell) || contains(words_, cell)) return missing;
    if (const auto value = value_of(cell, line, column)) {
      only_thousands_ = only_thousands_ && (cell.find(mark_) == std::string_view::npos || may_be_thousands(cell));
      const bool stated = std::find(numbers_.begin(), numbers_.end(), *value) != numbers_.end();
      return stated ? missing : *value;
    }
    if (const auto state = switch_state(cell)) {
      has_switches_ = true;
      return *state;
    }
    if (!stands_for_missing(cell, line, column)) fail_number(cell, line, column);
    return missing;
  }

  // A time or step number. No word and no number stands for a missing one.
  double time(std::string_view cell, Index line, const std::string& column) {
    const auto value = value_of(cell, line, column);
    return value ? *value : is_missing(cell) || is_word_for_missing(cell) ? missing : fail_number(cell, line, column);
  }

  // Does a text stand for a missing sample? Words that nobody stated are counted as guesses.
  bool stands_for_missing(std::string_view text, Index line, const std::string& column) {
    if (is_missing(text) || contains(words_, text)) return true;
    if (!is_word_for_missing(text)) return false;
    Guess& guess = guesses_[std::string(text)];
    if (guess.cells++ == 0) guess.line = line, guess.first = fmt::format("line {}, column '{}'", line, column);
    return true;
  }

  const Guesses& guesses() const { return guesses_; }
  // How the marks in numbers were read, if a program may have meant them otherwise. Must be called after the last
  // number. \throws IoError if commas in a table with commas between cells can as well group thousands
  std::optional<std::string> remark_on_marks(char separator) const {
    if (mark_ == '\0' || (mark_ == '.' && (separator == ',' || !only_thousands_))) return std::nullopt;
    if (mark_ == ',' && separator == ',' && only_thousands_)
      fail(
          "line {}: '{}' found; its comma and those of all numbers may group thousands or be decimal commas; numbers "
          "without marks of thousands and with a decimal point needed",
          mark_line_, words::quoted(mark_cell_));
    const char* name = mark_ == ',' ? "comma" : "point";
    return only_thousands_
               ? fmt::format("{0}s in numbers were read as decimal {0}s: 1{1}000 is 1; write thousands without {0}s",
                             name, mark_)
               : fmt::format("{0}s in numbers were read as decimal {0}s: 1{1}5 is 1.5", name, mark_);
  }
  std::optional<std::string> remark_on_switches() const {
    if (!has_switches_) return std::nullopt;
    return "cells with on and true were read as 1, those with off and false as 0";
  }
  // A number of a decimal comma as one of a decimal point; for the precision of times.
  std::string with_point(std::string text) const {
    if (mark_ == ',') std::replace(text.begin(), text.end(), ',', '.');
    return text;
  }

 private:
  std::optional<double> value_of(std::string_view cell, Index line, const std::string& column) {
    if (mark_ != ',') {
      const auto value = number_from(cell, '.');
      if (value && mark_ == '\0' && cell.find('.') != std::string_view::npos) decide('.', line, cell);
      if (value || mark_ == '.') return value;
    }
    const auto value = number_from(cell, ',');
    if (value && mark_ == '\0' && cell.find(',') != std::string_view::npos) decide(',', line, cell);
    if (!value && number_from(cell, '.'))
      fail("line {}, column '{}': '{}' found, but '{}' in line {}; the same decimal mark in the whole table needed",
           line, column, words::quoted(cell), words::quoted(mark_cell_), mark_line_);
    return value;
  }

  void decide(char mark, Index line, std::string_view cell) { mark_ = mark, mark_line_ = line, mark_cell_ = cell; }

  [[noreturn]] double fail_number(std::string_view cell, Index line, const std::string& column) const {
    const std::string at = fmt::format("line {}, column '{}': '{}' found", line, column, words::quoted(cell));
    if (mark_ == '.' && number_from(cell, ','))
      fail("{}, but '{}' in line {}; the same decimal mark in the whole table needed", at, words::quoted(mark_cell_),
           mark_line_);
    if (number_from(cell, '.') || number_from(cell, ',') || cell.find_first_of("0123456789") != std::string_view::npos)
      fail("{}, a number needed", at);
    fail("{}, a number needed; --missing '{}' reads it as a missing sample", at, words::quoted(cell));
  }

  Names words_;
  std::vector<double> numbers_;
  char mark_ = '\0';  // not decided
  Index mark_line_ = 0;
  std::string mark_cell_;
  bool only_thousands_ = true;  // of the numbers with a mark: each may be a whole number with a mark of thousands
  bool has_switches_ = false;
  Guesses guesses_;
};

// For errors in the values of a column of step numbers that is not named "k": a text that reminds the user of this
// interpretation.
std::string doubt(const Header& header, const Chosen& chosen) {
  if (chosen.time || !chosen.step || header[*chosen.step].title == "k") return "";
  return fmt::format("; the column '{}' was read as step numbers: rename it if it contains something else",
                     header[*chosen.step].title);
}

class RecordReader {
 public:
  RecordReader(const Header& header, const Chosen& chosen, const ReadOptions& options)
      : header_(header), chosen_(chosen), numbers_(options.missing) {
    const auto& column = chosen.time ? chosen.time : chosen.step;
    records_.source = chosen.time ? StepSource::times : chosen.step ? StepSource::numbers : StepSource::order;
    records_.doubt = doubt(header, chosen);
    if (column) records_.rows.name = header[*column].title;
    records_.rows.unit = chosen.unit;
    if (options.trigger.empty()) return;
    trigger_.emplace(options.trigger);
    event_column_ = header.need(trigger_->column);
  }

  void add(const Row& row) {
    check_width(row, header_);
    if (is_blank(row)) return;
    const Index n = experiment_of(row);
    records_.rows.experiment.push_back(n);
    records_.rows.line.push_back(row.line);
    add_time(row, n);
    for (const auto* columns : {&chosen_.inputs, &chosen_.outputs})
      for (const size_t c : *columns)
        records_.samples.push_back(numbers_.number(row.cells[c], row.line, header_[c].title));
    if (trigger_) records_.event.push_back(event_of(row));
  }

  Records take(DateOrder order, char separator) {
    for (auto&& remark : {numbers_.remark_on_marks(separator), numbers_.remark_on_switches()})
      if (remark) records_.remarks.push_back(*remark);
    if (chosen_.stamped) {
      StampTimes times = times_of(stamps_, records_.rows.experiment, records_.rows.line, stamp_texts_, order);
      for (const double time : times.seconds)
        records_.rows.precision.add(fmt::format("{:.{}f}", time, times.decimals), time);
      records_.rows.time = std::move(times.seconds);
      if (times.remark) records_.remarks.push_back(*std::move(times.remark));
      if (has_short_clock_)
        records_.remarks.push_back(fmt::format(
            "column '{0}': times such as 05:10 were read as hours and minutes; for minutes and seconds, name "
            "it '{0} [mm:ss]'",
            header_[*chosen_.time].title));
    }
    return std::move(records_);
  }

  const Guesses& guesses() const { return numbers_.guesses(); }

 private:
  // A missing sample fulfils no condition, and does not fail it either.
  Event event_of(const Row& row) {
    const std::string &cell = row.cells[event_column_], &title = header_[event_column_].title;
    const auto known = [](bool holds) { return holds ? Event::holds : Event::fails; };
    if (trigger_->of_number()) {
      const double value = numbers_.number(cell, row.line, title);
      return std::isnan(value) ? Event::unknown : known(trigger_->holds(value));
    }
    // The word of the condition is meant, even if it usually stands for a missing sample.
    if (!trigger_->is_value(cell) && numbers_.stands_for_missing(cell, row.line, title)) return Event::unknown;
    return known(trigger_->holds(std::string_view(cell)));
  }

  // Spreadsheet programs write rows without any content below a table. Without times, such a row is a step.
  bool is_blank(const Row& row) const {
    return (chosen_.time || chosen_.step) &&
           std::all_of(row.cells.begin(), row.cells.end(), [](const std::string& cell) { return cell.empty(); });
  }

  Index experiment_of(const Row& row) {
    const auto column = chosen_.experiment;
    const std::string id = column ? row.cells[*column] : "";
    if (column && id.empty()) fail("line {}, column 'experiment': nothing found, a number or name needed", row.line);
    const auto [at, is_new] = experiment_numbers_.try_emplace(id, Index(experiment_numbers_.size()));
    if (is_new) {
      records_.rows.experiments.push_back(id);
      rows_.push_back(0);
    }
    return at->second;
  }

  void add_time(const Row& row, Index n) {
    const auto column = chosen_.time ? chosen_.time : chosen_.step;
    if (!column) return records_.rows.time.push_back(double(rows_[size_t(n)]++));
    const std::string& cell = row.cells[*column];
    if (chosen_.stamped) return add_stamp(row, cell);
    const double time = numbers_.time(cell, row.line, header_[*column].title);
    const bool whole = chosen_.time || time == std::floor(time);
    if (!std::isfinite(time) || !whole)
      fail("line {}, column '{}': '{}' found, a {} needed{}", row.line, header_[*column].title, words::quoted(cell),
           chosen_.time ? "finite time" : "whole number", records_.doubt);
    constexpr double longest = 1e11;  // [s], more than 3000 years since the origin of the times
    if (chosen_.time && records_.rows.time.empty() && std::abs(chosen_.unit.in_seconds(time)) > longest)
      fail(
          "line {}, column '{}': '{}' found, which is more than 3000 years in {}; the unit of the times in the name of "
          "the column needed, as in 'timestamp [ms]'",
          row.line, header_[*column].title, words::quoted(cell), chosen_.unit.name);
    records_.rows.time.push_back(time);
    records_.rows.precision.add(numbers_.with_point(cell), time);
  }

  void add_stamp(const Row& row, const std::string& cell) {
    std::optional<Stamp> stamp = stamp_from(cell);
    std::string text = cell;
    if (chosen_.date) {
      stamp = joined(stamp_from(row.cells[*chosen_.date]), stamp);
      text = fmt::format("{} {}", row.cells[*chosen_.date], cell);
    }
    if (!stamp)
      fail("line {}, column '{}': '{}' found, a time stamp{} needed", row.line, header_[*chosen_.time].title,
           words::quoted(text),
           stamp_texts_.empty() ? std::string() : fmt::format(" like '{}'", words::quoted(stamp_texts_.front())));
    if (stamp->has_clock && !stamp->has_date && !stamp->has_seconds) {
      if (chosen_.of_minutes)
        stamp->nanoseconds /= 60;
      else if (header_[*chosen_.time].label.unit.empty())
        has_short_clock_ = true;
    }
    stamps_.push_back(*stamp);
    stamp_texts_.push_back(std::move(text));
  }

  const Header& header_;
  const Chosen& chosen_;
  NumberReader numbers_;
  std::optional<Trigger> trigger_;
  size_t event_column_ = 0;
  Records records_;
  std::unordered_map<std::string, Index> experiment_numbers_;
  std::vector<Index> rows_;  // number of rows of each experiment so far
  std::vector<Stamp> stamps_;
  Names stamp_texts_;
  bool has_short_clock_ = false;  // a time such as "05:10" was read as hours and minutes, which no unit states
};

// ---- one table ----

struct Table {
  Records records;
  Channels channels;
  Names input_titles, output_titles;  // of the columns
  std::optional<double> dt;
  std::optional<InitialState> initial_state;
  std::vector<Index> length;
  bool names_experiments = false, stamped = false;
  Guesses guesses;
  std::optional<std::string> cut;  // a remark on the end of the file
  Names remarks;
};

// A file without a final line break may be complete. But a file that was cut within its last number looks the same.
std::string remark_on_end(const Row& row, const Header& header) {
  return fmt::format(
      "line {}, the last one, ends without a line break: its {} = '{}' may have been cut; check whether "
      "the file is complete, and end it with a line break",
      row.line, header.columns().back().title, words::quoted(row.cells.back()));
}

std::string remark_on_change(const std::filesystem::path& path) {
  return fmt::format(
      "'{}' does not match its line '# checksum = …', so it was changed after tokid wrote it: remove that line if "
      "you changed the "
      "file by hand; otherwise the file is damaged",
      path.string());
}

// The first one of several tables, which determines their channels.
struct First {
  std::string file;
  Names inputs, outputs;  // titles of the columns
};

// The columns of the first table in another one. If the caller names no channels, this one must not have more of them.
Chosen same_columns(const Header& header, const First& first, Wanted wanted) {
  const bool named = !wanted.inputs.empty() || !wanted.outputs.empty() || !wanted.model.input_names.empty();
  const Chosen own = named ? Chosen{} : chosen_columns(header, wanted);
  wanted.inputs = first.inputs, wanted.outputs = first.outputs;
  Chosen chosen = chosen_columns(header, wanted);
  if (first.outputs.empty()) chosen.outputs.clear();
  const auto check_no_more = [&](const std::vector<size_t>& found, const std::vector<size_t>& needed) {
    for (const size_t c : found)
      if (std::find(needed.begin(), needed.end(), c) == needed.end())
        fail(
            "column '{}' found, which '{}' does not have; the same channels in all files needed, or their names: "
            "--inputs 'A,B' --outputs 'C,D'",
            header[c].title, first.file);
  };
  check_no_more(own.inputs, chosen.inputs);
  check_no_more(own.outputs, chosen.outputs);
  return chosen;
}

Table read_table(const std::filesystem::path& path, const ReadOptions& options, const First* first = nullptr) {
  TableText text(path);
  Start start = start_of(text, options);
  const Notes& notes = start.notes;
  const Header header(std::move(start.columns), start.header_line);
  const Wanted wanted{options.inputs, options.outputs, notes.channels, options.wanted, options.outputs_required};
  const Chosen chosen = first ? same_columns(header, *first, wanted) : chosen_columns(header, wanted);
  RecordReader reader(header, chosen, options);
  Table table;
  // The parser leaves out blank lines. In a table of one column, they are empty cells.
  const bool has_blank_cells = header.columns().size() == 1 && !chosen.time && !chosen.step;
  Index blank = 0, next_line = start.last_line + 1;
  while (const auto row = text.next(start.dialect.separator)) {
    checkpoint();
    for (; has_blank_cells && next_line < row->line; ++next_line, ++blank) reader.add({next_line, {""}});
    next_line = row->line + 1;
    reader.add(*row);
    if (text.has_open_end(*row)) table.cut = remark_on_end(*row, header);
  }
  table.records = reader.take(options.dates, start.dialect.separator);
  if (table.records.rows.time.empty()) fail("no rows after the header found, samples needed");
  table.channels = channels_of(header, chosen, wanted);
  table.input_titles = titles_of(header, chosen.inputs), table.output_titles = titles_of(header, chosen.outputs);
  table.records.inputs = table.input_titles, table.records.outputs = table.output_titles;
  table.dt = notes.dt, table.initial_state = notes.initial_state, table.length = notes.length;
  table.names_experiments = chosen.experiment.has_value(), table.stamped = chosen.stamped;
  table.guesses = reader.guesses();

  table.remarks = std::move(start.remarks);
  const auto remark = [&table](std::optional<std::string> one) {
    if (one) table.remarks.push_back(*std::move(one));
  };
  if (const auto line = text.latin_line())
    remark(fmt::format("line {} is not UTF-8; such lines were read as Latin-1 (Windows-1252)", *line));
  std::vector<size_t> also_read;
  if (!options.trigger.empty()) also_read.push_back(header.need(Trigger(options.trigger).column));
  remark(remark_on_unused_columns(header, chosen, also_read));
  if (blank > 0)
    remark(fmt::format("{} of the only column {} read as missing samples", words::plural(blank, "blank line"),
                       blank == 1 ? "was" : "were"));
  if (table.records.source == StepSource::order) remark(std::string(rows_as_steps));
  if (notes.has_checksum || text.is_changed()) remark(remark_on_change(path));
  for (std::string& one : table.records.remarks) remark(std::move(one));
  table.records.remarks.clear();
  return table;
}

// ---- many tables ----

// The names of experiments: those of the files, with their folders where files have equal names.
Names labels_of(const std::vector<std::filesystem::path>& paths) {
  Names labels;
  for (const auto& path : paths) labels.push_back(path.stem().string());
  std::map<std::string, int> count;
  for (const std::string& label : labels) ++count[label];
  for (size_t i = 0; i < paths.size(); ++i)
    if (count[labels[i]] > 1) labels[i] = (paths[i].parent_path() / paths[i].stem()).string();
  return labels;
}

void name_experiments(const std::filesystem::path& path, const std::string& label, Table& table) {
  TimeColumn& rows = table.records.rows;
  for (std::string& name : rows.experiments)
    name = rows.experiments.size() > 1 ? fmt::format("{}/{}", label, name) : label;
  rows.files.assign(rows.experiments.size(), path.filename().string());
}

// Facts on which all tables must agree.
void check_same(const std::string& first_file, const Table& first, const Table& table) {
  const auto check_units = [&](const Names& titles, const Names& needed, const Names& found) {
    for (size_t i = 0; i < titles.size(); ++i) {
      const std::string a = i < needed.size() ? needed[i] : "", b = i < found.size() ? found[i] : "";
      if (a != b) fail("column '{}': unit '{}' found, but '{}' in '{}'; one unit needed", titles[i], b, a, first_file);
    }
  };
  check_units(first.input_titles, first.channels.input_units, table.channels.input_units);
  check_units(first.output_titles, first.channels.output_units, table.channels.output_units);
  const auto steps = [](const Table& t) {
    return t.records.source == StepSource::times     ? fmt::format("column '{}' of times", t.records.rows.name)
           : t.records.source == StepSource::numbers ? fmt::format("column '{}' of step numbers", t.records.rows.name)
                                                     : std::string("no column of times or step numbers");
  };
  if (table.records.source != first.records.source)
    fail("{} found, but {} in '{}'; the same kind of steps in all files needed", steps(table), steps(first),
         first_file);
  if (table.dt && first.dt && *table.dt != *first.dt)
    fail("dt: {} found, but {} in '{}'; one sample time needed", *table.dt, *first.dt, first_file);
  if (table.initial_state && first.initial_state && *table.initial_state != *first.initial_state)
    fail("initial_state: {} found, but {} in '{}'; one initial state needed", to_string(*table.initial_state),
         to_string(*first.initial_state), first_file);
}

// Remarks of several files, each text once.
class Remarks {
 public:
  void add(const std::string& file, const Names& texts) {
    ++files_;
    for (const std::string& text : texts) {
      const auto [at, is_new] = places_.try_emplace(text, order_.size());
      if (is_new) order_.push_back({text, {}});
      order_[at->second].second.push_back(file);
    }
  }

  Names take() const {
    Names result;
    for (const auto& [text, files] : order_)
      result.push_back(files.size() == files_ ? fmt::format("in all files, {}", text)
                       : files.size() == 1
                           ? fmt::format("'{}': {}", files.front(), text)
                           : fmt::format("'{}' and {} more: {}", files.front(), files.size() - 1, text));
    return result;
  }

 private:
  size_t files_ = 0;
  std::map<std::string, size_t> places_;
  std::vector<std::pair<std::string, Names>> order_;
};

std::string remark_on_guesses(const Guesses& guesses) {
  Index cells = 0;
  Names words;
  for (const auto& [word, guess] : guesses) {
    cells += guess.cells;
    words.push_back(word);
  }
  const auto first = std::min_element(guesses.begin(), guesses.end(), [](const auto& a, const auto& b) {
    return std::pair(a.second.file, a.second.line) < std::pair(b.second.file, b.second.line);
  });
  return fmt::format("{} with {} {}; the first one is at {}", words::plural(cells, "cell"), quoted(words),
                     cells == 1 ? "was read as a missing sample" : "were read as missing samples", first->second.first);
}

void add_guesses(const Guesses& more, size_t number, const std::string& file, Guesses& to) {
  for (const auto& [word, guess] : more) {
    Guess& sum = to[word];
    if (sum.cells == 0) sum = {0, number, guess.line, fmt::format("{}, {}", file, guess.first)};
    sum.cells += guess.cells;
  }
}

// One remark on all files without a final line break.
std::string remark_on_ends(const std::vector<std::pair<std::string, std::string>>& cut) {
  const std::string first = fmt::format("'{}': {}", cut.front().first, cut.front().second);
  if (cut.size() == 1) return first;
  return fmt::format("{}; {} more {} without a line break, too", first, cut.size() - 1,
                     cut.size() == 2 ? "file ends" : "files end");
}

// The lengths that the comments of the tables state, for those that state any.
void apply_noted_lengths(const std::vector<Index>& noted, Ensemble& e) {
  std::vector<Index> length = e.length.empty() ? std::vector<Index>(size_t(e.experiments()), e.steps()) : e.length;
  for (size_t n = 0; n < length.size(); ++n)
    if (noted[n] >= 0) length[n] = std::min(noted[n], e.steps());
  set_length(e, std::move(length));
}

void check_length(const Table& table) {
  const size_t experiments = table.records.rows.experiments.size();
  if (!table.length.empty() && table.length.size() != experiments)
    fail("length: {} entries found for {} experiments, one entry for each experiment needed", table.length.size(),
         experiments);
}

std::optional<Index> longest_gap(const ReadOptions& options) {
  constexpr Index usual = 3;
  if (options.longest_gap) return Index(*options.longest_gap);
  return options.resample_method == ResampleMethod::previous ? std::nullopt : std::optional(usual);
}

// Aligns, resamples and assembles the rows.
Ensemble ensemble_of(Table table, const ReadOptions& options, bool many) {
  const bool aligned = !options.trigger.empty();
  Records& records = table.records;
  if (aligned)
    align(options.trigger, records);
  else if (many || table.stamped)
    begin_together(records);
  if (options.resample) resample({*options.resample, options.resample_method, longest_gap(options)}, aligned, records);
  Assembly assembly;
  assembly.dt = options.resample ? options.resample : options.dt ? options.dt : table.dt;
  assembly.moved = options.dt.has_value();
  if (aligned) assembly.before = Index(options.before);
  assembly.own_lengths = many || aligned || options.resample;
  Ensemble e = assembled(records, assembly);
  e.names = std::move(table.channels);
  if (table.names_experiments) set_experiment_names(e, records.rows.experiments);
  if (!aligned) e.initial_state = table.initial_state;
  return e;
}

}  // namespace

Ensemble read_csv(const std::filesystem::path& path, const ReadOptions& options) {
  Table table = read_table(path, options);
  Names remarks = table.remarks;
  if (table.cut) remarks.push_back(*table.cut);
  if (!table.guesses.empty()) remarks.push_back(remark_on_guesses(table.guesses));
  const std::vector<Index> length = table.length;
  const bool changed = !options.trigger.empty() || options.resample.has_value();
  if (!changed) check_length(table);
  Ensemble e = ensemble_of(std::move(table), options, false);
  if (!changed && !length.empty()) {
    e.length = length;
    for (size_t n = 0; n < length.size(); ++n)
      for (Index k = std::max(length[n], Index{0}); k < e.steps(); ++k) {
        e.input(k).row(Index(n)).setConstant(missing);
        e.output(k).row(Index(n)).setConstant(missing);
      }
  }
  e.check(options.outputs_required);
  e.remarks.insert(e.remarks.begin(), remarks.begin(), remarks.end());
  return e;
}

Ensemble read_csv(const std::vector<std::filesystem::path>& paths, const ReadOptions& options) {
  const Names labels = labels_of(paths);
  Table all;
  First first;
  Remarks remarks;
  Guesses guesses;
  std::vector<Index> noted;
  std::vector<std::pair<std::string, std::string>> cut;  // names of files, and remarks on their ends
  for (size_t i = 0; i < paths.size(); ++i) {
    const std::string file = paths[i].filename().string();
    naming(paths[i], [&] {
      const Unchanged unchanged(paths[i]);
      Table table = read_table(paths[i], options, i > 0 ? &first : nullptr);
      unchanged.check();
      check_length(table);
      if (i > 0) check_same(first.file, all, table);
      if (table.stamped && options.trigger.empty())
        table.remarks.emplace_back(
            "time stamps count from the first row of the file; --trigger aligns them by an event");
      name_experiments(paths[i], labels[i], table);
      remarks.add(file, table.remarks);
      if (table.cut) cut.emplace_back(file, *table.cut);
      add_guesses(table.guesses, i, file, guesses);
      std::vector<Index> length = table.length;
      length.resize(table.records.rows.experiments.size(), -1);
      noted.insert(noted.end(), length.begin(), length.end());
      if (i > 0) {
        append(table.records, all.records);
        if (!all.dt) all.dt = table.dt;
        if (!all.initial_state) all.initial_state = table.initial_state;
      } else {
        first = {file, table.input_titles, table.output_titles};
        all = std::move(table);
      }
      return 0;
    });
  }
  all.names_experiments = true;
  const bool changed = !options.trigger.empty() || options.resample.has_value();
  Ensemble e = ensemble_of(std::move(all), options, true);
  if (!changed && std::any_of(noted.begin(), noted.end(), [](Index length) { return length >= 0; }))
    apply_noted_lengths(noted, e);
  e.check(options.outputs_required);
  Names texts = remarks.take();
  if (!cut.empty()) texts.push_back(remark_on_ends(cut));
  if (!guesses.empty()) texts.push_back(remark_on_guesses(guesses));
  e.remarks.insert(e.remarks.begin(), texts.begin(), texts.end());
  return e;
}

}  // namespace tokid::io
