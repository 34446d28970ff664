// Reads .csv files as people have them: one ensemble from one table, or from many tables with an experiment each.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "base/nan.hpp"
#include "base/words.hpp"
#include "io/formats/csv_table.hpp"
#include "io/formats/formats.hpp"
#include "io/formats/records.hpp"
#include "io/formats/trigger.hpp"
#include "io/guard/descriptor.hpp"
#include "io/naming.hpp"

namespace tokid::io {

void check_options(const ReadOptions& options) {
  if (!options.trigger.empty()) Trigger trigger(options.trigger);
  const auto refuse = [](const char* name, const auto& found, const char* needed) {
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed", name, found, needed));
  };
  if (options.before < 0) refuse("before", options.before, "a number of steps from 0 on");
  if (options.before > 0 && options.trigger.empty())
    throw std::invalid_argument("before: no trigger found. Steps before the trigger can be kept only with a trigger");
  if (!options.held.empty() && !options.resample)
    throw std::invalid_argument("held: no resample found. Channels can be held only by resampling");
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

// One remark on all files without a final line break.
std::string remark_on_ends(const std::vector<std::pair<std::string, std::string>>& cut) {
  const std::string first = fmt::format("'{}': {}", cut.front().first, cut.front().second);
  if (cut.size() == 1) return first;
  return fmt::format("{}; {} more {} without a line break", first, cut.size() - 1,
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

// Aligns, resamples and assembles the rows. `start`: a remark on the times at which the experiments begin.
Ensemble ensemble_of(Table table, const ReadOptions& options, bool many, std::optional<std::string>& start) {
  const bool aligned = !options.trigger.empty();
  Records& records = table.records;
  if (aligned)
    align(options.trigger, Index(options.before), records);
  else if (many || table.stamped)
    start = begin_together(records);
  if (options.resample)
    resample({*options.resample, options.resample_method, longest_gap(options),
              options.longest_gap ? std::optional(Index(*options.longest_gap)) : std::nullopt},
             aligned, records);
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
  Table table = read_table(path, options, nullptr);
  Names remarks = table.remarks;
  if (table.cut) remarks.push_back(*table.cut);
  if (!table.guesses.empty()) remarks.push_back(remark_on_guesses(table.guesses));
  const std::vector<Index> length = table.length;
  const bool changed = !options.trigger.empty() || options.resample.has_value();
  if (!changed) check_length(table);
  std::optional<std::string> start;
  Ensemble e = ensemble_of(std::move(table), options, false, start);
  if (start) remarks.insert(remarks.begin(), *std::move(start));
  if (!changed && !length.empty()) {
    e.length = length;
    for (size_t n = 0; n < length.size(); ++n)
      for (Index k = std::max(length[n], Index{0}); k < e.steps(); ++k) {
        e.input(k).row(Index(n)).setConstant(nan);
        e.output(k).row(Index(n)).setConstant(nan);
      }
  }
  e.check(options.outputs_required);
  e.remarks.insert(e.remarks.begin(), remarks.begin(), remarks.end());
  return e;
}

Ensemble read_csv(const std::vector<std::filesystem::path>& paths, const ReadOptions& options) {
  const Names labels = labels_of(paths);
  Table all;
  FirstTable first;
  Remarks starts, remarks;
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
      starts.add(file, table.stamped && options.trigger.empty()
                           ? Names{"the time stamps count from the first row of each file. Use --trigger if an event "
                                   "aligns the files"}
                           : Names{});
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
  std::optional<std::string> start;
  Ensemble e = ensemble_of(std::move(all), options, true, start);
  if (!changed && std::any_of(noted.begin(), noted.end(), [](Index length) { return length >= 0; }))
    apply_noted_lengths(noted, e);
  e.check(options.outputs_required);
  // Without a trigger, the begins of the experiments may be wrong. This matters most, so it is the first remark.
  Names texts = starts.take();
  if (start) texts.push_back(*std::move(start));
  for (std::string& text : remarks.take()) texts.push_back(std::move(text));
  if (!cut.empty()) texts.push_back(remark_on_ends(cut));
  if (!guesses.empty()) texts.push_back(remark_on_guesses(guesses));
  e.remarks.insert(e.remarks.begin(), texts.begin(), texts.end());
  return e;
}

}  // namespace tokid::io
