// Writes an ensemble as a tidy .csv: a row for each experiment and step, a column for each channel. Comments before the
// header contain all other information.
// SPDX-License-Identifier: BSD-3-Clause
#include <csv.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/json.hpp"
#include "io/formats/csv_columns.hpp"
#include "io/formats/csv_lines.hpp"
#include "io/formats/formats.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/guard/text_checksum.hpp"
#include "io/text.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

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
  const bool plain = cell.size() == text.size() + 2 && !text.empty() && text == stripped(text) &&
                     text.find_first_of(",;\t\r\n#") == std::string::npos;
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
