// Tidy .csv: a row for each experiment and step, a column for each channel. Comments before the header contain all
// other information.
// SPDX-License-Identifier: BSD-3-Clause
#include <csv.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <deque>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "base/json.hpp"
#include "base/words.hpp"
#include "io/formats/column_remarks.hpp"
#include "io/formats/formats.hpp"
#include "io/formats/time_axis.hpp"
#include "io/formats/time_unit.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/guard/claims.hpp"
#include "io/guard/text_checksum.hpp"
#include "io/text.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

namespace {

constexpr double missing = std::numeric_limits<double>::quiet_NaN();

// ---- the first line of a file that tokid wrote: the checksum of the rest ----

constexpr std::string_view checksum_begin = "# checksum = ";

std::string checksum_line(std::string_view digits) { return fmt::format("{}{}\n", checksum_begin, digits); }

// Does this look like a checksum of tokid? One character of it may be damaged, and a spreadsheet program may have added
// empty cells. A checksum of another program looks different.
bool is_ours(std::string_view digits) {
  digits = digits.substr(0, digits.find_last_not_of(",;\t ") + 1);
  const auto is_digit = [](char c) { return std::string_view("0123456789abcdef").find(c) != std::string_view::npos; };
  return digits.size() <= 16 &&
         std::count_if(digits.begin(), digits.end(), is_digit) + 1 >= std::ptrdiff_t(digits.size());
}

// The checksum in this line; empty for another kind of line. If one character before the digits is damaged, the result
// is "", which matches no text.
std::optional<std::string> checksum_in(std::string_view line) {
  if (line.size() < checksum_begin.size()) return std::nullopt;
  const auto same = std::inner_product(checksum_begin.begin(), checksum_begin.end(), line.begin(), size_t{0},
                                       std::plus<>(), std::equal_to<>());
  if (same + 1 < checksum_begin.size()) return std::nullopt;
  std::string_view digits = line.substr(checksum_begin.size());
  digits.remove_suffix(digits.ends_with('\r') ? 1 : 0);
  if (!is_ours(digits)) return std::nullopt;
  return same < checksum_begin.size() ? "" : std::string(digits);
}

// ---- rows of cells ----

using Cells = std::vector<std::string>;

struct Row {
  Index line = 0;  // number of the line where the row ends, counted from 1
  Cells cells;
};

class Tokenizer {
 public:
  explicit Tokenizer(const std::filesystem::path& path) : file_(path, std::ios::binary) {
    if (!file_ || csv_init(&parser_, CSV_STRICT | CSV_STRICT_FINI) != 0) fail("can't be read");
    constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";
    read_line();
    if (line_text_.starts_with(byte_order_mark)) line_text_.erase(0, byte_order_mark.size());
    checksum_ = checksum_in(line_text_);
    if (checksum_) read_line();
  }
  ~Tokenizer() { csv_free(&parser_); }
  Tokenizer(const Tokenizer&) = delete;
  Tokenizer& operator=(const Tokenizer&) = delete;

  // The text after # in the next line, if this line is a comment. Must not be called after next().
  std::optional<Row> next_comment() {
    while (has_line_ && line_text_.find_first_not_of(" \t\r") == std::string::npos) read_line();
    if (!has_line_ || !line_text_.starts_with('#')) return std::nullopt;
    Row comment{line_, {line_text_.substr(1)}};
    read_line();
    return comment;
  }

  // The next row that is not blank.
  std::optional<Row> next() {
    while (rows_.empty() && has_line_) parse_line();
    if (rows_.empty()) return std::nullopt;
    Row row = std::move(rows_.front());
    rows_.pop_front();
    return row;
  }

  // Is the text different from that for which the checksum was written? Must be called after the last row.
  bool is_changed() { return checksum_ && *checksum_ != rest_.digits(); }

  // Does the file end with this row, and without a line break or a closing quotation mark?
  bool has_open_end(const Row& row) const { return open_end_ && row.line == line_; }

 private:
  void read_line() {
    has_line_ = static_cast<bool>(std::getline(file_, line_text_));
    if (!has_line_) return;
    ++line_;
    if (checksum_) rest_.add(line_text_), rest_.add(file_.eof() ? "" : "\n");
    open_end_ = file_.eof() && !line_text_.ends_with('"') && !line_text_.ends_with('\r');
  }

  // Parses one line at a time, so that every row knows its line. A quoted cell may span several lines.
  void parse_line() {
    line_text_ += '\n';
    const size_t parsed = csv_parse(&parser_, line_text_.data(), line_text_.size(), on_cell, on_row, this);
    if (parsed != line_text_.size())
      fail("line {}: misplaced quotation mark found, plain or quoted cells needed", line_);
    const Index line = line_;
    read_line();
    if (!has_line_ && csv_fini(&parser_, on_cell, on_row, this) != 0)
      fail("line {}: the end found within a quoted cell, a closing quotation mark needed", line);
  }

  static void on_cell(void* text, size_t size, void* self) {
    static_cast<Tokenizer*>(self)->cells_.emplace_back(static_cast<const char*>(text), size);
  }
  static void on_row(int, void* self) {
    auto& t = *static_cast<Tokenizer*>(self);
    t.rows_.push_back({t.line_, std::exchange(t.cells_, {})});
  }

  std::ifstream file_;
  csv_parser parser_{};
  std::string line_text_;
  bool has_line_ = false, open_end_ = false;
  Index line_ = 0;
  Cells cells_;
  std::deque<Row> rows_;
  std::optional<std::string> checksum_;
  TextChecksum rest_;  // checksum of the text after the first line
};

// ---- comments before the header: "# name = value" ----

struct Note {
  Index line = 0;
  std::string text;
  Json value;  // discarded if the text is no number and no flat list
};

struct Notes {
  std::optional<double> dt;
  std::optional<InitialState> initial_state;
  Channels channels;
  std::vector<Index> length;
  std::map<std::string, Note> lines;  // by name
  bool has_checksum = false;          // there is a line with a checksum after the first line
};

std::string trimmed(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(" \t\r") + 1 - begin));
}

// Reads a number or a flat list. JSON objects are not read, because no note needs an object and large objects are slow
// to read.
Json value_of_note(std::string_view text) {
  const JsonMeasure found = measure_json(text);
  return found.depth <= 1 && found.keys == 0 ? parse_json(text) : Json(Json::value_t::discarded);
}

template <typename T>
void take(const Note& note, const std::string& key, T& to) {
  const auto is_whole = [](const auto& count) { return count.is_number_integer(); };
  try {
    const Json& json = note.value;
    const bool valid = !std::is_same_v<T, std::vector<Index>> || std::all_of(json.begin(), json.end(), is_whole);
    if (valid) return static_cast<void>(to = json.get<typename std::decay_t<T>>());
  } catch (const Json::exception&) {
  }
  fail("line {}: {} = '{}' found, a value in JSON's notation needed", note.line, key, words::quoted(note.text));
}

// A repeated note must have the same value.
void check_repeated(std::map<std::string, Note>& lines, const std::string& key, const Note& note) {
  const auto [before, is_new] = lines.try_emplace(key, note);
  const Note& first = before->second;
  if (is_new || first.text == note.text || (!first.value.is_discarded() && first.value == note.value)) return;
  fail("line {}: {} = '{}' found, but line {} has {} = '{}'; one of them needed", note.line, key,
       words::quoted(note.text), first.line, key, words::quoted(first.text));
}

void read_note(const Row& comment, Notes& notes) {
  const std::string& text = comment.cells.front();
  const size_t equals = text.find('=');
  if (equals == std::string::npos) return;
  const std::string key = trimmed(std::string_view(text).substr(0, equals));
  const std::map<std::string, Names*> lists{{"input_names", &notes.channels.input_names},
                                            {"output_names", &notes.channels.output_names},
                                            {"input_units", &notes.channels.input_units},
                                            {"output_units", &notes.channels.output_units}};
  const auto list = lists.find(key);
  if (key == "checksum") notes.has_checksum |= is_ours(trimmed(std::string_view(text).substr(equals + 1)));
  if (list == lists.end() && key != "dt" && key != "length" && key != "initial_state") return;
  Note note{comment.line, trimmed(std::string_view(text).substr(equals + 1)), {}};
  note.value = value_of_note(note.text);
  check_repeated(notes.lines, key, note);
  if (key == "dt") take(note, key, notes.dt.emplace());
  if (key == "length") take(note, key, notes.length);
  if (key == "initial_state") notes.initial_state = initial_state_from(note.text.substr(0, 80));
  if (list != lists.end()) take(note, key, *list->second);
}

// ---- columns ----

struct Columns {
  Cells names;
  std::optional<size_t> experiment, time, step;
  TimeUnit unit;  // of the times
  std::vector<size_t> inputs, outputs;

  Names names_of(const std::vector<size_t>& chosen) const {
    Names result;
    for (const size_t c : chosen) result.push_back(names[c]);
    return result;
  }
};

// "Experiment" and "time" may have capital letters. A column "K" is not the column "k" of step numbers.
std::string canonical(const std::string& name) {
  const std::string lower = in_lower_case(name);
  return lower == "experiment" || lower == "time" ? lower : name;
}

bool is_reserved(const std::string& name) {
  return name == "k" || canonical(name) == "experiment" || canonical(name) == "time";
}

// Finds columns by their names.
class Header {
 public:
  explicit Header(const Cells& names) : names_(names) {
    for (size_t c = 0; c < names.size(); ++c) columns_[canonical(names[c])].push_back(c);
  }

  const Cells& names() const { return names_; }

  std::optional<size_t> find(const std::string& name) const {
    const auto found = columns_.find(canonical(name));
    if (found == columns_.end()) return std::nullopt;
    if (found->second.size() > 1) fail("header: {} columns '{}' found, one needed", found->second.size(), name);
    return found->second.front();
  }

 private:
  const Cells& names_;
  std::unordered_map<std::string, std::vector<size_t>> columns_;
};

std::vector<size_t> named_columns(const Header& header, const Names& wanted) {
  std::vector<size_t> columns;
  for (const auto& name : wanted) {
    const auto column = header.find(name);
    if (!column) fail("no column '{}' found among {}", name, quoted(header.names()));
    columns.push_back(*column);
  }
  return columns;
}

std::vector<size_t> prefixed_columns(const Header& header, char prefix, const Names& taken) {
  const std::unordered_set<std::string> others(taken.begin(), taken.end());
  Names wanted;
  for (const auto& name : header.names())
    if (name.starts_with(prefix) && !is_reserved(name) && others.count(name) == 0) wanted.push_back(name);
  return named_columns(header, wanted);
}

// The names that the caller states, or else those that the comments of the file state. If there are none: the wanted
// names, if the file has all these columns.
const Names& names_to_read(const Row& header, const Names& stated, const Names& noted, const Names& wanted) {
  if (!stated.empty() || !noted.empty()) return stated.empty() ? noted : stated;
  const auto is_there = [&](const std::string& name) {
    return std::find(header.cells.begin(), header.cells.end(), name) != header.cells.end();
  };
  return std::all_of(wanted.begin(), wanted.end(), is_there) ? wanted : noted;
}

// The only column whose name `wanted` accepts. Columns of channels are not considered, even if only the comments name
// them as channels.
template <class Wanted>
std::optional<size_t> only_column(const Columns& columns, const Channels& noted, const char* what, const char* name,
                                  Wanted&& wanted) {
  std::unordered_set<std::string> channels(noted.input_names.begin(), noted.input_names.end());
  channels.insert(noted.output_names.begin(), noted.output_names.end());
  for (const auto* chosen : {&columns.inputs, &columns.outputs})
    for (const size_t c : *chosen) channels.insert(columns.names[c]);
  std::optional<size_t> column;
  Names candidates;
  for (size_t c = 0; c < columns.names.size(); ++c) {
    if (channels.count(columns.names[c]) > 0 || !wanted(columns.names[c])) continue;
    column = c;
    candidates.push_back(columns.names[c]);
  }
  if (candidates.size() > 1)
    fail("header: {} found, one column of {} needed; give this column the name '{}'", quoted(candidates), what, name);
  return column;
}

// Finds the column that states the steps of the rows. In order of preference: "time", another name for times, "k",
// another name for step numbers.
void find_steps(const Channels& noted, Columns& columns) {
  const Header header(columns.names);
  columns.time = header.find("time");
  columns.step = header.find("k");
  if (columns.time) return;
  columns.time = only_column(columns, noted, "times", "time", [](const std::string& name) { return time_unit(name); });
  if (columns.time) columns.unit = *time_unit(columns.names[*columns.time]);
  if (!columns.time && !columns.step) columns.step = only_column(columns, noted, "step numbers", "k", is_step_number);
}

Columns columns_of(const Row& header, const Names& inputs, const Names& outputs) {
  Columns columns;
  columns.names = header.cells;
  const Header found(columns.names);
  columns.experiment = found.find("experiment");
  columns.inputs = inputs.empty() ? prefixed_columns(found, 'u', outputs) : named_columns(found, inputs);
  columns.outputs = outputs.empty() ? prefixed_columns(found, 'y', inputs) : named_columns(found, outputs);
  const std::unordered_set<size_t> outputs_found(columns.outputs.begin(), columns.outputs.end());
  for (const size_t c : columns.inputs)
    if (outputs_found.count(c) > 0)
      fail("column '{}' is listed both as an input and as an output. List it only once", columns.names[c]);
  return columns;
}

// A remark for the user on the columns that are not read.
std::optional<std::string> remark_on_unused_columns(const Columns& columns) {
  std::unordered_set<size_t> used(columns.inputs.begin(), columns.inputs.end());
  used.insert(columns.outputs.begin(), columns.outputs.end());
  for (const auto& column : {columns.experiment, columns.time ? columns.time : columns.step})
    if (column) used.insert(*column);
  Names unused;
  for (size_t c = 0; c < columns.names.size(); ++c)
    if (used.count(c) == 0)
      unused.push_back(columns.names[c].empty() ? fmt::format("number {}, without a name", c + 1) : columns.names[c]);
  return remark_on_unused(unused);
}

std::optional<std::string> remark_on_steps(const Columns& columns) {
  if (columns.time || columns.step) return std::nullopt;
  return std::string(rows_as_steps);
}

void require_channels(const Columns& columns, bool outputs_required) {
  if (columns.inputs.empty())
    fail("no column whose name begins with u found among {}; name the inputs", quoted(columns.names));
  if (columns.outputs.empty() && outputs_required)
    fail("no column whose name begins with y found among {}; name the outputs", quoted(columns.names));
}

// ---- samples ----

struct Records {
  Columns columns;
  TimeColumn rows;
  std::vector<double> samples;  // (rows, r + m)
};

double number_of(std::string_view text, const Row& row, const std::string& column) {
  if (text.empty() || text == "NA") return missing;
  std::string_view digits = text.starts_with('+') ? text.substr(1) : text;
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size())
    fail("line {}, column '{}': '{}' found, a number needed", row.line, column, words::quoted(text));
  return value;
}

void check_width(const Row& row, const Cells& names) {
  const size_t found = row.cells.size(), needed = names.size();
  if (found < needed)
    fail("line {}: {} cells found, {} needed; column '{}' has none", row.line, found, needed, names[found]);
  if (found > needed)
    fail("line {}: {} cells found, {} needed; '{}' after the last column '{}'", row.line, found, needed,
         words::quoted(row.cells[needed]), names.back());
}

// For errors in the values of a column of step numbers that is not named "k": a text that reminds the user of this
// interpretation.
std::string doubt(const Columns& columns) {
  if (columns.time || !columns.step || columns.names[*columns.step] == "k") return "";
  return fmt::format("; the column '{}' was read as step numbers: rename it if it contains something else",
                     columns.names[*columns.step]);
}

class RecordReader {
 public:
  explicit RecordReader(Columns columns) {
    records_.columns = std::move(columns);
    const auto& column = records_.columns.time ? records_.columns.time : records_.columns.step;
    if (column) records_.rows.name = records_.columns.names[*column];
    records_.rows.unit = records_.columns.unit;
  }

  void add(const Row& row) {
    const Columns& columns = records_.columns;
    check_width(row, columns.names);
    const Index n = experiment_of(row);
    records_.rows.experiment.push_back(n);
    records_.rows.line.push_back(row.line);
    records_.rows.time.push_back(time_of(row, n));
    for (const auto* chosen : {&columns.inputs, &columns.outputs})
      for (const size_t c : *chosen) records_.samples.push_back(number_of(row.cells[c], row, columns.names[c]));
  }

  Records take() { return std::move(records_); }

 private:
  Index experiment_of(const Row& row) {
    const auto column = records_.columns.experiment;
    const std::string id = column ? row.cells[*column] : "";
    if (column && id.empty()) fail("line {}, column 'experiment': nothing found, a number or name needed", row.line);
    const auto [at, is_new] = numbers_.try_emplace(id, static_cast<Index>(numbers_.size()));
    if (is_new) {
      records_.rows.experiments.push_back(id);
      rows_.push_back(0);
    }
    return at->second;
  }

  double time_of(const Row& row, Index n) {
    const Columns& columns = records_.columns;
    const auto column = columns.time ? columns.time : columns.step;
    if (!column) return static_cast<double>(rows_[static_cast<size_t>(n)]++);
    const double time = number_of(row.cells[*column], row, columns.names[*column]);
    const bool whole = columns.time || time == std::floor(time);
    if (!std::isfinite(time) || !whole)
      fail("line {}, column '{}': '{}' found, a {} needed{}", row.line, columns.names[*column],
           words::quoted(row.cells[*column]), columns.time ? "finite time" : "whole number", doubt(columns));
    records_.rows.precision.add(row.cells[*column], time);
    return time;
  }

  Records records_;
  std::unordered_map<std::string, Index> numbers_;
  std::vector<Index> rows_;  // number of rows of each experiment so far
};

// ---- the steps ----

// The common steps of all rows, counted from the smallest time or step number.
struct Steps {
  Grid grid;
  Index count = 1;
};

Steps steps_of(const Records& records, std::optional<double> dt) {
  const auto [first, last] = std::minmax_element(records.rows.time.begin(), records.rows.time.end());
  if (dt && (!(*dt > 0) || !std::isfinite(*dt))) fail("dt: {} found, a positive time in seconds needed", *dt);
  // Step numbers that continue from one experiment to the next probably count rows. Only a column named "k" is trusted.
  if (!doubt(records.columns).empty())
    check_common_steps(records.rows, "step numbers from the begin of each experiment on needed, or the name 'k'");
  const Grid grid = records.columns.time ? time_grid(records.rows, dt) : Grid{*first, 1.0};
  const double steps = grid.step(*last) + 1, rows = static_cast<double>(records.rows.time.size());
  const size_t experiments = records.rows.experiments.size();
  // Without this limit, one wrong time or step number could take far more memory than the number of rows justifies.
  const double channels = static_cast<double>(records.columns.inputs.size() + records.columns.outputs.size());
  const double samples = steps * static_cast<double>(experiments) * channels;
  if (!(samples <= 1e6 + 1000 * rows * channels))
    fail("{} experiments of {} steps found in only {} rows, fewer missing rows needed; check the times or step numbers",
         experiments, steps, rows);
  if (!(samples * sizeof(double) <= static_cast<double>(memory_limit())))
    fail("{} experiments of {} steps with {} channels found, which take {} bytes of memory; this machine has {}",
         experiments, steps, channels, samples * sizeof(double), memory_limit());
  return {grid, static_cast<Index>(steps)};
}

// ---- the ensemble ----

void fill(const Records& records, const Grid& grid, Ensemble& e) {
  std::vector<bool> seen(static_cast<size_t>(e.experiments() * e.steps()));
  auto sample = records.samples.begin();
  for (size_t i = 0; i < records.rows.time.size(); ++i) {
    const Index n = records.rows.experiment[i], k = static_cast<Index>(grid.step(records.rows.time[i]));
    auto cell = seen[static_cast<size_t>(n * e.steps() + k)];
    if (cell)
      fail("line {}: a second row for step {} of experiment '{}' found, one needed{}", records.rows.line[i], k,
           records.rows.experiments[static_cast<size_t>(n)], doubt(records.columns));
    cell = true;
    for (Index j = 0; j < e.inputs(); ++j) e.u(n, k, j) = *sample++;
    for (Index j = 0; j < e.outputs(); ++j) e.y(n, k, j) = *sample++;
  }
}

// Default names are dropped, unless the comments of the file state them as names.
Names names_unless_default(const Names& names, char prefix, bool given) {
  bool is_default = true;
  for (size_t i = 0; i < names.size(); ++i) is_default = is_default && names[i] == fmt::format("{}{}", prefix, i + 1);
  return is_default && !given ? Names{} : names;
}

// The units of the chosen channels by name, because the caller may have chosen other channels than the file.
Names units_of(const Names& chosen, const std::map<std::string, std::string>& units) {
  Names result;
  bool any = false;
  for (const auto& name : chosen) {
    const auto unit = units.find(name);
    result.push_back(unit == units.end() ? "" : unit->second);
    any = any || unit != units.end();
  }
  return any ? result : Names{};
}

void add_units(const Names& names, const Names& units, const char* key, std::map<std::string, std::string>& to) {
  if (units.empty()) return;
  if (units.size() != names.size())
    fail("{}: {} units found for {} channels, one unit for each channel needed", key, units.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) to[names[i]] = units[i];
}

Channels channels_of(const Columns& columns, const Row& header, const Notes& notes) {
  const Columns own = columns_of(header, notes.channels.input_names, notes.channels.output_names);
  std::map<std::string, std::string> units;
  add_units(own.names_of(own.inputs), notes.channels.input_units, "input_units", units);
  add_units(own.names_of(own.outputs), notes.channels.output_units, "output_units", units);
  const Names inputs = columns.names_of(columns.inputs), outputs = columns.names_of(columns.outputs);
  return {names_unless_default(inputs, 'u', !notes.channels.input_names.empty()),
          names_unless_default(outputs, 'y', !notes.channels.output_names.empty()), units_of(inputs, units),
          units_of(outputs, units)};
}

// A file without a final line break may be complete. But a file that was cut within its last number looks the same.
std::string remark_on_end(const Row& row, const Columns& columns) {
  return fmt::format(
      "line {}, the last one, ends without a line break: its {} = '{}' may have been cut; check whether "
      "the file is complete, and end it with a line break",
      row.line, columns.names.back(), words::quoted(row.cells.back()));
}

std::string remark_on_change(const std::filesystem::path& path) {
  return fmt::format(
      "'{}' does not match its line '# checksum = …', so it was changed after tokid wrote it: remove that line if "
      "you changed the "
      "file by hand; otherwise the file is damaged",
      path.string());
}

// Steps without any row may be intended, or the column may not contain step numbers.
std::optional<std::string> remark_on_empty_steps(const Records& records, const Steps& steps) {
  if (records.columns.time || !records.columns.step) return std::nullopt;
  std::int64_t common = 0;
  for (const double number : records.rows.time) common = std::gcd(common, std::int64_t(steps.grid.step(number)));
  if (common < 2) return std::nullopt;
  return fmt::format(
      "column '{0}': all step numbers are {1} or multiples of it apart, so the {2} steps between count as missing; divide "
      "the numbers by {1} where no step is missing",
      records.columns.names[*records.columns.step], common, common - 1);
}

void apply_length(const std::vector<Index>& length, Ensemble& e) {
  e.length = length;
  if (e.length.size() != static_cast<size_t>(e.experiments()) && !length.empty())
    fail("length: {} entries found for {} experiments, one entry for each experiment needed", length.size(),
         e.experiments());
  for (size_t n = 0; n < length.size(); ++n)
    for (Index k = std::max(length[n], Index{0}); k < e.steps(); ++k) {
      e.input(k).row(static_cast<Index>(n)).setConstant(missing);
      e.output(k).row(static_cast<Index>(n)).setConstant(missing);
    }
}

}  // namespace

Ensemble read_csv(const std::filesystem::path& path, const ReadOptions& options) {
  Tokenizer file(path);
  Notes notes;
  while (const auto comment = file.next_comment()) read_note(*comment, notes);
  const auto header = file.next();
  if (!header) fail("no header line found: a line with the names of the columns needed");
  const Names& inputs = names_to_read(*header, options.inputs, notes.channels.input_names, options.wanted.input_names);
  const Names& outputs =
      names_to_read(*header, options.outputs, notes.channels.output_names, options.wanted.output_names);
  Columns columns = columns_of(*header, inputs, outputs);
  require_channels(columns, options.outputs_required);
  find_steps(notes.channels, columns);

  RecordReader reader(columns);
  std::optional<std::string> cut;
  while (const auto row = file.next()) {
    checkpoint();
    reader.add(*row);
    if (file.has_open_end(*row)) cut = remark_on_end(*row, columns);
  }
  const Records records = reader.take();
  if (records.rows.time.empty()) fail("no rows after the header found, samples needed");

  const Steps steps = steps_of(records, notes.dt);
  const bool shows_dt = columns.time && steps.grid.shows_dt;
  Ensemble e(static_cast<Index>(records.rows.experiments.size()), steps.count,
             static_cast<Index>(columns.inputs.size()), static_cast<Index>(columns.outputs.size()),
             notes.dt.value_or(shows_dt ? columns.unit.in_seconds(steps.grid.dt) : 1.0));
  e.dt_stated = notes.dt || shows_dt;
  fill(records, steps.grid, e);
  e.names = channels_of(columns, *header, notes);
  if (columns.experiment) set_experiment_names(e, records.rows.experiments);
  e.initial_state = notes.initial_state;
  apply_length(notes.length, e);
  e.check(options.outputs_required);
  for (const auto& remark :
       {remark_on_unused_columns(columns), remark_on_steps(columns), remark_on_empty_steps(records, steps), cut})
    if (remark) e.remarks.push_back(*remark);
  if (notes.has_checksum || file.is_changed()) e.remarks.push_back(remark_on_change(path));
  return e;
}

// ---- writing ----

namespace {

// A spreadsheet program executes a cell that begins like a formula, and a formula can read files and start programs.
// The program also splits the lists in the comments into cells, so the names and units in these lists are checked, too.
void check_no_formula(const char* key, const Names& texts) {
  for (const std::string& text : texts)
    if (!text.empty() && std::string_view("=+-@\t").find(text.front()) != std::string_view::npos &&
        text.find_first_of("(!|") != std::string::npos)
      fail("{}: '{}' found, which spreadsheet programs take for a formula; another text needed in .csv", key, text);
}

Names column_names(const Ensemble& e) {
  Names names{"experiment", e.dt_stated ? "time" : "k"};
  for (Index i = 0; i < e.inputs(); ++i) names.push_back(e.names.input(i));
  for (Index j = 0; j < e.outputs(); ++j) names.push_back(e.names.output(j));
  std::unordered_map<std::string, int> count;
  for (const std::string& name : names) ++count[name];
  for (size_t c = 0; c < names.size(); ++c)
    if (count[names[c]] > 1 || (c > 1 && is_reserved(names[c])))
      fail("channel name '{}' found twice or as the name of a column of its own in .csv; distinct names needed",
           names[c]);
  return names;
}

std::string csv_cell(const std::string& text) {
  std::string cell(2 * text.size() + 2, '\0');
  cell.resize(csv_write(cell.data(), cell.size(), text.data(), text.size()));
  const bool plain = cell.size() == text.size() + 2 && !text.empty() && text == trimmed(text) &&
                     text.find_first_of(",\r\n#") == std::string::npos;
  return plain ? text : cell;
}

void write_notes(const Ensemble& e, std::string& out) {
  const auto note = [&](const char* key, const auto& value) { out += fmt::format("# {} = {}\n", key, text_of(value)); };
  if (e.dt_stated) out += fmt::format("# dt = {}\n", e.dt);
  if (e.initial_state) out += fmt::format("# initial_state = {}\n", to_string(*e.initial_state));
  if (!e.length.empty()) note("length", e.length);
  if (!e.names.input_names.empty()) note("input_names", e.names.input_names);
  if (!e.names.output_names.empty()) note("output_names", e.names.output_names);
  if (!e.names.input_units.empty()) note("input_units", e.names.input_units);
  if (!e.names.output_units.empty()) note("output_units", e.names.output_units);
}

void write_row(const Ensemble& e, Index n, Index k, std::string_view experiment, std::string& out) {
  out += fmt::format("{},{}", experiment, static_cast<double>(k) * (e.dt_stated ? e.dt : 1.0));
  for (Index c = 0; c < e.channels(); ++c) {
    const double value = e.samples()(n, k * e.channels() + c);
    out.push_back(',');
    if (!std::isnan(value)) out += fmt::format("{}", value);
  }
  out.push_back('\n');
}

// Rows without any sample are not written. The rows of the first experiment and of the first step are always written,
// so that all experiments and steps exist in the file.
bool is_needed(const Ensemble& e, Index n, Index k) {
  return n == 0 || k == 0 || !e.samples().row(n).segment(k * e.channels(), e.channels()).array().isNaN().all();
}

void check_fits(const Ensemble& e) {
  if (e.free.experiments > 0) fail("free responses don't fit into .csv; .npz, .h5 or .mat needed");
  if (e.inputs() == 0) fail("an ensemble without inputs doesn't fit into .csv; .npz, .h5 or .mat needed");
  const std::pair<const char*, const Names&> texts[] = {{"input_names", e.names.input_names},
                                                        {"output_names", e.names.output_names},
                                                        {"input_units", e.names.input_units},
                                                        {"output_units", e.names.output_units},
                                                        {"experiment_names", e.experiment_names}};
  for (const auto& [key, list] : texts) {
    check_texts(key, list);
    check_no_formula(key, list);
  }
}

}  // namespace

void write_csv(const Ensemble& e, const std::filesystem::path& path) {
  check_fits(e);
  ByteWriter file(path);
  TextChecksum checksum;
  std::string out = checksum_line(std::string(16, '0'));  // replaced when the checksum is known
  file.write(out);
  out.clear();
  write_notes(e, out);
  Names cells = column_names(e);
  std::transform(cells.begin(), cells.end(), cells.begin(), csv_cell);
  out += fmt::format("{}\n", fmt::join(cells, ","));
  for (Index n = 0; n < e.experiments(); ++n) {
    checkpoint();
    const std::string name = e.experiment_name(n);
    const std::string experiment = name.empty() ? fmt::format("{}", n) : csv_cell(name);
    for (Index k = 0; k < e.steps(); ++k)
      if (is_needed(e, n, k)) write_row(e, n, k, experiment, out);
    checksum.add(out);
    file.write(out);
    out.clear();
  }
  file.rewind();
  file.write(checksum_line(checksum.digits()));
}

}  // namespace tokid::io
