// Reads strict .csv files: one ensemble from one table, or from many tables. Python's tokid.read reads the tables of
// other programs.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "base/nan.hpp"
#include "base/words.hpp"
#include "io/formats/csv_columns.hpp"
#include "io/formats/csv_lines.hpp"
#include "io/formats/even_times.hpp"
#include "io/formats/formats.hpp"
#include "io/guard/claims.hpp"
#include "io/guard/descriptor.hpp"
#include "io/naming.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

namespace {

// The rows of a table, and what its header and comments state.
struct Table {
  std::string file;
  Notes notes;
  Names header;
  CsvColumns columns;
  Names experiments;                    // in the order of appearance
  std::vector<Index> experiment, line;  // of each row
  std::vector<double> place;            // of each row: its time, its step number, or its number in its experiment
  std::vector<double> samples;          // (rows, r + m)
  Names remarks;

  size_t rows() const { return line.size(); }
};

// A mark in quotation marks separates nothing.
char separator_of(std::string_view header) {
  bool quoted = false, semicolon = false;
  for (const char c : header) {
    if (c == '"') quoted = !quoted;
    if (c == '\t' && !quoted) return '\t';
    semicolon = semicolon || (c == ';' && !quoted);
  }
  return semicolon ? ';' : ',';
}

// A number with a decimal point; NaN for an empty cell. Empty for another text, and for a number that is too large.
std::optional<double> number_from(std::string_view cell) {
  if (cell.empty() || cell == "NA" || cell == "NaN" || cell == "nan") return nan;
  const bool plus = cell.front() == '+';
  if (plus) cell.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (end != cell.data() + cell.size() || std::isnan(value) || (plus && cell.starts_with('-'))) return std::nullopt;
  if (error == std::errc::result_out_of_range)
    return cell.find("e-") != std::string_view::npos || cell.find("E-") != std::string_view::npos ? std::optional(0.0)
                                                                                                  : std::nullopt;
  return error == std::errc() ? std::optional(value) : std::nullopt;
}

class TableReader {
 public:
  TableReader(const std::filesystem::path& path, const ReadOptions& options) : lines_(path) {
    table_.file = path.filename().string();
    read_header(options);
    while (lines_.next()) {
      if (table_.rows() % 4096 == 0) checkpoint();
      add_row();
    }
    if (table_.rows() == 0) fail("no rows found below the header, samples needed");
    if (!table_.columns.place()) check_no_clock();
    add_remarks(path);
  }
  Table take() { return std::move(table_); }

 private:
  void read_header(const ReadOptions& options) {
    while (lines_.next() && lines_.text().starts_with('#'))
      read_note(lines_.number(), std::string(lines_.text().substr(1)), table_.notes);
    if (lines_.number() == 0 || lines_.text().empty()) fail("no header found, a line with the names of columns needed");
    separator_ = separator_of(lines_.text());
    table_.header = lines_.cells(separator_);
    const auto is_number = [](const std::string& name) { return !name.empty() && number_from(name).has_value(); };
    if (std::all_of(table_.header.begin(), table_.header.end(), is_number))
      fail("line {}: numbers found, the names of the columns needed in the first row", lines_.number());
    table_.columns = csv_columns(table_.header, table_.notes, options);
  }

  void add_row() {
    if (table_.header.size() == 1 && lines_.blank() > 0)
      fail("line {}: a blank line found in a table of one column; NaN for a missing sample needed", lines_.blank());
    const Names& cells = lines_.cells(separator_);
    const Index line = lines_.number();
    if (cells.size() != table_.header.size())
      fail("line {}: {} cells found, {} needed, one for each name in the header", line, cells.size(),
           table_.header.size());
    const Index n = experiment_of(cells);
    table_.experiment.push_back(n);
    table_.line.push_back(line);
    const auto place = table_.columns.place();
    const double value = place ? number(cells, *place) : double(rows_[size_t(n)]++);
    const bool whole = table_.columns.time || value == std::floor(value);
    if (!std::isfinite(value) || !whole)
      fail("line {}, column '{}': '{}' found, a {} needed", line, table_.header[*place], words::quoted(cells[*place]),
           table_.columns.time ? "time in seconds" : "whole number");
    table_.place.push_back(value);
    for (const auto* columns : {&table_.columns.inputs, &table_.columns.outputs})
      for (const size_t c : *columns) table_.samples.push_back(number(cells, c));
  }

  double number(const Names& cells, size_t c) const {
    const std::optional<double> value = number_from(cells[c]);
    if (!value)
      fail("line {}, column '{}': '{}' found, a number needed, with a decimal point; an empty cell is a missing sample",
           lines_.number(), table_.header[c], words::quoted(cells[c]));
    return *value;
  }

  // Rows are steps only if no column may be their clock.
  void check_no_clock() const {
    if (!table_.columns.unused.empty())
      fail(
          "no column 'time' or 'k' found, but {}, which may have the times; the name 'time' or 'k' for it needed, or a "
          "table without it",
          quoted(table_.columns.unused));
    const size_t inputs = table_.columns.inputs.size(), channels = inputs + table_.columns.outputs.size();
    for (size_t c = 0; c < inputs && table_.rows() > 3; ++c) {
      bool even = true;
      const double step = table_.samples[channels + c] - table_.samples[c];
      for (size_t row = 1; even && row < table_.rows() && table_.experiment[row] == 0; ++row) {
        const double gap = table_.samples[row * channels + c] - table_.samples[(row - 1) * channels + c];
        even = gap > 0 && std::abs(gap - step) <= 1e-3 * step;
      }
      if (even)
        fail(
            "no column 'time' or 'k' found, but the input '{}' rises evenly like a clock; the name 'time' for it, or a "
            "column 'k' beside it, needed",
            table_.header[table_.columns.inputs[c]]);
    }
  }

  Index experiment_of(const Names& cells) {
    const auto column = table_.columns.experiment;
    const std::string id = column ? cells[*column] : "";
    if (column && id.empty())
      fail("line {}, column '{}': nothing found, a number or name needed", lines_.number(), table_.header[*column]);
    const auto [at, is_new] = numbers_.try_emplace(id, Index(numbers_.size()));
    if (is_new) table_.experiments.push_back(id), rows_.push_back(0);
    return at->second;
  }

  void add_remarks(const std::filesystem::path& path) {
    Names& remarks = table_.remarks;
    if (lines_.is_changed() || table_.notes.has_checksum)
      remarks.push_back(
          fmt::format("'{}' does not match its line '# checksum = …', so the file was changed after tokid wrote it. "
                      "Remove this line if you changed the file by hand. Otherwise the file is damaged",
                      path.string()));
    if (const Names& unused = table_.columns.unused; !unused.empty())
      remarks.push_back(fmt::format("{} {} not used. Name the columns that are channels as inputs or outputs",
                                    unused.size() == 1 ? "column" : "columns", words_of_unused(unused)));
    if (!table_.columns.place())
      remarks.emplace_back("no column 'time' or 'k' found, so the rows were taken as successive steps");
    if (lines_.has_open_end())
      remarks.push_back(
          fmt::format("the last line {} ends without a line break, so its last value may have been cut. Check whether "
                      "the file is complete, and end it with a line break",
                      lines_.number()));
  }

  static std::string words_of_unused(const Names& unused) {
    return fmt::format("{} {}", quoted(unused), unused.size() == 1 ? "is" : "are");
  }

  CsvLines lines_;
  Table table_;
  char separator_ = ',';
  std::unordered_map<std::string, Index> numbers_;  // of the experiments
  std::vector<Index> rows_;                         // of each experiment so far
};

// Facts on which all tables must agree.
void check_same(const Table& first, const Table& table) {
  const auto kind = [](const Table& t) {
    return t.columns.time ? "a column 'time'" : t.columns.step ? "a column 'k'" : "no column of steps";
  };
  if (std::string_view(kind(table)) != kind(first))
    fail("{} found, but {} in '{}'; the same kind of steps in all files needed", kind(table), kind(first), first.file);
  if (table.notes.dt && first.notes.dt && *table.notes.dt != *first.notes.dt)
    fail("dt: {} found, but {} in '{}'; one sample time needed", *table.notes.dt, *first.notes.dt, first.file);
  if (table.notes.initial_state && first.notes.initial_state &&
      *table.notes.initial_state != *first.notes.initial_state)
    fail("initial_state: {} found, but {} in '{}'; one initial state needed", to_string(*table.notes.initial_state),
         to_string(*first.notes.initial_state), first.file);
  const auto units = [](const Table& t) {
    const Channels names = csv_channels(t.header, t.notes, t.columns);
    return std::pair(names.input_units, names.output_units);
  };
  if (units(table) != units(first)) fail("other units of the channels found than in '{}'; the same needed", first.file);
}

// The channels of the first table are those of all.
ReadOptions like_first(const Table& first, ReadOptions options) {
  const auto titles = [&](const std::vector<size_t>& columns) {
    Names names;
    for (const size_t c : columns) names.push_back(first.header[c]);
    return names;
  };
  options.inputs = titles(first.columns.inputs), options.outputs = titles(first.columns.outputs);
  return options;
}

// If the caller names no channels, no table may have more of them than the first.
void check_no_more(const Table& first, const Table& table, const ReadOptions& options) {
  const bool named = !options.inputs.empty() || !options.outputs.empty() || !options.wanted.input_names.empty();
  const CsvColumns own = named ? table.columns : csv_columns(table.header, table.notes, options);
  const auto channels = [](const CsvColumns& columns) { return columns.inputs.size() + columns.outputs.size(); };
  if (channels(own) > channels(first.columns) || channels(table.columns) != channels(first.columns))
    fail("{} channels found, but {} in '{}'; the same in all files needed, or the names of those to read",
         channels(own), channels(first.columns), first.file);
}

struct Steps {
  EvenTimes grid;
  Index count = 1;
};

std::string place_of(const Table& table, size_t row, bool several) {
  const std::string line = fmt::format("line {}", table.line[row]);
  return several ? fmt::format("{}, {}", table.file, line) : line;
}

// `row`: of all tables, one below the other.
std::string place_of(const std::vector<Table>& tables, size_t row) {
  size_t t = 0;
  while (row >= tables[t].rows()) row -= tables[t++].rows();
  return place_of(tables[t], row, tables.size() > 1);
}

// Step 0 is the first of all experiments. Experiments without a common step do not repeat each other.
Steps steps_of(const std::vector<Table>& tables, Index experiments, std::optional<double> dt) {
  const Table& first = tables.front();
  std::vector<double> all;
  for (const Table& table : tables) all.insert(all.end(), table.place.begin(), table.place.end());
  Steps result;
  result.grid = first.columns.time ? even_times(all, dt)
                                   : EvenTimes{.begin = *std::min_element(all.begin(), all.end()), .wrong = {}};
  if (const auto wrong = result.grid.wrong)
    fail("{}, column 'time': {} found, which is not on the even steps of {} s that begin at {}; even times needed",
         place_of(tables, *wrong), all[*wrong], result.grid.dt, result.grid.begin);
  const double steps = result.grid.step(*std::max_element(all.begin(), all.end())) + 1, rows = double(all.size());
  const double channels = double(first.columns.inputs.size() + first.columns.outputs.size());
  const double samples = steps * double(experiments) * channels;
  // Without this limit, one wrong time could take far more memory than the number of rows justifies.
  if (!(samples <= 1e6 + 1000 * rows * channels && samples * sizeof(double) <= double(memory_limit())))
    fail(
        "{} experiments of {} steps found in only {} rows, so most rows would be missing. Check the times or step "
        "numbers",
        experiments, steps, rows);
  result.count = Index(steps);
  return result;
}

// Refuses rows that are all several steps apart, because the sample time is then probably another one. With a stated
// one, these are the rows of all experiments together. Without it, an experiment has another spacing than the others.
void check_all_steps(const std::vector<Table>& tables, const Steps& steps, bool stated) {
  struct Rows {
    double last = 0.0;
    std::int64_t common = 0;
    int count = 0;
  };
  Rows all;
  for (const Table& table : tables) {
    std::vector<Rows> rows(table.experiments.size());
    for (size_t row = 0; row < table.rows(); ++row) {
      Rows& own = stated ? all : rows[size_t(table.experiment[row])];
      const double step = steps.grid.step(table.place[row]);
      if (own.count++ > 0) own.common = std::gcd(own.common, std::int64_t(step - own.last));
      own.last = step;
    }
    for (size_t n = 0; n < rows.size(); ++n)
      if (rows[n].count > 2 && rows[n].common > 1)
        fail(
            "column 'time': steps of {:.10g} s in experiment '{}' and of {:.10g} s in all together found, one sample "
            "time needed; state '# dt = {}' above the header if samples are missing",
            double(rows[n].common) * steps.grid.dt, table.experiments[n], steps.grid.dt, steps.grid.dt);
  }
  if (all.count > 2 && all.common > 1)
    fail("'# dt = {}' found, but all rows lie multiples of {:.10g} s apart; correct dt or the times", steps.grid.dt,
         double(all.common) * steps.grid.dt);
}

// The samples of all tables. Returns the number of steps to the last row of each experiment.
std::vector<Index> fill(const std::vector<Table>& tables, const Steps& steps, Ensemble& e) {
  const Index channels = e.channels();
  e.samples().setConstant(nan);
  std::vector<Index> length(size_t(e.experiments()), 0), begin(length.size(), steps.count);
  std::vector<char> seen(size_t(e.experiments() * steps.count), 0);
  Index before = 0;  // experiments of the tables before
  for (const Table& table : tables) {
    for (size_t row = 0; row < table.rows(); ++row) {
      const Index n = before + table.experiment[row], k = Index(steps.grid.step(table.place[row]));
      char& again = seen[size_t(n * steps.count + k)];
      if (again)
        fail("{}: a second row for step {} found; rows of other experiments need other names in a column 'experiment'",
             place_of(table, row, tables.size() > 1), k);
      again = 1;
      length[size_t(n)] = std::max(length[size_t(n)], k + 1);
      begin[size_t(n)] = std::min(begin[size_t(n)], k);
      for (Index c = 0; c < channels; ++c)
        e.samples()(n, k * channels + c) = table.samples[row * size_t(channels) + size_t(c)];
    }
    before += Index(table.experiments.size());
  }
  const Index last_begin = *std::max_element(begin.begin(), begin.end());
  if (last_begin >= *std::min_element(length.begin(), length.end()))
    fail("experiments without a common step found; times that count from the begin of each experiment needed");
  if (tables.size() > 1 && last_begin > 0)
    e.remarks.push_back(
        fmt::format("the times of all files were read as those of one clock, on which the experiments begin up to {} "
                    "steps apart",
                    last_begin));
  return length;
}

// The lengths that the comments state, for the experiments of tables that state any.
void apply_noted_lengths(const std::vector<Table>& tables, Ensemble& e) {
  std::vector<Index> length = e.length.empty() ? std::vector<Index>(size_t(e.experiments()), e.steps()) : e.length;
  size_t before = 0;
  bool any = false;
  for (const Table& table : tables) {
    const std::vector<Index>& noted = table.notes.length;
    if (!noted.empty() && noted.size() != table.experiments.size())
      fail("length: {} entries found for {} experiments, one entry for each experiment needed", noted.size(),
           table.experiments.size());
    for (size_t n = 0; n < noted.size(); ++n) length[before + n] = noted[n], any = true;
    before += table.experiments.size();
  }
  if (any) set_length(e, std::move(length));
}

// The names of experiments of several files: those of the files, with their folders where files have equal names.
Names labels_of(const std::vector<std::filesystem::path>& paths) {
  std::map<std::string, int> count;
  for (const auto& path : paths) ++count[path.stem().string()];
  Names labels;
  for (const auto& path : paths)
    labels.push_back(count[path.stem().string()] > 1 ? (path.parent_path() / path.stem()).string()
                                                     : path.stem().string());
  return labels;
}

// Remarks of several files, each text once.
Names joined_remarks(const std::vector<Table>& tables) {
  if (tables.size() == 1) return tables.front().remarks;
  Names texts, result;
  std::map<std::string, Names> files;
  for (const Table& table : tables)
    for (const std::string& text : table.remarks) {
      if (files[text].empty()) texts.push_back(text);
      files[text].push_back(table.file);
    }
  for (const std::string& text : texts) {
    const Names& found = files[text];
    result.push_back(found.size() == tables.size() ? fmt::format("in all files, {}", text)
                     : found.size() == 1           ? fmt::format("'{}': {}", found.front(), text)
                                         : fmt::format("'{}' and {} more: {}", found.front(), found.size() - 1, text));
  }
  return result;
}

Ensemble ensemble_of(std::vector<Table> tables, const Names& names, bool several, const ReadOptions& options) {
  const auto noted = [&](auto part) {
    auto found = tables.front().notes.*part;
    for (const Table& table : tables)
      if (!found) found = table.notes.*part;
    return found;
  };
  const std::optional<double> dt = noted(&Notes::dt);
  if (dt && !(*dt > 0 && std::isfinite(*dt))) fail("dt: {} found, a positive time in seconds needed", *dt);
  const Table& first = tables.front();
  const Steps steps = steps_of(tables, Index(names.size()), dt);
  Ensemble e(Index(names.size()), steps.count, Index(first.columns.inputs.size()), Index(first.columns.outputs.size()),
             dt.value_or(steps.grid.dt));
  e.dt_stated = dt || steps.grid.shows_dt;
  if (first.columns.time) check_all_steps(tables, steps, dt.has_value());
  std::vector<Index> length = fill(tables, steps, e);
  const bool differ = std::any_of(length.begin(), length.end(), [&](Index own) { return own < e.steps(); });
  if (several && differ) e.length = std::move(length);
  e.names = csv_channels(first.header, first.notes, first.columns);
  e.initial_state = noted(&Notes::initial_state);
  if (several || first.columns.experiment) set_experiment_names(e, names);
  apply_noted_lengths(tables, e);
  e.check(options.outputs_required);
  const Names remarks = joined_remarks(tables);
  e.remarks.insert(e.remarks.begin(), remarks.begin(), remarks.end());
  return e;
}

}  // namespace

Ensemble read_csv(const std::filesystem::path& path, const ReadOptions& options) {
  std::vector<Table> tables;
  tables.push_back(TableReader(path, options).take());
  const Names names = tables.front().experiments;
  return ensemble_of(std::move(tables), names, false, options);
}

Ensemble read_csv(const std::vector<std::filesystem::path>& paths, const ReadOptions& options) {
  const Names labels = labels_of(paths);
  std::vector<Table> tables;
  Names names;
  for (size_t i = 0; i < paths.size(); ++i)
    naming(paths[i], [&] {
      const Unchanged unchanged(paths[i]);
      Table table = TableReader(paths[i], i > 0 ? like_first(tables.front(), options) : options).take();
      unchanged.check();
      if (i > 0) check_no_more(tables.front(), table, options), check_same(tables.front(), table);
      for (const std::string& name : table.experiments)
        names.push_back(table.experiments.size() > 1 ? fmt::format("{}/{}", labels[i], name) : labels[i]);
      tables.push_back(std::move(table));
      return 0;
    });
  return ensemble_of(std::move(tables), names, true, options);
}

}  // namespace tokid::io
