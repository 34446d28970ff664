// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/csv_columns.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "io/text.hpp"

namespace tokid::io {

namespace {

// 1 for these columns, 0 for the others.
std::vector<char> marks(const Names& header, const std::vector<size_t>& columns) {
  std::vector<char> result(header.size(), 0);
  for (const size_t c : columns) result[c] = 1;
  return result;
}

size_t column_of(const Names& header, const std::string& name) {
  const auto found = std::find(header.begin(), header.end(), name);
  if (found == header.end()) fail("no column '{}' found among {}", name, quoted(header));
  return size_t(found - header.begin());
}

// "Experiment" and "Time" may have capital letters.
std::optional<size_t> reserved_column(const Names& header, const std::string& name) {
  for (size_t c = 0; c < header.size(); ++c)
    if (header[c] == name || (name != "k" && in_lower_case(header[c]) == name)) return c;
  return std::nullopt;
}

std::vector<size_t> named(const Names& header, const Names& names) {
  std::vector<size_t> columns;
  for (const std::string& name : names) columns.push_back(column_of(header, name));
  return columns;
}

std::vector<size_t> prefixed(const Names& header, char prefix, const std::vector<size_t>& taken) {
  const std::vector<char> is_taken = marks(header, taken);
  std::vector<size_t> columns;
  for (size_t c = 0; c < header.size(); ++c)
    if (header[c].starts_with(prefix) && !is_reserved(header[c]) && !is_taken[c]) columns.push_back(c);
  return columns;
}

const Names& names_to_read(const Names& header, const Names& stated, const Names& noted, const Names& wanted) {
  if (!stated.empty() || !noted.empty()) return stated.empty() ? noted : stated;
  const std::set<std::string> found(header.begin(), header.end());
  const bool has_all =
      std::all_of(wanted.begin(), wanted.end(), [&](const auto& name) { return found.contains(name); });
  return has_all ? wanted : noted;
}

std::map<std::string, std::string> units_by_name(const Names& names, const Names& units, const char* key) {
  std::map<std::string, std::string> result;
  if (units.empty()) return result;
  if (units.size() != names.size())
    fail("{}: {} units found for {} channels, one unit for each channel needed", key, units.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) result[names[i]] = units[i];
  return result;
}

void check_distinct(Names header) {
  std::sort(header.begin(), header.end());
  if (header.front().empty()) fail("header: a column without a name found, a name needed");
  const auto twice = std::adjacent_find(header.begin(), header.end());
  if (twice != header.end()) fail("header: two columns '{}' found, one needed", *twice);
}

Names titles_of(const Names& header, const std::vector<size_t>& columns) {
  Names titles;
  for (const size_t c : columns) titles.push_back(header[c]);
  return titles;
}

// Default names are dropped, unless the comments of the file state them.
void describe(Names titles, const std::map<std::string, std::string>& units, char prefix, bool noted, Names& names,
              Names& own_units) {
  bool is_default = true, has_units = false;
  for (size_t i = 0; i < titles.size(); ++i) {
    is_default = is_default && titles[i] == fmt::format("{}{}", prefix, i + 1);
    const auto unit = units.find(titles[i]);
    has_units = has_units || unit != units.end();
    own_units.push_back(unit == units.end() ? "" : unit->second);
  }
  if (!has_units) own_units.clear();
  if (noted || !is_default) names = std::move(titles);
}

}  // namespace

bool is_reserved(const std::string& name) {
  return name == "k" || in_lower_case(name) == "experiment" || in_lower_case(name) == "time";
}

CsvColumns csv_columns(const Names& header, const Notes& notes, const ReadOptions& options) {
  check_distinct(header);
  const Channels &noted = notes.channels, &wanted = options.wanted;
  const Names& inputs = names_to_read(header, options.inputs, noted.input_names, wanted.input_names);
  const Names& outputs = names_to_read(header, options.outputs, noted.output_names, wanted.output_names);
  CsvColumns chosen;
  chosen.inputs = named(header, inputs), chosen.outputs = named(header, outputs);
  if (inputs.empty()) chosen.inputs = prefixed(header, 'u', chosen.outputs);
  if (outputs.empty()) chosen.outputs = prefixed(header, 'y', chosen.inputs);
  std::vector<char> used = marks(header, chosen.outputs);
  for (const size_t c : chosen.inputs) {
    if (used[c]) fail("column '{}' is listed both as an input and as an output. List it only once", header[c]);
    used[c] = 1;
  }
  const auto check_found = [&](const std::vector<size_t>& columns, const char* channels, char prefix) {
    if (columns.empty())
      fail(
          "no column whose name begins with {} found among {}; name the {}s: state which columns are channels: --inputs "
          "'A,B' --outputs 'C,D'",
          prefix, quoted(header), channels);
  };
  check_found(chosen.inputs, "input", 'u');
  if (options.outputs_required) check_found(chosen.outputs, "output", 'y');
  const auto other = [&](const char* name) {
    const std::optional<size_t> c = reserved_column(header, name);
    if (!c || used[*c]) return std::optional<size_t>();
    used[*c] = 1;
    return c;
  };
  chosen.experiment = other("experiment"), chosen.time = other("time");
  if (!chosen.time) chosen.step = other("k");
  for (size_t c = 0; c < header.size(); ++c)
    if (!used[c]) chosen.unused.push_back(header[c]);
  return chosen;
}

Channels csv_channels(const Names& header, const Notes& notes, const CsvColumns& columns) {
  const Channels& noted = notes.channels;
  const auto names = [&](const Names& stated, char prefix, const Names& others) {
    return stated.empty() ? titles_of(header, prefixed(header, prefix, named(header, others))) : stated;
  };
  const Names inputs = names(noted.input_names, 'u', noted.output_names),
              outputs = names(noted.output_names, 'y', noted.input_names);
  Channels result;
  describe(titles_of(header, columns.inputs), units_by_name(inputs, noted.input_units, "input_units"), 'u',
           !noted.input_names.empty(), result.input_names, result.input_units);
  describe(titles_of(header, columns.outputs), units_by_name(outputs, noted.output_units, "output_units"), 'y',
           !noted.output_names.empty(), result.output_names, result.output_units);
  return result;
}

}  // namespace tokid::io
