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

std::string experiments_named(const Names& names) {
  return fmt::format("{} {}", names.size() == 1 ? "experiment" : "experiments", some_of(names));
}

// ---- resampling ----

// One channel of one experiment: its samples that are not missing, in the order of time.
struct Signal {
  std::vector<double> time, value;
};

// Samples at the same time become one, their mean.
Signal signal_of(const Records& records, const std::vector<size_t>& order, size_t channel) {
  Signal s;
  size_t same = 1;
  for (const size_t i : order) {
    const double time = records.rows.time[i], value = records.samples[i * records.channels() + channel];
    if (std::isnan(value)) continue;
    if (!s.time.empty() && s.time.back() == time) {
      s.value.back() += (value - s.value.back()) / double(++same);
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
  bool in_gap = false;  // missing because of a long gap; else because its channel has no sample before it or after it
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
  return {(1.0 - share) * s.value[i] + share * s.value[i + 1]};
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
           of_experiment(records.rows.experiments[size_t(n)]), records.doubt);
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
}

void begin_together(Records& records) {
  TimeColumn& rows = records.rows;
  if (rows.time.empty()) return;
  const Spans spans = spans_of(rows);
  const double apart = spans.latest_begin() - spans.earliest_begin();
  if (!(apart > 0)) return;
  constexpr double most = 0.5;  // of the shortest experiment
  constexpr auto trigger = "Use --trigger if an event aligns them";
  const bool timed = records.source == StepSource::times;
  if (spans.common() >= most * spans.shortest()) {
    records.remarks.push_back(fmt::format(
        "the {} of all experiments were read as readings of one clock, on which the experiments begin up to {:.6g}{} "
        "apart. {}",
        timed ? "times" : "step numbers", timed ? rows.unit.in_seconds(apart) : apart, timed ? " s" : " steps",
        trigger));
    return;
  }
  move_times(spans.first, rows);
  records.remarks.push_back(
      fmt::format("the {} of the experiments have {} in common, so tokid lets each experiment begin at its first row. "
                  "{}",
                  timed ? "times" : "step numbers",
                  spans.common() < 0 ? "nothing" : "less than half of the shortest experiment", trigger));
}

void align(const std::string& trigger, Records& records) {
  TimeColumn& rows = records.rows;
  std::vector<Onset> onsets;
  for (const std::vector<size_t>& own : rows_in_order(rows)) onsets.push_back(onset_of(records, own));
  std::vector<bool> kept;
  Names without, begun, again;
  for (size_t n = 0; n < onsets.size(); ++n) {
    kept.push_back(onsets[n].time().has_value());
    if (!kept.back()) without.push_back(rows.experiments[n]);
    if (onsets[n].from_first_row) (onsets[n].change ? again : begun).push_back(rows.experiments[n]);
  }
  if (without.size() == onsets.size())
    fail("trigger '{}': it holds at no row of any experiment, a condition that holds somewhere needed", trigger);
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
  remark(begun,
         fmt::format("already holds at the first row of {}, so the event may be earlier. The first row became step 0",
                     experiments_named(begun)));
  remark(
      again,
      fmt::format("already holds at the first row of {}. Step 0 is the row at which the condition begins to hold again",
                  experiments_named(again)));
}

namespace {

// The median distance of successive rows; 0 if there are none.
double usual_distance(const TimeColumn& rows, const std::vector<std::vector<size_t>>& order) {
  std::vector<double> distances;
  for (const std::vector<size_t>& own : order)
    for (size_t i = 1; i < own.size(); ++i)
      if (const double distance = rows.time[own[i]] - rows.time[own[i - 1]]; distance > 0)
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

// Appends the samples of an experiment, whose rows are `order`, at the times begin + k dt within it.
FilledCount add_resampled(const Records& records, Index n, const std::vector<size_t>& order, double begin,
                          const Filling& filling, Records& to) {
  std::vector<Signal> signals;
  for (size_t c = 0; c < records.channels(); ++c) signals.push_back(signal_of(records, order, c));
  const TimeColumn& rows = records.rows;
  const double first = std::ceil((rows.time[order.front()] - begin - filling.slack) / filling.dt);
  const double last = std::floor((rows.time[order.back()] - begin + filling.slack) / filling.dt);
  FilledCount count;
  auto nearest = order.begin();
  for (double k = first; k <= last; ++k) {
    const double time = begin + k * filling.dt;
    while (nearest + 1 != order.end() && rows.time[*(nearest + 1)] <= time + filling.slack) ++nearest;
    to.rows.time.push_back(k * filling.dt);
    to.rows.experiment.push_back(n);
    to.rows.line.push_back(rows.line[*nearest]);
    for (const Signal& s : signals) {
      const Filled sample = at(s, time, filling);
      to.samples.push_back(sample.value);
      count.add(sample);
    }
  }
  return count;
}

std::string remark_on_resampling(const Resampling& choice, const TimeUnit& unit, double usual, double longest,
                                 const FilledCount& count) {
  std::string remark =
      fmt::format("the samples were resampled from about {:.4g} s to {} s by the method {}: {}", unit.in_seconds(usual),
                  choice.dt, name_of(choice.method),
                  effect_on_noise(choice.method, choice.dt, usual > 0 ? unit.in_seconds(usual) : choice.dt,
                                  unit.in_seconds(count.oldest)));
  const auto stay = [](Index samples) { return samples == 1 ? "sample stays" : "samples stay"; };
  if (count.in_gaps > 0)
    remark +=
        fmt::format(". {} {} missing, because their gap is longer than {:.4g} s", count.in_gaps, stay(count.in_gaps),
                    choice.method == ResampleMethod::mean ? choice.dt : unit.in_seconds(longest));
  if (count.outside > 0)
    remark += fmt::format(". {} {} missing before the first or after the last sample of the channel", count.outside,
                          stay(count.outside));
  return remark;
}

}  // namespace

void resample(const Resampling& choice, bool aligned, Records& records) {
  if (records.source != StepSource::times)
    fail("resample: no column of times found; a column of times, such as 't [s]', needed");
  if (!(choice.dt > 0) || !std::isfinite(choice.dt))
    fail("resample: {} found, a positive time in seconds needed", choice.dt);
  const TimeColumn& rows = records.rows;
  const std::vector<std::vector<size_t>> order = rows_in_order(rows);
  const double dt = rows.unit.from_seconds(choice.dt), usual = usual_distance(rows, order);
  const double longest = choice.longest_gap ? double(*choice.longest_gap) * std::max(dt, usual) : infinite;
  const Filling filling{choice.method, dt, longest, 1e-6 * std::min(dt, usual > 0 ? usual : dt)};
  const double begin = aligned ? 0.0 : *std::min_element(rows.time.begin(), rows.time.end());

  Records result = records;
  result.rows.time.clear(), result.rows.experiment.clear(), result.rows.line.clear(), result.samples.clear();
  result.rows.precision = {}, result.rows.largest = 0.0;
  const double total = (*std::max_element(rows.time.begin(), rows.time.end()) - begin) / dt;
  if (!(total * double(order.size() * records.channels()) * sizeof(double) <= 0.25 * double(memory_limit())))
    fail("resample: {} s found, which makes {:.4g} steps of each experiment, more than fit into memory", choice.dt,
         total);
  FilledCount count;
  for (size_t n = 0; n < order.size(); ++n)
    count.add(add_resampled(records, Index(n), order[n], begin, filling, result));
  if (result.rows.time.empty())
    fail("resample: {} s found, but no experiment is as long; a shorter sample time needed", choice.dt);
  result.remarks.push_back(remark_on_resampling(choice, rows.unit, usual, longest, count));
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
