// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/columns.hpp"

#include <algorithm>
#include <map>
#include <unordered_set>

#include "io/formats/column_remarks.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

// "Experiment" and "time" may have capital letters. A column "K" is not the column "k" of step numbers.
std::string canonical(const std::string& name) {
  const std::string lower = in_lower_case(name);
  return lower == "experiment" || lower == "time" ? lower : name;
}

std::vector<size_t> named_columns(const Header& header, const Names& wanted) {
  std::vector<size_t> columns;
  for (const std::string& name : wanted) columns.push_back(header.need(name));
  return columns;
}

std::vector<size_t> prefixed_columns(const Header& header, char prefix, const std::vector<size_t>& taken) {
  Names wanted;
  for (size_t c = 0; c < header.columns().size(); ++c) {
    const Column& column = header[c];
    const bool is_taken = std::find(taken.begin(), taken.end(), c) != taken.end();
    if (column.title.starts_with(prefix) && !is_reserved(column.label.name) && !is_taken)
      wanted.push_back(column.title);
  }
  return named_columns(header, wanted);
}

// The names that the caller states, or else those that the comments of the file state. If there are none: the wanted
// names, if the file has all these columns.
const Names& names_to_read(const Header& header, const Names& stated, const Names& noted, const Names& wanted) {
  if (!stated.empty() || !noted.empty()) return stated.empty() ? noted : stated;
  std::unordered_set<std::string> found;
  for (const Column& column : header.columns()) found.insert({column.title, column.label.name});
  const auto is_there = [&](const std::string& name) { return found.count(name) > 0; };
  return std::all_of(wanted.begin(), wanted.end(), is_there) ? wanted : noted;
}

bool contains_column(const std::vector<size_t>& columns, size_t c) {
  return std::find(columns.begin(), columns.end(), c) != columns.end();
}

// The columns that may state steps. Columns of channels are not considered, even if only the comments name them as
// channels.
std::vector<size_t> other_columns(const Header& header, const Chosen& chosen, const Channels& noted) {
  std::unordered_set<std::string> channels(noted.input_names.begin(), noted.input_names.end());
  channels.insert(noted.output_names.begin(), noted.output_names.end());
  std::vector<size_t> others;
  for (size_t c = 0; c < header.columns().size(); ++c)
    if (!contains_column(chosen.inputs, c) && !contains_column(chosen.outputs, c) && chosen.experiment != c &&
        channels.count(header[c].title) == 0)
      others.push_back(c);
  return others;
}

[[noreturn]] void fail_several(const Header& header, const std::vector<size_t>& columns, const char* what,
                               const char* name) {
  fail("header: {} found, one column of {} needed; give this column the name '{}'", quoted(titles_of(header, columns)),
       what, name);
}

std::optional<size_t> only_one(const Header& header, const std::vector<size_t>& columns, const char* what,
                               const char* name) {
  if (columns.size() > 1) fail_several(header, columns, what, name);
  return columns.empty() ? std::nullopt : std::optional(columns.front());
}

// A time unit in the title, or in the row of units.
std::optional<TimeUnit> unit_of(const Column& column) {
  const bool apart = !column.label.unit.empty() && column.title == column.label.name;
  const auto unit = time_unit(column.title);
  return apart && unit ? time_unit(fmt::format("{} [{}]", column.title, column.label.unit)) : unit;
}

// The unit of a column that is stated to contain times. \throws IoError for a unit that is not one of time
TimeUnit stated_unit(const Column& column) {
  if (column.label.unit.empty()) return unit_of(column).value_or(TimeUnit{});
  return time_unit(fmt::format("time [{}]", column.label.unit)).value_or(TimeUnit{});
}

// Finds the column that states the steps of the rows. In order of preference: "time", another name for times, time
// stamps, "k", another name for step numbers, dates alone.
void find_steps(const Header& header, const std::string& stated, const Channels& noted, Chosen& chosen) {
  const std::vector<size_t> others = other_columns(header, chosen, noted);
  std::vector<size_t> named, stamped, dates, clocks, numbered;
  for (const size_t c : others) {
    const Column& column = header[c];
    if (column.content == Content::date) dates.push_back(c);
    if (column.content == Content::clock) clocks.push_back(c);
    if (column.content == Content::date_and_clock) stamped.push_back(c);
    if (column.content == Content::other && unit_of(column)) named.push_back(c);
    if (is_step_number(column.title)) numbered.push_back(c);
  }
  chosen.step = header.find("k");
  if (chosen.step && !contains_column(others, *chosen.step)) chosen.step.reset();
  chosen.time = stated.empty() ? header.find("time") : header.need(stated);
  if (!stated.empty() && chosen.time == chosen.experiment)
    fail("column '{}' is stated as times and as names of experiments; one of the two needed",
         header[*chosen.time].title);
  if (chosen.time && !contains_column(others, *chosen.time)) {
    if (!stated.empty()) fail("column '{}' is stated as times and as a channel; one of the two needed", stated);
    chosen.time.reset();
  }
  if (!chosen.time) chosen.time = only_one(header, named, "times", "time");
  if (!chosen.time) chosen.time = only_one(header, stamped, "times", "time");
  if (!chosen.time) chosen.time = only_one(header, clocks, "times", "time");
  if (!chosen.time && !chosen.step && numbered.empty()) chosen.time = only_one(header, dates, "times", "time");
  if (chosen.time) {
    const Column& column = header[*chosen.time];
    chosen.stamped = column.content != Content::other;
    if (column.content == Content::clock && dates.size() == 1) chosen.date = dates.front();
    chosen.of_minutes = column.content == Content::clock && is_minutes_and_seconds(column.label.unit);
    if (!chosen.stamped) chosen.unit = stated.empty() ? unit_of(column).value_or(TimeUnit{}) : stated_unit(column);
    return;
  }
  if (!chosen.step) chosen.step = only_one(header, numbered, "step numbers", "k");
}

// Default names are dropped, unless the comments of the file state them as names.
Names names_unless_default(const Names& names, char prefix, bool given) {
  bool is_default = true;
  for (size_t i = 0; i < names.size(); ++i) is_default = is_default && names[i] == fmt::format("{}{}", prefix, i + 1);
  return is_default && !given ? Names{} : names;
}

void add_units(const Names& names, const Names& units, const char* key, std::map<std::string, std::string>& to) {
  if (units.empty()) return;
  if (units.size() != names.size())
    fail("{}: {} units found for {} channels, one unit for each channel needed", key, units.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) to[names[i]] = units[i];
}

std::optional<size_t> experiment_column(const Header& header, const Wanted& wanted) {
  return wanted.experiment.empty() ? header.find("experiment") : header.need(wanted.experiment);
}

std::vector<size_t> taken_by(const std::optional<size_t>& column) {
  return column ? std::vector<size_t>{*column} : std::vector<size_t>{};
}

std::vector<size_t> columns_and(std::vector<size_t> columns, const std::vector<size_t>& more) {
  columns.insert(columns.end(), more.begin(), more.end());
  return columns;
}

bool is_noted(const Channels& noted) {
  return !noted.input_names.empty() || !noted.output_names.empty() || !noted.input_units.empty() ||
         !noted.output_units.empty();
}

}  // namespace

bool is_reserved(const std::string& name) {
  return name == "k" || canonical(name) == "experiment" || canonical(name) == "time";
}

Names Header::titles() const {
  Names titles;
  for (const Column& column : columns_) titles.push_back(column.title);
  return titles;
}

std::string Header::place() const { return fmt::format("; line {} was taken for the header", line_); }

Header::Header(std::vector<Column> columns, Index line) : columns_(std::move(columns)), line_(line) {
  for (size_t c = 0; c < columns_.size(); ++c) {
    by_title_[canonical(columns_[c].title)].push_back(c);
    by_name_[columns_[c].label.name].push_back(c);
  }
}

std::optional<size_t> Header::only(const Places& places, const std::string& key, const std::string& name) {
  const auto found = places.find(key);
  if (found == places.end()) return std::nullopt;
  if (found->second.size() > 1) fail("header: {} columns '{}' found, one needed", found->second.size(), name);
  return found->second.front();
}

std::optional<size_t> Header::find(const std::string& name) const {
  if (const auto column = only(by_title_, canonical(name), name)) return column;
  if (const auto column = only(by_name_, name, name)) return column;
  const Label wanted = label_from(name);
  if (wanted.unit.empty()) return std::nullopt;
  const auto other = only(by_name_, wanted.name, name);
  if (other && columns_[*other].label.unit != wanted.unit)
    fail("column '{}' found, '{}' needed: the units differ", columns_[*other].title, name);
  return other;
}

size_t Header::need(const std::string& name) const {
  const auto column = find(name);
  if (!column) fail("no column '{}' found among {}{}", name, quoted(titles()), place());
  return *column;
}

Names titles_of(const Header& header, const std::vector<size_t>& columns) {
  Names titles;
  for (const size_t c : columns) titles.push_back(header[c].title);
  return titles;
}

Chosen chosen_columns(const Header& header, const Wanted& wanted) {
  const Names& inputs = names_to_read(header, wanted.inputs, wanted.noted.input_names, wanted.model.input_names);
  const Names& outputs = names_to_read(header, wanted.outputs, wanted.noted.output_names, wanted.model.output_names);
  Chosen chosen;
  chosen.experiment = experiment_column(header, wanted);
  const std::vector<size_t> taken = taken_by(chosen.experiment);
  chosen.inputs = named_columns(header, inputs);
  chosen.outputs = named_columns(header, outputs);
  for (const auto* columns : {&chosen.inputs, &chosen.outputs})
    if (chosen.experiment && contains_column(*columns, *chosen.experiment))
      fail("column '{}' is stated as names of experiments and as a channel; one of the two needed",
           header[*chosen.experiment].title);
  if (inputs.empty()) chosen.inputs = prefixed_columns(header, 'u', columns_and(chosen.outputs, taken));
  if (outputs.empty()) chosen.outputs = prefixed_columns(header, 'y', columns_and(chosen.inputs, taken));
  for (const size_t c : chosen.inputs)
    if (contains_column(chosen.outputs, c))
      fail("column '{}' is listed both as an input and as an output. List it only once", header[c].title);
  constexpr auto how = "state which columns are channels: --inputs 'A,B' --outputs 'C,D'";
  if (chosen.inputs.empty())
    fail("no column whose name begins with u found among {}; name the inputs; {}{}", quoted(header.titles()), how,
         header.place());
  if (chosen.outputs.empty() && wanted.outputs_required)
    fail("no column whose name begins with y found among {}; name the outputs; {}{}", quoted(header.titles()), how,
         header.place());
  find_steps(header, wanted.time, wanted.noted, chosen);
  return chosen;
}

Channels channels_of(const Header& header, const Chosen& chosen, const Wanted& wanted) {
  const Channels& noted = wanted.noted;
  Channels result;
  if (is_noted(noted)) {
    std::vector<size_t> inputs = named_columns(header, noted.input_names),
                        outputs = named_columns(header, noted.output_names);
    const std::vector<size_t> taken = taken_by(chosen.experiment);
    if (inputs.empty()) inputs = prefixed_columns(header, 'u', columns_and(outputs, taken));
    if (outputs.empty()) outputs = prefixed_columns(header, 'y', columns_and(inputs, taken));
    std::map<std::string, std::string> units;
    add_units(titles_of(header, inputs), noted.input_units, "input_units", units);
    add_units(titles_of(header, outputs), noted.output_units, "output_units", units);
    const auto described = [&](const std::vector<size_t>& columns, Names& names, Names& own_units) {
      names = titles_of(header, columns);
      bool any = false;
      for (const std::string& name : names) {
        const auto unit = units.find(name);
        own_units.push_back(unit == units.end() ? "" : unit->second);
        any = any || unit != units.end();
      }
      if (!any) own_units.clear();
    };
    described(chosen.inputs, result.input_names, result.input_units);
    described(chosen.outputs, result.output_names, result.output_units);
  } else {
    // A model of earlier data may have a whole title as the name of a channel. Two columns may differ in their unit
    // alone.
    std::map<std::string, int> count;
    for (const auto* columns : {&chosen.inputs, &chosen.outputs})
      for (const size_t c : *columns) ++count[header[c].label.name];
    const auto described = [&](const std::vector<size_t>& columns, const Names& model, Names& names, Names& units) {
      bool any = false;
      for (const size_t c : columns) {
        const Column& column = header[c];
        const bool whole = count[column.label.name] > 1 || contains(model, column.title);
        names.push_back(whole ? column.title : column.label.name);
        units.push_back(whole && column.title != column.label.name ? "" : column.label.unit);
        any = any || !units.back().empty();
      }
      if (!any) units.clear();
    };
    described(chosen.inputs, wanted.model.input_names, result.input_names, result.input_units);
    described(chosen.outputs, wanted.model.output_names, result.output_names, result.output_units);
  }
  result.input_names = names_unless_default(result.input_names, 'u', !noted.input_names.empty());
  result.output_names = names_unless_default(result.output_names, 'y', !noted.output_names.empty());
  return result;
}

std::vector<size_t> unused_columns(const Header& header, const Chosen& chosen, const std::vector<size_t>& read) {
  std::vector<size_t> used = read;
  used.insert(used.end(), chosen.inputs.begin(), chosen.inputs.end());
  used.insert(used.end(), chosen.outputs.begin(), chosen.outputs.end());
  for (const auto& column : {chosen.experiment, chosen.time ? chosen.time : chosen.step, chosen.date})
    if (column) used.push_back(*column);
  std::vector<size_t> unused;
  for (size_t c = 0; c < header.columns().size(); ++c)
    if (!contains_column(used, c)) unused.push_back(c);
  return unused;
}

bool may_name_experiments(const std::string& name) {
  static const Names words{"experiment", "exp",        "run",     "batch",    "trial",    "test",
                           "campaign",   "repetition", "rep",     "cycle",    "versuch",  "charge",
                           "kampagne",   "lauf",       "messung", "zyklus",   "essai",    "lot",
                           "shot",       "session",    "flight",  "maneuver", "manoeuvre"};
  static const Names ends{"", "s", "id", "no", "no.", "nr", "nr.", "number", "name", "index", "num", "nummer"};
  std::string text = in_lower_case(name);
  text.erase(std::remove_if(text.begin(), text.end(), [](char c) { return c == ' ' || c == '_' || c == '-'; }),
             text.end());
  return std::any_of(words.begin(), words.end(), [&](const std::string& word) {
    return text.starts_with(word) && contains(ends, text.substr(word.size()));
  });
}

std::optional<std::string> remark_on_unused_columns(const Header& header, const Chosen& chosen,
                                                    const std::vector<size_t>& read) {
  Names unused;
  for (const size_t c : unused_columns(header, chosen, read))
    unused.push_back(header[c].title.empty() ? fmt::format("number {}, without a name", c + 1) : header[c].title);
  return remark_on_unused(unused);
}

}  // namespace tokid::io
