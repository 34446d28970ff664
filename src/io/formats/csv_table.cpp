// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/csv_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/words.hpp"
#include "io/formats/cells.hpp"
#include "io/formats/column_remarks.hpp"
#include "io/formats/columns.hpp"
#include "io/formats/table_start.hpp"
#include "io/formats/time_stamp.hpp"
#include "io/formats/trigger.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

namespace {

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

// For errors in the values of a column of step numbers that is not named "k": a text that reminds the user of this
// interpretation.
std::string doubt(const Header& header, const Chosen& chosen) {
  if (chosen.time || !chosen.step || header[*chosen.step].title == "k") return "";
  return fmt::format("; the column '{}' was read as step numbers: rename it if it contains something else",
                     header[*chosen.step].title);
}

// Finds a column that is not read and may name the experiments.
class ExperimentSearch {
 public:
  ExperimentSearch(const Header& header, const std::vector<size_t>& columns) {
    for (const size_t c : columns)
      candidates_.push_back({c, header[c].title, may_name_experiments(header[c].label.name)});
  }

  // `restarts`: the time of the row is not after that of the row before.
  void add(const Row& row, bool restarts) {
    const bool first = rows_++ == 0;
    if (restarts) ++restarts_;
    for (Possible& one : candidates_) {
      const std::string& cell = row.cells[one.column];
      const bool changes = !first && cell != one.cell;
      if (changes) ++one.changes;
      one.fits = one.fits && changes == restarts && !cell.empty();
      if (first || changes) one.cell = cell;
    }
    std::erase_if(candidates_, [](const Possible& one) { return !one.fits && !one.has_name; });
  }

  // The end of messages about rows of the same step; empty if there is no such column.
  std::string advice() const {
    const auto best = std::max_element(candidates_.begin(), candidates_.end(),
                                       [this](const auto& a, const auto& b) { return rank(a) < rank(b); });
    if (best == candidates_.end() || rank(*best) == 0) return "";
    return fmt::format(
        "; column '{0}' may name the experiments: state --experiment-column '{0}', or rename it to 'experiment'",
        best->title);
  }

 private:
  struct Possible {
    size_t column = 0;
    std::string title;
    bool has_name = false;  // its name suggests it
    bool fits = true;       // its cells change where the times begin anew, and nowhere else
    Index changes = 0;
    std::string cell = {};  // of the last row
  };

  int rank(const Possible& one) const {
    if (one.changes == 0) return 0;
    const bool fits = one.fits && restarts_ > 0 && rows_ > restarts_ + 1;
    return 2 * int(one.has_name) + int(fits);
  }

  std::vector<Possible> candidates_;
  Index rows_ = 0, restarts_ = 0;
};

class RecordReader {
 public:
  RecordReader(const Header& header, const Chosen& chosen, const ReadOptions& options)
      : header_(header), chosen_(chosen), numbers_(options.missing) {
    if (!chosen.experiment) search_.emplace(header, unused_columns(header, chosen, {}));
    const auto& column = chosen.time ? chosen.time : chosen.step;
    records_.source = chosen.time ? StepSource::times : chosen.step ? StepSource::numbers : StepSource::order;
    records_.doubt = doubt(header, chosen);
    if (column) records_.rows.name = header[*column].title;
    records_.rows.unit = chosen.unit;
    if (options.trigger.empty()) return;
    trigger_.emplace(options.trigger);
    trigger_text_ = options.trigger;
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
      for (const size_t c : *columns) records_.samples.push_back(number(row, c));
    if (trigger_) records_.event.push_back(event_of(row));
    const std::vector<double>& time = records_.rows.time;
    const size_t rows = time.size();
    if (search_) search_->add(row, !chosen_.stamped && rows > 1 && time[rows - 1] <= time[rows - 2]);
  }

  // Throws the error for a text in place of a number, with what the whole column contains. `row` is the row of the
  // text, and next() returns the rows after it.
  template <class Next>
  [[noreturn]] void fail_text(const TextFound& error, const Row& row, Next&& next) {
    const size_t c = text_column_;
    ColumnValues values = values_before(c);
    try {
      for (std::optional<Row> now = row; now; now = next())
        if (c < now->cells.size()) add_value(now->cells[c], values);
    } catch (const IoError&) {  // the rest of the table is damaged
    }
    if (values.has_numbers()) throw IoError(error);
    if (is_channel(c)) fail_with(error.text() + advice_on_texts(values, row.cells[c]));
    Names conditions;
    const Names& texts = values.texts();
    for (size_t i = 0; i < std::min(texts.size(), size_t{2}); ++i)
      conditions.insert(conditions.begin(), fmt::format("'{} == {}'", trigger_->column, words::quoted(texts[i])));
    fail("{} for the trigger '{}'; the column has {}: use {}", error.text(), trigger_text_, values.described(),
         fmt::join(conditions, " or "));
  }

  Records take(DateOrder order, char separator) {
    if (search_) records_.advice = search_->advice();
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
            "column '{0}': times such as 05:10 were read as hours and minutes. If they are minutes and seconds, "
            "name the column '{0} [mm:ss]'",
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
      const double value = number(row, event_column_);
      if (std::isnan(value)) return Event::unknown;
      records_.trigger_values.add(value);
      return known(trigger_->holds(value));
    }
    // The word of the condition is meant, even if it usually stands for a missing sample.
    if (!trigger_->is_value(cell) && numbers_.stands_for_missing(cell, row.line, title)) return Event::unknown;
    if (!cell.empty()) add_value(cell, records_.trigger_values);
    return known(trigger_->holds(std::string_view(cell)));
  }

  double number(const Row& row, size_t c) {
    try {
      return numbers_.number(row.cells[c], row.line, header_[c].title);
    } catch (const TextFound&) {
      text_column_ = c;
      throw;
    }
  }

  void add_value(const std::string& cell, ColumnValues& values) const {
    std::optional<double> value = number_from(cell, '.');
    if (!value) value = number_from(cell, ',');
    if (!value) value = switch_state(cell);
    if (value)
      values.add(*value);
    else if (!numbers_.is_word_or_empty(cell))
      values.add(std::string_view(cell));
  }

  bool is_channel(size_t c) const { return place_of(c) < chosen_.inputs.size() + chosen_.outputs.size(); }

  // The place of a column among the channels; their number if it is none.
  size_t place_of(size_t c) const {
    size_t place = 0;
    for (const auto* columns : {&chosen_.inputs, &chosen_.outputs})
      for (const size_t channel : *columns) {
        if (channel == c) return place;
        ++place;
      }
    return place;
  }

  // The values of a column in the rows that have been read.
  ColumnValues values_before(size_t c) const {
    if (!is_channel(c)) return records_.trigger_values;
    ColumnValues values;
    const size_t channels = chosen_.inputs.size() + chosen_.outputs.size();
    for (size_t i = place_of(c); i < records_.samples.size(); i += channels)
      if (!std::isnan(records_.samples[i])) values.add(records_.samples[i]);
    return values;
  }

  // On texts in a column of a channel without any number.
  static std::string advice_on_texts(const ColumnValues& values, const std::string& cell) {
    const Names& texts = values.texts();
    if (texts.size() == 1)
      return fmt::format(
          "; the column has {} and no numbers: replace this text by a number, or state --missing '{}' if it stands for a "
          "missing sample",
          values.described(), words::quoted(cell));
    if (!values.has_only_words()) return "";
    if (values.has_more()) return "; the column has many texts and no numbers, so it can't be a channel";
    Names numbers;
    for (size_t i = 0; i < texts.size(); ++i) numbers.push_back(fmt::format("{}", i));
    return fmt::format("; the column has {} and no numbers: replace them by numbers, such as {}", values.described(),
                       words::listed(numbers));
  }

  // Spreadsheet programs write rows without any content below a table. Without times, such a row is a step.
  bool is_blank(const Row& row) const {
    return (chosen_.time || chosen_.step) &&
           std::all_of(row.cells.begin(), row.cells.end(), [](const std::string& cell) { return cell.empty(); });
  }

  Index experiment_of(const Row& row) {
    const auto column = chosen_.experiment;
    const std::string id = column ? row.cells[*column] : "";
    if (column && id.empty())
      fail("line {}, column '{}': nothing found, a number or name needed", row.line, header_[*column].title);
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
  std::string trigger_text_;
  size_t event_column_ = 0;
  size_t text_column_ = 0;  // where a text was found in place of a number
  std::optional<ExperimentSearch> search_;
  Records records_;
  std::unordered_map<std::string, Index> experiment_numbers_;
  std::vector<Index> rows_;  // number of rows of each experiment so far
  std::vector<Stamp> stamps_;
  Names stamp_texts_;
  bool has_short_clock_ = false;  // a time such as "05:10" was read as hours and minutes, which no unit states
};

// A file without a final line break may be complete. But a file that was cut within its last number looks the same.
std::string remark_on_end(const Row& row, const Header& header) {
  return fmt::format(
      "the last line {} ends without a line break, so its last value {} = '{}' may have been cut. Check whether "
      "the file is complete, and end it with a line break",
      row.line, header.columns().back().title, words::quoted(row.cells.back()));
}

std::string remark_on_change(const std::filesystem::path& path) {
  return fmt::format(
      "'{}' does not match its line '# checksum = …', so the file was changed after tokid wrote it. Remove this line if "
      "you changed the file by hand. Otherwise the file is damaged",
      path.string());
}

// The columns of the first table in another one. If the caller names no channels, this one must not have more of them.
Chosen same_columns(const Header& header, const FirstTable& first, Wanted wanted) {
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

// Which of the r + m channels hold their value between two samples.
std::vector<bool> held_channels(const Header& header, const Chosen& chosen, const Names& held) {
  std::vector<size_t> channels = chosen.inputs;
  channels.insert(channels.end(), chosen.outputs.begin(), chosen.outputs.end());
  std::vector<bool> result(channels.size());
  for (const std::string& name : held) {
    const auto found = std::find(channels.begin(), channels.end(), header.need(name));
    if (found == channels.end()) fail("held: column '{}' found, which is neither an input nor an output", name);
    result[size_t(found - channels.begin())] = true;
  }
  return result;
}

}  // namespace

Table read_table(const std::filesystem::path& path, const ReadOptions& options, const FirstTable* first) {
  TableText text(path);
  TableStart start = table_start(text, options);
  const Notes& notes = start.notes;
  const Header header(std::move(start.columns), start.header_line);
  const Wanted wanted{options.inputs, options.outputs,         options.time, options.experiment, notes.channels,
                      options.wanted, options.outputs_required};
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
    try {
      reader.add(*row);
    } catch (const TextFound& error) {
      reader.fail_text(error, *row, [&] { return text.next(start.dialect.separator); });
    }
    if (text.has_open_end(*row)) table.cut = remark_on_end(*row, header);
  }
  table.records = reader.take(options.dates, start.dialect.separator);
  if (table.records.rows.time.empty()) fail("no rows after the header found, samples needed");
  table.channels = channels_of(header, chosen, wanted);
  table.input_titles = titles_of(header, chosen.inputs), table.output_titles = titles_of(header, chosen.outputs);
  table.records.inputs = table.input_titles, table.records.outputs = table.output_titles;
  table.records.held = held_channels(header, chosen, options.held);
  table.dt = notes.dt, table.initial_state = notes.initial_state, table.length = notes.length;
  table.names_experiments = chosen.experiment.has_value(), table.stamped = chosen.stamped;
  table.guesses = reader.guesses();

  table.remarks = std::move(start.remarks);
  const auto remark = [&table](std::optional<std::string> one) {
    if (one) table.remarks.push_back(*std::move(one));
  };
  if (const auto line = text.latin_line())
    remark(fmt::format("line {} is not UTF-8 text. Such lines were read as Latin-1 (Windows-1252)", *line));
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

}  // namespace tokid::io
