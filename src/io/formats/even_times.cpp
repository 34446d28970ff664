// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/even_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>

namespace tokid::io {

namespace {

// The allowed distance from the grid, relative to a step.
constexpr double allowed = 1e-6;

double rounded_to(double value, int digits) {
  const std::string text = fmt::format("{:.{}g}", value, digits);
  double result = 0.0;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

// The spacing with the fewest digits that differs so little, in itself or in its frequency. The author meant this one.
double with_few_digits(double spacing, double uncertainty) {
  for (int digits = 1; digits <= 15; ++digits)
    for (const double meant : {rounded_to(spacing, digits), 1.0 / rounded_to(1.0 / spacing, digits)})
      if (std::abs(meant - spacing) <= uncertainty) return meant;
  return spacing;
}

// \pre ascending, not empty
double lower_median(const std::vector<double>& values) { return values[(values.size() - 1) / 2]; }
double quartile(const std::vector<double>& values) { return values[(values.size() - 1) / 4]; }

void drop_below(double least, std::vector<double>& ascending) {
  ascending.erase(ascending.begin(), std::upper_bound(ascending.begin(), ascending.end(), least));
}

// The rises from a time to the next one that are no rounding errors, in ascending order.
std::vector<double> gaps_of(const std::vector<double>& times, double rounding) {
  std::vector<double> gaps;
  for (size_t i = 1; i < times.size(); ++i) gaps.push_back(times[i] - times[i - 1]);
  std::sort(gaps.begin(), gaps.end());
  drop_below(rounding, gaps);
  if (!gaps.empty()) drop_below(allowed * lower_median(gaps), gaps);
  return gaps;
}

// The smallest gap counts the steps, and the range of the times gives their length. Times that were added up drift.
double spacing_of(const std::vector<double>& gaps, double range, double rounding) {
  double steps = 0.0;
  for (const double gap : gaps) steps += std::round(gap / gaps.front());
  return with_few_digits(range / steps, (rounding + 1e-2 * allowed * gaps.front()) / steps);
}

std::optional<size_t> off_grid(const EvenTimes& grid, const std::vector<double>& times, double rounding) {
  for (size_t i = 0; i < times.size(); ++i) {
    const double off = times[i] - grid.begin - grid.step(times[i]) * grid.dt;
    if (!(std::abs(off) <= allowed * grid.dt + rounding)) return i;
  }
  return std::nullopt;
}

// `precision`: of the times, relative to their size.
EvenTimes grid_of(const std::vector<double>& times, std::optional<double> stated, double precision) {
  std::vector<double> sorted = times;
  std::sort(sorted.begin(), sorted.end());
  const double rounding = precision * std::max(std::abs(sorted.front()), std::abs(sorted.back()));
  EvenTimes result;
  result.begin = sorted.front();
  const std::vector<double> gaps = stated ? std::vector<double>{} : gaps_of(sorted, rounding);
  result.shows_dt = !gaps.empty();
  if (stated) result.dt = *stated;
  if (result.shows_dt) result.dt = spacing_of(gaps, sorted.back() - sorted.front(), rounding);
  result.wrong = off_grid(result, times, rounding);
  if (!result.shows_dt) return result;
  // One wrong time makes the steps too short. At least a quarter of the times follow another one after one step.
  const std::vector<double> successive = gaps_of(times, rounding);
  EvenTimes usual = result;
  if (successive.empty()) return result;
  usual.dt = with_few_digits(lower_median(successive), rounding);
  usual.wrong = off_grid(usual, times, rounding);
  return usual.wrong && (result.wrong || result.dt < 0.75 * quartile(successive)) ? usual : result;
}

}  // namespace

EvenTimes even_times(const std::vector<double>& times, std::optional<double> stated) {
  const bool single = std::all_of(times.begin(), times.end(), [](double t) { return double(float(t)) == t; });
  const EvenTimes exact = grid_of(times, stated, 4 * std::numeric_limits<double>::epsilon());
  if (!exact.wrong || !single) return exact;
  const EvenTimes rounded = grid_of(times, stated, std::numeric_limits<float>::epsilon());
  return rounded.wrong ? exact : rounded;
}

}  // namespace tokid::io
