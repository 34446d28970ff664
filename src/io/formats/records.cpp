// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/records.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include "base/statistics.hpp"
#include "base/words.hpp"
#include "io/guard/claims.hpp"

namespace tokid::io {

namespace {

constexpr double no_sample = std::numeric_limits<double>::quiet_NaN();
constexpr double infinite = std::numeric_limits<double>::infinity();

// The first and the last time of each experiment.
struct Spans {
  std::vector<double> first, last;

  double latest_begin() const { return *std::max_element(first.begin(), first.end()); }
  double earliest_begin() const { return *std::min_element(first.begin(), first.end()); }
  // The time that all experiments have in common; < 0 if there is none.
  double common() const { return *std::min_element(last.begin(), last.end()) - latest_begin(); }
  double shortest() const {
    double length = infinite;
    for (size_t n = 0; n < first.size(); ++n) length = std::min(length, last[n] - first[n]);
    return length;
  }
};

Spans spans_of(const TimeColumn& rows) {
  Spans spans{std::vector<double>(rows.experiments.size(), infinite),
              std::vector<double>(rows.experiments.size(), -infinite)};
  for (size_t i = 0; i < rows.time.size(); ++i) {
    double &first = spans.first[size_t(rows.experiment[i])], &last = spans.last[size_t(rows.experiment[i])];
    first = std::min(first, rows.time[i]), last = std::max(last, rows.time[i]);
  }
  return spans;
}

// Subtracts a time of each experiment.
void move_times(const std::vector<double>& by, TimeColumn& rows) {
  for (size_t i = 0; i < rows.time.size(); ++i) {
    rows.largest = std::max(rows.largest, std::abs(rows.time[i]));
    rows.time[i] -= by[size_t(rows.experiment[i])];
  }
}

// Keeps the experiments in `kept`, in their order, with all their rows.
void keep(const std::vector<bool>& kept, Records& records) {
  std::vector<Index> number(kept.size(), -1);
  Names experiments, files;
  for (size_t n = 0; n < kept.size(); ++n) {
    if (!kept[n]) continue;
    number[n] = Index(experiments.size());
    experiments.push_back(records.rows.experiments[n]);
    if (!records.rows.files.empty()) files.push_back(records.rows.files[n]);
  }
  TimeColumn& rows = records.rows;
  size_t to = 0;
  const size_t channels = records.channels();
  for (size_t i = 0; i < rows.time.size(); ++i) {
    const Index n = number[size_t(rows.experiment[i])];
    if (n < 0) continue;
    rows.time[to] = rows.time[i], rows.experiment[to] = n, rows.line[to] = rows.line[i];
    std::copy_n(records.samples.begin() + std::ptrdiff_t(i * channels), channels,
                records.samples.begin() + std::ptrdiff_t(to * channels));
    ++to;
  }
  rows.time.resize(to), rows.experiment.resize(to), rows.line.resize(to);
  records.samples.resize(to * channels);
  rows.experiments = std::move(experiments), rows.files = std::move(files);
}

std::string some_of(const Names& names) {
  constexpr size_t most = 5;
  const Names first(names.begin(), names.begin() + std::ptrdiff_t(std::min(most, names.size())));
  return names.size() > most ? fmt::format("{} and {} more", quoted(first), names.size() - most) : quoted(first);
}

// The rows of each experiment, in the order of their times.
std::vector<std::vector<size_t>> rows_in_order(const TimeColumn& rows) {
  std::vector<std::vector<size_t>> order(rows.experiments.size());
  for (size_t i = 0; i < rows.time.size(); ++i) order[size_t(rows.experiment[i])].push_back(i);
  for (std::vector<size_t>& own : order)
    std::stable_sort(own.begin(), own.end(), [&](size_t a, size_t b) { return rows.time[a] < rows.time[b]; });
  return order;
}

// ---- triggers ----

// When the trigger first holds in an experiment, and when it first begins to hold.
struct Onset {
  std::optional<double> first, change;
  bool from_first_row = false;

  std::optional<double> time() const { return change ? change : first; }
};

Onset onset_of(const Records& records, const std::vector<size_t>& order) {
  Onset onset;
  Event last = Event::unknown;
  for (const size_t i : order) {
    const Event now = records.event[i];
    if (now == Event::unknown) continue;
    if (now == Event::holds && !onset.first)
      onset.first = records.rows.time[i], onset.from_first_row = last == Event::unknown;
    if (now == Event::holds && last == Event::fails && !onset.change) onset.change = records.rows.time[i];
    last = now;
  }
  return onset;
}

// The files or, without files, the experiments for which `flagged` is true.
struct Parts {
  Names flagged;
  size_t all = 0;
  bool are_files = false;

  bool is_all() const { return flagged.size() == all; }
  // "'a.csv' and 5 more: ", the begin of a remark on them; empty if these are all parts
  std::string begin() const {
    if (is_all() || flagged.empty()) return "";
    const std::string more = flagged.size() > 1 ? fmt::format(" and {} more", flagged.size() - 1) : "";
    return fmt::format("{}'{}'{}: ", are_files ? "" : "experiment ", flagged.front(), more);
  }
};

Parts parts_of(const TimeColumn& rows, const std::vector<bool>& flagged) {
  Parts parts;
  parts.are_files = !rows.files.empty();
  const Names& names = parts.are_files ? rows.files : rows.experiments;
  bool counted = false;  // the file of the experiment is among the flagged ones
  for (size_t n = 0; n < names.size(); ++n) {
    // The experiments of a file stand together, and files of different folders may have equal names.
    const bool is_new = n == 0 || !parts.are_files || names[n] != names[n - 1];
    if (is_new) ++parts.all, counted = false;
    if (flagged[n] && !counted) parts.flagged.push_back(names[n]), counted = true;
  }
  return parts;
}

std::string experiments_named(const Names& names) {
  return fmt::format("{} {}", names.size() == 1 ? "experiment" : "experiments", some_of(names));
}

// ---- resampling ----

// One channel of one experiment: its samples that are not missing, in the order of time.
struct Signal {
  std::vector<double> time, value;
};

// Samples at the same time become one: the last of them if the channel holds its values, and else their mean.
Signal signal_of(const Records& records, const std::vector<size_t>& order, size_t channel, bool held) {
  Signal s;
  size_t same = 1;
  for (const size_t i : order) {
    const double time = records.rows.time[i], value = records.samples[i * records.channels() + channel];
    if (std::isnan(value)) continue;
    if (!s.time.empty() && s.time.back() == time) {
      s.value.back() = held ? value : s.value.back() + (value - s.value.back()) / double(++same);
      continue;
    }
    same = 1;
    s.time.push_back(time), s.value.push_back(value);
  }
  return s;
}

// How a channel is resampled, in the unit of the times.
struct Filling {
  ResampleMethod method = ResampleMethod::linear;
  double dt = 1.0, longest = infinite;  // the grid, and the longest gap that is filled
  double slack = 0.0;                   // times that differ by less are the same, because they are rounded
};

// A sample of the grid. `age`: the time since the sample that it repeats.
struct Filled {
  double value = no_sample, age = 0.0;
  bool in_gap = false;   // missing because of a long gap; else because its channel has no sample before it or after it
  bool between = false;  // interpolated between two different samples
};

Filled average(const Signal& s, double time, const Filling& filling) {
  const auto begin = std::lower_bound(s.time.begin(), s.time.end(), time - 0.5 * filling.dt - filling.slack);
  const auto end = std::lower_bound(begin, s.time.end(), time + 0.5 * filling.dt - filling.slack);
  if (begin == end) return {no_sample, 0.0, begin != s.time.begin() && end != s.time.end()};
  const auto value = s.value.begin() + (begin - s.time.begin());
  return {std::accumulate(value, value + (end - begin), 0.0) / double(end - begin)};
}

// The time is at most that of the last row of the experiment, up to which the method previous holds the last sample.
Filled at(const Signal& s, double time, const Filling& filling) {
  if (s.time.empty()) return {};
  if (filling.method == ResampleMethod::mean) return average(s, time, filling);
  const auto after = std::upper_bound(s.time.begin(), s.time.end(), time + filling.slack);
  if (after == s.time.begin()) return {};
  const size_t i = size_t(after - s.time.begin()) - 1;
  const double age = std::max(time - s.time[i], 0.0);
  if (age <= filling.slack) return {s.value[i]};
  const bool hold = filling.method == ResampleMethod::previous;
  if (after == s.time.end() && !hold) return {};
  if ((after == s.time.end() ? age : *after - s.time[i]) > filling.longest + filling.slack)
    return {no_sample, 0.0, true};
  if (hold) return {s.value[i], age};
  const double share = (time - s.time[i]) / (*after - s.time[i]);
  return {(1.0 - share) * s.value[i] + share * s.value[i + 1], 0.0, false, s.value[i] != s.value[i + 1]};
}

// What the method does to noise that is independent from sample to sample. `oldest`: age of the oldest repeated sample.
std::string effect_on_noise(ResampleMethod method, double dt, double usual, double oldest) {
  const double samples = dt / usual;
  switch (method) {
    case ResampleMethod::linear:
      return samples < 1.5 ? "interpolation makes the noise of neighbouring steps correlated, and smaller between two "
                             "samples. Bounds and tests of whiteness are therefore too optimistic"
                           : fmt::format(
                                 "interpolation uses only two of about {:.0f} samples in each step, so frequencies "
                                 "above {:.4g} Hz appear as lower frequencies (aliasing). Use the method mean, which "
                                 "averages the samples",
                                 samples, 0.5 / dt);
    case ResampleMethod::mean:
      return samples < 1.5
                 ? "most averages contain one sample or none. A longer sample time or another method is better"
                 : fmt::format(
                       "averages of about {:.0f} samples reduce the standard deviation of the noise to {:.2g} of "
                       "its value, and also average fast motion of the system",
                       samples, 1.0 / std::sqrt(samples));
    default:
      return fmt::format("samples are up to {:.4g} s old{}", oldest,
                         samples < 1.0
                             ? " and repeated, so neighbouring steps have the same noise, and tests of whiteness are "
                               "too optimistic"
                             : "");
  }
}

const char* name_of(ResampleMethod method) {
  return method == ResampleMethod::linear ? "linear" : method == ResampleMethod::mean ? "mean" : "previous";
}

// ---- steps ----

struct Steps {
  Grid grid;
  std::optional<std::string> remark;  // on times that were moved
  double origin = 0.0;                // step of the grid that is step 0 of the ensemble
  Index count = 1;
};

// The grid to whose steps the times are moved, and a remark where they are moved farther than by rounding.
void move_to_grid(const TimeColumn& rows, double dt, Steps& steps) {
  const MovedGrid moved = moved_grid(rows, dt);
  steps.grid = moved.grid;
  constexpr double unnoticed = 1e-6;  // of a step, as time_grid() permits
  const auto [first, last] = std::minmax_element(rows.time.begin(), rows.time.end());
  const double rounding = rows.precision.unit(std::max(std::abs(*first), std::abs(*last)));
  if (moved.largest > std::max(unnoticed * moved.grid.dt, rounding))
    steps.remark = fmt::format("times were moved by up to {:.3g} s to even steps of {} s, as the option dt states",
                               rows.unit.in_seconds(moved.largest), dt);
}

Steps steps_of(const Records& records, const Assembly& choice) {
  const auto [first, last] = std::minmax_element(records.rows.time.begin(), records.rows.time.end());
  if (choice.dt && (!(*choice.dt > 0) || !std::isfinite(*choice.dt)))
    fail("dt: {} found, a positive time in seconds needed", *choice.dt);
  // Step numbers that continue from one experiment to the next probably count rows. Only a column named "k" is trusted.
  if (!records.doubt.empty())
    check_common_steps(
        records.rows,
        "step numbers that count from the begin of each experiment needed, or the name 'k' for this column");
  Steps result;
  if (records.source == StepSource::times && choice.moved && choice.dt)
    move_to_grid(records.rows, *choice.dt, result);
  else
    result.grid = records.source == StepSource::times ? time_grid(records.rows, choice.dt) : Grid{*first, 1.0};
  if (choice.before) result.origin = result.grid.step(0.0) - double(*choice.before);
  const double steps = result.grid.step(*last) - result.origin + 1, rows = double(records.rows.time.size());
  const size_t experiments = records.rows.experiments.size();
  // Without this limit, one wrong time or step number could take far more memory than the number of rows justifies.
  const double channels = double(records.channels());
  const double samples = steps * double(experiments) * channels;
  if (!(samples <= 1e6 + 1000 * rows * channels))
    fail(
        "{} experiments of {} steps found in only {} rows, so most rows would be missing. Check the times or step numbers",
        experiments, steps, rows);
  if (!(samples * sizeof(double) <= double(memory_limit())))
    fail("{} experiments of {} steps with {} channels found, which need {} bytes of memory, but this machine has {}",
         experiments, steps, channels, samples * sizeof(double), memory_limit());
  result.count = Index(steps);
  return result;
}

// A table with one experiment may have no name for it.
std::string of_experiment(const std::string& name) {
  return name.empty() ? std::string() : fmt::format(" of experiment '{}'", name);
}

void fill(const Records& records, const Steps& steps, Ensemble& e, std::vector<Index>& length) {
  std::vector<bool> seen(size_t(e.experiments() * e.steps()));
  for (size_t i = 0; i < records.rows.time.size(); ++i) {
    const Index n = records.rows.experiment[i], k = Index(steps.grid.step(records.rows.time[i]) - steps.origin);
    if (k < 0) continue;  // before the steps that are kept
    auto cell = seen[size_t(n * e.steps() + k)];
    if (cell)
      fail("{}: a second row for step {}{} found, one needed{}", place(records.rows, i), k,
           of_experiment(records.rows.experiments[size_t(n)]), records.advice.empty() ? records.doubt : records.advice);
    cell = true;
    length[size_t(n)] = std::max(length[size_t(n)], k + 1);
    const double* sample = records.samples.data() + i * records.channels();
    for (Index j = 0; j < e.inputs(); ++j) e.u(n, k, j) = *sample++;
    for (Index j = 0; j < e.outputs(); ++j) e.y(n, k, j) = *sample++;
  }
}

// Steps without any row may be intended, or the column may not contain step numbers.
std::optional<std::string> remark_on_empty_steps(const Records& records, const Steps& steps) {
  if (records.source != StepSource::numbers) return std::nullopt;
  std::int64_t common = 0;
  for (const double number : records.rows.time) common = std::gcd(common, std::int64_t(steps.grid.step(number)));
  if (common < 2) return std::nullopt;
  return fmt::format(
      "column '{0}': all step numbers are {1} or multiples of {1} apart, so the {2} steps between count as missing. Divide "
      "the numbers by {1} where no step is missing",
      records.rows.name, common, common - 1);
}

}  // namespace

void append(const Records& more, Records& to) {
  const Index experiments = Index(to.rows.experiments.size());
  const TimeUnit &from_unit = more.rows.unit, &to_unit = to.rows.unit;
  const bool same_unit = from_unit.seconds == to_unit.seconds && from_unit.over == to_unit.over;
  for (const double time : more.rows.time)
    to.rows.time.push_back(same_unit ? time : to_unit.from_seconds(from_unit.in_seconds(time)));
  for (const Index n : more.rows.experiment) to.rows.experiment.push_back(experiments + n);
  to.rows.line.insert(to.rows.line.end(), more.rows.line.begin(), more.rows.line.end());
  to.rows.experiments.insert(to.rows.experiments.end(), more.rows.experiments.begin(), more.rows.experiments.end());
  to.rows.files.insert(to.rows.files.end(), more.rows.files.begin(), more.rows.files.end());
  if (same_unit) {
    to.rows.precision.add(more.rows.precision);
  } else {
    for (size_t i = to.rows.time.size() - more.rows.time.size(); i < to.rows.time.size(); ++i)
      to.rows.precision.add(fmt::format("{}", to.rows.time[i]), to.rows.time[i]);
  }
  to.samples.insert(to.samples.end(), more.samples.begin(), more.samples.end());
  to.event.insert(to.event.end(), more.event.begin(), more.event.end());
  to.trigger_values.add(more.trigger_values);
  if (to.advice.empty()) to.advice = more.advice;
}

std::optional<std::string> begin_together(Records& records) {
  TimeColumn& rows = records.rows;
  if (rows.time.empty()) return std::nullopt;
  const Spans spans = spans_of(rows);
  const double apart = spans.latest_begin() - spans.earliest_begin();
  if (!(apart > 0)) return std::nullopt;
  constexpr double most = 0.5;  // of the shortest experiment
  constexpr auto trigger = "Use --trigger if an event aligns them";
  const bool timed = records.source == StepSource::times;
  if (spans.common() >= most * spans.shortest())
    return fmt::format(
        "the {} of all experiments were read as readings of one clock, on which the experiments begin up to {:.6g}{} "
        "apart. {}",
        timed ? "times" : "step numbers", timed ? rows.unit.in_seconds(apart) : apart, timed ? " s" : " steps",
        trigger);
  move_times(spans.first, rows);
  return fmt::format(
      "the {} of the experiments have {} in common, so tokid lets each experiment begin at its first row. "
      "{}",
      timed ? "times" : "step numbers", spans.common() < 0 ? "nothing" : "less than half of the shortest experiment",
      trigger);
}

void align(const std::string& trigger, Index before, Records& records) {
  TimeColumn& rows = records.rows;
  std::vector<Onset> onsets;
  for (const std::vector<size_t>& own : rows_in_order(rows)) onsets.push_back(onset_of(records, own));
  std::vector<bool> kept;
  Names without, begun, again;
  bool none_before = true;  // no rows before the first row at which the trigger is known, in `begun`
  const Spans spans = spans_of(rows);
  for (size_t n = 0; n < onsets.size(); ++n) {
    kept.push_back(onsets[n].time().has_value());
    if (!kept.back()) without.push_back(rows.experiments[n]);
    if (onsets[n].from_first_row) (onsets[n].change ? again : begun).push_back(rows.experiments[n]);
    if (onsets[n].from_first_row && !onsets[n].change) none_before = none_before && *onsets[n].first <= spans.first[n];
  }
  if (without.size() == onsets.size())
    fail(
        "trigger '{}': it holds at no row of any experiment; the column has {}, a condition that holds somewhere needed",
        trigger, records.trigger_values.described());
  std::vector<double> begin;
  for (const Onset& onset : onsets) begin.push_back(onset.time().value_or(0.0));
  move_times(begin, rows);
  records.event.clear();
  if (!without.empty()) keep(kept, records);
  const auto remark = [&](const Names& names, const std::string& what) {
    if (!names.empty()) records.remarks.push_back(fmt::format("trigger '{}': this condition {}", trigger, what));
  };
  remark(without, fmt::format("never holds in {}, so {} dropped", experiments_named(without),
                              without.size() == 1 ? "this experiment was" : "these experiments were"));
  const std::string absent = before == 0 || !none_before ? ""
                             : before == 1               ? ", and step 0 is missing"
                                                         : fmt::format(", and steps 0 to {} are missing", before - 1);
  remark(begun, fmt::format(
                    "already holds at the first row of {}, so the event may be earlier. The first row became step {}{}",
                    experiments_named(begun), before, absent));
  remark(again,
         fmt::format(
             "already holds at the first row of {}. Step {} is the row at which the condition begins to hold again",
             experiments_named(again), before));
}

namespace {

// The median distance of successive rows in the experiments that `counted` states; 0 if there are none.
double usual_distance(const TimeColumn& rows, const std::vector<std::vector<size_t>>& order,
                      const std::vector<bool>& counted) {
  std::vector<double> distances;
  for (size_t n = 0; n < order.size(); ++n)
    for (size_t i = 1; counted[n] && i < order[n].size(); ++i)
      if (const double distance = rows.time[order[n][i]] - rows.time[order[n][i - 1]]; distance > 0)
        distances.push_back(distance);
  return distances.empty() ? 0.0 : statistics::median(std::move(distances));
}

struct FilledCount {
  Index in_gaps = 0, outside = 0;  // missing samples
  double oldest = 0.0;             // age of a repeated sample

  void add(const Filled& sample) {
    oldest = std::max(oldest, sample.age);
    if (std::isnan(sample.value)) ++(sample.in_gap ? in_gaps : outside);
  }
  void add(const FilledCount& more) {
    in_gaps += more.in_gaps, outside += more.outside, oldest = std::max(oldest, more.oldest);
  }
};

// How often a channel changes from one sample to the next, and how often its changes were interpolated.
struct ChangeCount {
  Index samples = 0, changes = 0, interpolated = 0;

  // Most samples of a switched channel repeat the sample before. Noise of a sensor changes nearly all samples.
  bool look_held() const { return interpolated > 0 && 20 * changes <= samples; }
};

// What resampling did to the samples.
struct Resampled {
  FilledCount free, held;            // of the channels that are not held, and of those that are
  std::vector<bool> changed;         // of each experiment: it has other samples than before
  std::vector<ChangeCount> changes;  // of each channel
  Index longest = 0;                 // largest number of steps of an experiment
};

bool is_held(const Records& records, size_t channel) { return !records.held.empty() && records.held[channel]; }

// Appends the samples of experiment n, whose rows are `order`, at the times begin + k dt within it.
void add_resampled(const Records& records, size_t n, const std::vector<size_t>& order, double begin,
                   const Filling& free, const Filling& held, Resampled& done, Records& to) {
  std::vector<Signal> signals;
  for (size_t c = 0; c < records.channels(); ++c) {
    const bool holds = is_held(records, c) || free.method == ResampleMethod::previous;
    signals.push_back(signal_of(records, order, c, holds));
    const std::vector<double>& value = signals.back().value;
    for (size_t i = 1; i < value.size(); ++i)
      ++done.changes[c].samples, done.changes[c].changes += value[i] != value[i - 1];
  }
  const TimeColumn& rows = records.rows;
  const double first = std::ceil((rows.time[order.front()] - begin - free.slack) / free.dt);
  const double last = std::floor((rows.time[order.back()] - begin + free.slack) / free.dt);
  const auto same = [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); };
  size_t on_grid = 0;
  bool changed = false;
  auto nearest = order.begin();
  for (double k = first; k <= last; ++k) {
    const double time = begin + k * free.dt;
    while (nearest + 1 != order.end() && rows.time[*(nearest + 1)] <= time + free.slack) ++nearest;
    const bool has_row = std::abs(rows.time[*nearest] - time) <= free.slack;
    on_grid += has_row ? 1 : 0;
    to.rows.time.push_back(k * free.dt);
    to.rows.experiment.push_back(Index(n));
    to.rows.line.push_back(rows.line[*nearest]);
    for (size_t c = 0; c < signals.size(); ++c) {
      const Filled sample = at(signals[c], time, is_held(records, c) ? held : free);
      to.samples.push_back(sample.value);
      (is_held(records, c) ? done.held : done.free).add(sample);
      if (sample.between) ++done.changes[c].interpolated;
      const double before = has_row ? records.samples[*nearest * records.channels() + c] : no_sample;
      changed = changed || !same(before, sample.value);
    }
  }
  done.changed[n] = changed || on_grid != order.size();
  done.longest = std::max(done.longest, Index(last - first + 1));
}

std::string on_missing(const FilledCount& count, double longest) {
  const auto stay = [](Index samples) { return samples == 1 ? "sample stays" : "samples stay"; };
  std::string text;
  if (count.in_gaps > 0)
    text += fmt::format(". {} {} missing, because their gap is longer than {:.4g} s", count.in_gaps,
                        stay(count.in_gaps), longest);
  if (count.outside > 0)
    text += fmt::format(". {} {} missing before the first or after the last sample of the channel", count.outside,
                        stay(count.outside));
  return text;
}

Names held_names(const Records& records) {
  Names names = records.inputs, result;
  names.insert(names.end(), records.outputs.begin(), records.outputs.end());
  for (size_t c = 0; c < names.size(); ++c)
    if (is_held(records, c)) result.push_back(names[c]);
  return result;
}

std::string remark_on_resampling(const Resampling& choice, const Records& records, double usual, const Filling& free,
                                 const Filling& held, const Resampled& done) {
  const TimeUnit& unit = records.rows.unit;
  const Parts parts = parts_of(records.rows, done.changed);
  if (parts.flagged.empty())
    return fmt::format("all samples already lie at even steps of {} s, so resampling changed nothing", choice.dt);
  std::string remark =
      fmt::format("{}the samples were resampled from about {:.4g} s to {} s by the method {}: {}", parts.begin(),
                  unit.in_seconds(usual), choice.dt, name_of(choice.method),
                  effect_on_noise(choice.method, choice.dt, usual > 0 ? unit.in_seconds(usual) : choice.dt,
                                  unit.in_seconds(done.free.oldest)));
  remark += on_missing(done.free, choice.method == ResampleMethod::mean ? choice.dt : unit.in_seconds(free.longest));
  if (const Names names = held_names(records); !names.empty())
    remark += fmt::format(". The held {} {} {} the last sample, which is up to {:.4g} s old{}",
                          names.size() == 1 ? "channel" : "channels", some_of(names),
                          names.size() == 1 ? "repeats" : "repeat", unit.in_seconds(done.held.oldest),
                          on_missing(done.held, unit.in_seconds(held.longest)));
  if (!parts.is_all())
    remark +=
        fmt::format(". The samples of the other {} already lie at these steps and stay as they are",
                    words::plural(Index(parts.all - parts.flagged.size()), parts.are_files ? "file" : "experiment"));
  return remark;
}

// Repeated times are an error without resampling, because each step has one row.
std::optional<std::string> remark_on_repeated_times(const Records& records,
                                                    const std::vector<std::vector<size_t>>& order,
                                                    ResampleMethod method) {
  const std::vector<double>& time = records.rows.time;
  std::vector<bool> flagged(order.size());
  Index repeated = 0;
  for (size_t n = 0; n < order.size(); ++n)
    for (size_t i = 1; i < order[n].size(); ++i)
      if (time[order[n][i]] == time[order[n][i - 1]]) ++repeated, flagged[n] = true;
  if (repeated == 0) return std::nullopt;
  const char* kept =
      method == ResampleMethod::previous ? "the last sample of each time was used"
      : held_names(records).empty()
          ? "the samples of each time were replaced by their mean"
          : "the samples of each time were replaced by their mean, and those of held channels by the last";
  return fmt::format(
      "{}{} {} the time of an earlier row, so {}. Check whether the times have lost digits, such as their seconds{}",
      parts_of(records.rows, flagged).begin(), words::plural(repeated, "row"), repeated == 1 ? "has" : "have", kept,
      records.advice);
}

// Much shorter steps than the distance of the samples make computations slower, and add nothing.
std::optional<std::string> remark_on_short_steps(double dt, double usual, Index steps) {
  constexpr double much = 10.0;
  if (usual < much * dt) return std::nullopt;
  return fmt::format(
      "the samples are about {:.4g} s apart, so most of the {} steps of {} s have no sample of their own. A sample time "
      "of about {:.4g} s is enough",
      usual, steps, dt, usual);
}

std::optional<std::string> remark_on_switches(const Records& records, const Resampled& done) {
  Names names = records.inputs, switched;
  names.insert(names.end(), records.outputs.begin(), records.outputs.end());
  for (size_t c = 0; c < names.size(); ++c)
    if (done.changes[c].look_held()) switched.push_back(names[c]);
  if (switched.empty()) return std::nullopt;
  const bool one = switched.size() == 1;
  return fmt::format(
      "{} {} {} at few samples, and these changes were interpolated. If {} until the next sample, state {} as held "
      "(option held)",
      one ? "channel" : "channels", some_of(switched), one ? "changes" : "change",
      one ? "it holds its value" : "they hold their values", one ? "it" : "them");
}

}  // namespace

void resample(const Resampling& stated, bool aligned, Records& records) {
  if (records.source != StepSource::times)
    fail("resample: no column of times found; a column of times, such as 't [s]', needed");
  if (!(stated.dt > 0) || !std::isfinite(stated.dt))
    fail("resample: {} found, a positive time in seconds needed", stated.dt);
  Resampling choice = stated;
  const bool all_held = !records.held.empty() && held_names(records).size() == records.channels();
  if (all_held) {
    choice.method = ResampleMethod::previous, choice.longest_gap = stated.longest_gap_of_held;
    records.held.clear();
  }
  const TimeColumn& rows = records.rows;
  const std::vector<std::vector<size_t>> order = rows_in_order(rows);
  const double dt = rows.unit.from_seconds(choice.dt);
  const double usual = usual_distance(rows, order, std::vector<bool>(order.size(), true));
  const auto filling = [&](ResampleMethod method, std::optional<Index> longest_gap) {
    const double longest = longest_gap ? double(*longest_gap) * std::max(dt, usual) : infinite;
    return Filling{method, dt, longest, 1e-6 * std::min(dt, usual > 0 ? usual : dt)};
  };
  const Filling free = filling(choice.method, choice.longest_gap);
  const Filling held = filling(ResampleMethod::previous, choice.longest_gap_of_held);
  const double begin = aligned ? 0.0 : *std::min_element(rows.time.begin(), rows.time.end());

  Records result = records;
  result.rows.time.clear(), result.rows.experiment.clear(), result.rows.line.clear(), result.samples.clear();
  result.rows.precision = {}, result.rows.largest = 0.0;
  const double total = (*std::max_element(rows.time.begin(), rows.time.end()) - begin) / dt;
  if (!(total * double(order.size() * records.channels()) * sizeof(double) <= 0.25 * double(memory_limit())))
    fail("resample: {} s found, which makes {:.4g} steps of each experiment, more than fit into memory", choice.dt,
         total);
  Resampled done;
  done.changed.resize(order.size()), done.changes.resize(records.channels());
  for (size_t n = 0; n < order.size(); ++n) add_resampled(records, n, order[n], begin, free, held, done, result);
  if (result.rows.time.empty())
    fail("resample: {} s found, but no experiment is as long; a shorter sample time needed", choice.dt);
  const auto remark = [&result](std::optional<std::string> one) {
    if (one) result.remarks.push_back(*std::move(one));
  };
  remark(remark_on_repeated_times(records, order, choice.method));
  remark(remark_on_resampling(choice, records, usual_distance(rows, order, done.changed), free, held, done));
  if (!all_held) remark(remark_on_short_steps(choice.dt, rows.unit.in_seconds(usual), done.longest));
  remark(remark_on_switches(records, done));
  records = std::move(result);
}

Ensemble assembled(const Records& records, const Assembly& choice) {
  const Steps steps = steps_of(records, choice);
  const bool shows_dt = records.source == StepSource::times && steps.grid.shows_dt;
  const double shown = shows_dt ? records.rows.unit.in_seconds(steps.grid.dt) : 1.0;
  Ensemble e(Index(records.rows.experiments.size()), steps.count, Index(records.inputs.size()),
             Index(records.outputs.size()), choice.dt.value_or(shown));
  e.dt_stated = choice.dt || shows_dt;
  std::vector<Index> length(size_t(e.experiments()), 0);
  fill(records, steps, e, length);
  const bool differ = std::any_of(length.begin(), length.end(), [&](Index own) { return own < e.steps(); });
  if (choice.own_lengths && differ) e.length = std::move(length);
  e.remarks = records.remarks;
  if (steps.remark) e.remarks.push_back(*steps.remark);
  if (auto remark = remark_on_empty_steps(records, steps)) e.remarks.push_back(*std::move(remark));
  return e;
}

}  // namespace tokid::io
