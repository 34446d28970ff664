// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/sample_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "io/formats/even_times.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

using Read = std::function<Contents(const Names&)>;

// Common names for sample times and times, in small letters, without the marks between words.
const Names& words_for_sample_time() {
  static const Names words{"dt",
                           "ts",
                           "fs",
                           "deltat",
                           "stepsize",
                           "timestep",
                           "sampletime",
                           "samplingtime",
                           "sampleinterval",
                           "samplinginterval",
                           "sampleperiod",
                           "samplerate",
                           "samplingrate",
                           "samplingperiod",
                           "samplefrequency",
                           "times",
                           "timestamps",
                           "timevector",
                           "samplingfrequency",
                           "tout"};
  return words;
}

// Also "t", "time" and their like with a unit: "time_ms". T is a temperature or a period.
bool is_about_time(const std::string& name) {
  std::string word = in_lower_case(name);
  std::erase_if(word, [](char c) { return c == '_' || c == '-' || c == ' '; });
  if (contains(words_for_sample_time(), word)) return true;
  static const Names times{"t", "time", "timestamp", "elapsed", "elapsedtime"};
  static const Names units{"", "s", "sec", "seconds", "ms", "milliseconds", "us", "microseconds", "ns", "min", "h"};
  return std::any_of(times.begin(), times.end(), [&](const std::string& time) {
    return word.starts_with(time) && contains(units, word.substr(time.size())) && (time != "t" || name[0] == 't');
  });
}

// The real numbers of the data set `name`, which must be a vector or a scalar; empty for any other data set, and if it
// cannot be read.
std::vector<double> numbers(const std::string& name, const Read& read) {
  try {
    const Contents contents = read({name});
    for (const auto& [found, array] : contents.arrays) {
      const auto* values = std::get_if<std::vector<double>>(&array.values);
      const auto longest = std::max_element(array.shape.begin(), array.shape.end());
      if (values && (longest == array.shape.end() || *longest == values->size())) return *values;
    }
  } catch (const IoError&) {
  }
  return {};
}

// Sample times with a smaller relative difference are equal up to rounding.
constexpr double alike = 1e-6;

// The spacing of the times of successive steps; empty for other times.
std::optional<double> even_spacing(const std::vector<double>& times) {
  if (times.size() < 2 || !std::all_of(times.begin(), times.end(), [](double t) { return std::isfinite(t); }))
    return std::nullopt;
  const EvenTimes grid = even_times(times);
  for (size_t k = 0; k < times.size(); ++k)
    if (grid.step(times[k]) != double(k)) return std::nullopt;
  return grid.shows_dt && !grid.wrong ? std::optional(grid.dt) : std::nullopt;
}

std::optional<double> in_times(const Names& names, Index steps, const Read& read) {
  for (const char* name : {"t", "time"}) {
    if (!contains(names, name)) continue;
    const auto times = numbers(name, read);
    const auto dt = times.size() == static_cast<size_t>(steps) ? even_spacing(times) : std::nullopt;
    if (dt) return dt;
  }
  return std::nullopt;
}

std::optional<double> in_ts(const Names& names, const Read& read) {
  if (!contains(names, "Ts")) return std::nullopt;
  const auto found = numbers("Ts", read);
  return found.size() == 1 && std::isfinite(found[0]) && found[0] > 0 ? std::optional(found[0]) : std::nullopt;
}

}  // namespace

std::optional<std::string> contradiction(double dt, const Names& names, const Read& read) {
  const auto ts = in_ts(names, read);
  if (!ts || std::abs(*ts - dt) <= alike * dt) return std::nullopt;
  return fmt::format("'dt' = {} and 'Ts' = {} differ. tokid uses 'dt'", dt, *ts);
}

SampleTime sample_time(const Names& names, Index steps, const Read& read) {
  const auto ts = in_ts(names, read), times = in_times(names, steps, read);
  SampleTime result{ts ? ts : times, {}};
  if (ts && times && std::abs(*ts - *times) > alike * *ts)
    result.remark = fmt::format("'Ts' = {} and the steps of {} between the times differ. tokid uses 'Ts'", *ts, *times);
  Names unused;
  std::copy_if(names.begin(), names.end(), std::back_inserter(unused), is_about_time);
  if (!result.dt && !unused.empty())
    result.remark = fmt::format(
        "{} {} not used, because a sample time needs the name 'dt' or 'Ts' and one number. Times need the name 't' or "
        "'time' and {} evenly spaced values in seconds, one for each step",
        quoted(unused), unused.size() == 1 ? "is" : "are", steps);
  return result;
}

}  // namespace tokid::io
