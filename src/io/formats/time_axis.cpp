// Converts times, as they are written in a table, to steps k of a grid begin + k dt.
// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/time_axis.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <limits>
#include <numeric>

namespace tokid::io {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double epsilon = std::numeric_limits<double>::epsilon();

// Both relative to a step: the allowed deviation of exact times from even spacing, and the coarsest allowed rounding.
constexpr double exact = 1e-6, roughest = 1.0 / 3.0;
// The fewest rounded times that determine their spacing. Fewer times could also be uneven.
constexpr int enough = 8;

// The rows in the order of their times, and the grid of these times.
struct Fit {
  std::vector<size_t> row;
  std::vector<double> time, step;  // steps are counted from the first row
  Grid grid;
  std::optional<size_t> wrong;  // the first row that is not on the grid, if any
  double off = 0.0;             // distance of this row from the grid
  double uncounted = 0.0;  // if > 0: the row follows a gap of about this number of steps, which is too long to count
  int rows = 1;            // number of different steps that have been counted so far
};

Fit in_order(const TimeColumn& rows) {
  Fit fit;
  fit.row.resize(rows.time.size());
  std::iota(fit.row.begin(), fit.row.end(), size_t{0});
  std::sort(fit.row.begin(), fit.row.end(), [&](size_t a, size_t b) { return rows.time[a] < rows.time[b]; });
  for (const size_t row : fit.row) fit.time.push_back(rows.time[row]);
  return fit;
}

// Estimates the distance of successive steps from the gaps between the rows of each experiment. The estimate is right
// if at least a quarter of the gaps are one step long; the others may be longer, because rows are missing. 0: no gap is
// larger than rounding errors.
double usual_gap(const TimeColumn& rows, const Fit& fit, double resolution) {
  std::vector<double> last(rows.experiments.size(), inf), gaps;
  for (size_t i = 0; i < fit.time.size(); ++i) {
    const double gap = fit.time[i] - std::exchange(last[size_t(rows.experiment[fit.row[i]])], fit.time[i]);
    if (gap > resolution) gaps.push_back(gap);
  }
  if (gaps.empty()) return 0.0;
  std::sort(gaps.begin(), gaps.end());
  const auto longer = std::upper_bound(gaps.begin(), gaps.end(), 1.5 * gaps[gaps.size() / 4]);
  return gaps[size_t(longer - gaps.begin() - 1) / 2];
}

// Counts the steps from row to row. The rows so far determine dt with an error of up to apart / k, where k is their
// number of steps. A gap is too long if it needs a smaller error of dt.
void count_steps(double usual, bool stated, double apart, Fit& fit) {
  const auto& time = fit.time;
  fit.step.assign(time.size(), 0.0);
  for (size_t i = 1, last = 0; i < time.size(); ++i) {
    const double k = stated ? inf : std::max(fit.step[last], 1.0);
    const double gap = time[i] - time[last], dt = last > 0 && !stated ? (time[last] - time[0]) / k : usual;
    const double steps = gap > 1.5 * usual ? std::round(gap / dt) : gap > 0.5 * usual ? 1.0 : 0.0;
    const double most = apart * (1.0 + steps / k), off = std::abs(gap - steps * dt);
    const bool counted = stated || steps <= 1.0 || most < 0.5 * dt;
    if (!counted || off > most) {
      fit.wrong = i, fit.off = off, fit.uncounted = counted ? 0.0 : steps, fit.grid.dt = dt;
      return;
    }
    fit.step[i] = fit.step[last] + steps;
    if (steps > 0.0) last = i, ++fit.rows;
  }
}

// The smallest and the largest t - k dt, relative to the first row.
std::pair<double, double> residuals(const Fit& fit, double dt) {
  double low = 0.0, high = 0.0;
  for (size_t i = 0; i < fit.time.size(); ++i) {
    const double residual = fit.time[i] - fit.time[0] - fit.step[i] * dt;
    low = std::min(low, residual), high = std::max(high, residual);
  }
  return {low, high};
}

double spread(const Fit& fit, double dt) {
  const auto [low, high] = residuals(fit, dt);
  return high - low;
}

// The spacing with the smallest spread. The search by thirds works because the spread is a convex function of the
// spacing.
double most_even(const Fit& fit, double apart) {
  const double steps = fit.step.back(), mean = (fit.time.back() - fit.time[0]) / steps, wide = spread(fit, mean);
  if (wide <= 1e-2 * apart) return mean;
  double low = mean - 2 * wide / steps, high = mean + 2 * wide / steps;
  for (int i = 0; i < 40; ++i) {
    const double third = (high - low) / 3;
    (spread(fit, low + third) < spread(fit, high - third) ? high -= third : low += third);
  }
  return 0.5 * (low + high);
}

double rounded_to(double value, int digits) {
  const std::string text = fmt::format("{:.{}g}", value, digits);
  double result = 0.0;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

// Finds the spacing that the author of the table probably meant: the one with the fewest digits, in itself or in its
// inverse (a frequency), among those whose spread is at most `most`.
double with_few_digits(const Fit& fit, double dt, double most) {
  for (int digits = 1; digits <= 12; ++digits)
    for (const double meant : {rounded_to(dt, digits), 1.0 / rounded_to(1.0 / dt, digits)})
      if (spread(fit, meant) <= most) return meant;
  return dt;
}

// Fits a grid. The times are on the grid if all t - k dt lie within a range of `apart`. A spacing with few digits is
// preferred if all t - k dt then lie within a range of `meant`.
void fit_grid(double usual, bool stated, double apart, double meant, Fit& fit) {
  fit.wrong.reset(), fit.rows = 1;
  count_steps(usual, stated, apart, fit);
  if (fit.wrong) return;
  const double dt = stated ? usual : with_few_digits(fit, most_even(fit, apart), meant);
  const auto [low, high] = residuals(fit, dt);
  fit.grid = {fit.time[0] + 0.5 * (low + high), dt, true};
  if (high - low <= apart) return;
  fit.off = 0.0;
  for (size_t i = 0; i < fit.time.size(); ++i)
    if (const double off = std::abs(fit.time[i] - fit.time[0] - fit.step[i] * dt); off > fit.off)
      fit.wrong = i, fit.off = off;
}

// Is the first time wrong, and not the second? It is if the first gap is long and the second one is usual.
bool first_is_wrong(const Fit& fit, double usual) {
  if (fit.rows > 1 || *fit.wrong + 1 >= fit.time.size()) return false;
  const double before = fit.time[*fit.wrong] - fit.time[0], after = fit.time[*fit.wrong + 1] - fit.time[*fit.wrong];
  return before > 1.5 * usual && after > 0.5 * usual && after < 1.5 * usual;
}

// Relative to a step: how far a time may lie beside the step to which it is moved.
constexpr double farthest = 0.1;

// The grid of steps of `dt` that is nearest to the times, and the row that is farthest from its step.
struct Nearest {
  MovedGrid found;
  size_t row = 0;

  bool is_near() const { return found.largest <= farthest * found.grid.dt; }
};

Nearest nearest_grid(const TimeColumn& rows, double dt) {
  const double first = *std::min_element(rows.time.begin(), rows.time.end());
  const auto beside = [&](size_t i) { return std::remainder(rows.time[i] - first, dt); };
  size_t low = 0, high = 0;
  for (size_t i = 0; i < rows.time.size(); ++i) {
    if (beside(i) < beside(low)) low = i;
    if (beside(i) > beside(high)) high = i;
  }
  const double middle = 0.5 * (beside(low) + beside(high));
  return {{{first + middle, dt, true}, beside(high) - middle}, std::abs(beside(low)) > beside(high) ? low : high};
}

// The spacing with few digits to whose steps all times can be moved; empty if there is none.
std::optional<double> spacing_to_move_to(const TimeColumn& rows, double usual) {
  for (int digits = 1; digits <= 4; ++digits)
    for (const double dt : {rounded_to(usual, digits), 1.0 / rounded_to(1.0 / usual, digits)})
      if (dt > 0 && nearest_grid(rows, dt).is_near() && std::abs(dt - usual) < farthest * usual) return dt;
  return std::nullopt;
}

// The number of files, apart from that of the row, in which the times of an experiment are not even.
Index other_uneven_files(const TimeColumn& rows, size_t row) {
  const size_t own = size_t(rows.experiment[row]);
  std::vector<TimeColumn> parts(rows.files.empty() ? 0 : rows.experiments.size());
  for (size_t i = 0; !parts.empty() && i < rows.time.size(); ++i) {
    TimeColumn& part = parts[size_t(rows.experiment[i])];
    part.time.push_back(rows.time[i]), part.experiment.push_back(0), part.line.push_back(rows.line[i]);
  }
  Index files = 0;
  std::string last;  // the file that was counted last; its experiments stand together
  for (size_t n = 0; n < parts.size(); ++n) {
    if (rows.files[n] == rows.files[own] || rows.files[n] == last || parts[n].time.empty()) continue;
    parts[n].name = rows.name, parts[n].unit = rows.unit, parts[n].experiments = {rows.experiments[n]};
    parts[n].precision = rows.precision, parts[n].largest = rows.largest;
    try {
      time_grid(parts[n], std::nullopt);
    } catch (const IoError&) {
      ++files, last = rows.files[n];
    }
  }
  return files;
}

[[noreturn]] void fail_uneven(const TimeColumn& rows, const Fit& fit, double usual, double rounding, bool stated) {
  const bool first = first_is_wrong(fit, usual);
  const size_t row = first ? fit.row[0] : fit.row[*fit.wrong];
  const std::string what =
      fit.uncounted > 0 ? fmt::format("after a gap of about {} steps of {:.6g}, which is too long to count its steps",
                                      fit.uncounted, fit.grid.dt)
                        : fmt::format("which differs by {:.4g} from even steps of {:.10g} that begin at {}", fit.off,
                                      fit.grid.dt, first ? fit.time[*fit.wrong] : fit.time[0]);
  const std::optional<double> even = fit.uncounted > 0 ? std::nullopt : spacing_to_move_to(rows, usual);
  Names advice;
  // A stated dt helps with long gaps and with rounded times, but not with a clock that jitters or with uneven samples.
  const bool gap = fit.uncounted > 0, rounded = fit.off <= 2 * rounding;
  if (!stated && (gap || (even && rounded))) advice.emplace_back("state '# dt = …' above the header");
  if (even)
    advice.push_back(fmt::format("move the times to even steps of {:.6g} s (option dt)", rows.unit.in_seconds(*even)));
  advice.emplace_back("resample to even times (option resample)");
  if (!stated && !gap && !even && rounded)
    advice.emplace_back("state '# dt = …' above the header if the times are even but rounded");
  const Index others = other_uneven_files(rows, row);
  fail("{}, column '{}': {} found, {}; {}, or number the steps in a column 'k'{}", place(rows, row), rows.name,
       rows.time[row], what, fmt::join(advice, ", "),
       others == 0 ? std::string()
                   : fmt::format(". {} more {} uneven times, too", others, others == 1 ? "file has" : "files have"));
}

// Throws if all rows are several steps apart, because the sample time is then probably wrong. With a stated dt, the
// rows of all experiments are checked together. Without it, each experiment is checked alone: its rows can only be
// several steps apart if another experiment has a smaller spacing.
// `name`: of the stated dt.
void check_all_steps(const TimeColumn& rows, const Fit& fit, std::optional<double> stated, std::string_view name) {
  constexpr double most = 9007199254740992.0;  // 2^53: doubles represent all whole numbers up to here
  if (!(fit.step.back() < most)) return;
  struct Group {
    double last = -1.0, common = 0.0;
    int rows = 0;
  };
  std::vector<Group> groups(stated ? 1 : rows.experiments.size());
  for (size_t i = 0; i < fit.step.size(); ++i) {
    Group& group = groups[stated ? 0 : size_t(rows.experiment[fit.row[i]])];
    if (fit.step[i] == group.last) continue;
    if (++group.rows > 1)
      group.common = double(std::gcd(std::int64_t(group.common), std::int64_t(fit.step[i] - group.last)));
    group.last = fit.step[i];
  }
  const double dt = fit.grid.dt;
  for (size_t n = 0; n < groups.size(); ++n) {
    const auto& [last, common, count] = groups[n];
    if (count < 3 || common <= 1.0) continue;
    if (stated)
      fail(
          "'{} = {}' found, but all rows of column '{}' lie {:.10g} s or multiples of it apart; correct dt or "
          "the times",
          name, *stated, rows.name, *stated * common);
    fail(
        "column '{}': steps of {:.10g} in experiment '{}' and of {:.10g} in all experiments together found, one "
        "sample time needed; "
        "resample, or state '# dt = {}' above the header where samples are missing",
        rows.name, common * dt, rows.experiments[n], dt, rows.unit.in_seconds(dt));
  }
}

}  // namespace

void Precision::add(std::string_view text, double value) {
  const auto digits_in = [](std::string_view part) {
    return int(std::count_if(part.begin(), part.end(), [](char c) { return c >= '0' && c <= '9'; }));
  };
  const auto from = [](std::string_view part, size_t at) { return part.substr(std::min(at, part.size())); };
  const std::string_view mantissa = text.substr(0, text.find_first_of("eE")),
                         exponent = from(text, mantissa.size() + 1);
  int power = 0;
  std::from_chars(exponent.data() + (exponent.starts_with('+') ? 1 : 0), exponent.data() + exponent.size(), power);
  constexpr int most_of_double = 400;  // largest power of ten; a zero may be written with any power
  const int digits = digits_in(from(mantissa, mantissa.find_first_of("123456789")));
  digits_ = std::max(digits_, digits);
  decimals_ = std::max(
      decimals_, digits_in(from(mantissa, mantissa.find('.'))) - std::clamp(power, -most_of_double, most_of_double));
  constexpr int most_of_single = 9;
  single_ = single_ && (digits <= most_of_single || double(float(value)) == value);
}

void Precision::add(const Precision& other) {
  digits_ = std::max(digits_, other.digits_), decimals_ = std::max(decimals_, other.decimals_);
  single_ = single_ && other.single_;
}

double Precision::unit(double value) const {
  const double size = std::abs(value);
  const double of_digits = size > 0 ? std::pow(10.0, std::floor(std::log10(size)) + 1 - digits_) : 0.0;
  constexpr double single_epsilon = std::numeric_limits<float>::epsilon();
  return std::max({std::pow(10.0, -decimals_), of_digits, single_ ? single_epsilon * size : 0.0});
}

std::string place(const TimeColumn& rows, size_t row) {
  const std::string line = fmt::format("line {}", rows.line[row]);
  return rows.files.empty() ? line : fmt::format("{}, {}", rows.files[size_t(rows.experiment[row])], line);
}

void check_common_steps(const TimeColumn& rows, std::string_view needed) {
  std::vector<double> first(rows.experiments.size(), inf), last(rows.experiments.size(), -inf);
  for (size_t i = 0; i < rows.time.size(); ++i) {
    const size_t n = size_t(rows.experiment[i]);
    first[n] = std::min(first[n], rows.time[i]);
    last[n] = std::max(last[n], rows.time[i]);
  }
  const auto begin = std::max_element(first.begin(), first.end());
  const auto end = std::min_element(last.begin(), last.end());
  if (*begin <= *end) return;
  fail("column '{}': experiment '{}' begins at {:.6g}, when experiment '{}' has ended at {:.6g}; {}", rows.name,
       rows.experiments[size_t(begin - first.begin())], *begin, rows.experiments[size_t(end - last.begin())], *end,
       needed);
}

std::optional<double> even_spacing(const std::vector<double>& times) {
  if (times.size() < 2) return std::nullopt;
  TimeColumn rows;
  rows.time = times;
  rows.experiment.resize(times.size());
  rows.line.resize(times.size());
  rows.experiments.resize(1);
  for (const double time : times) {
    if (!std::isfinite(time)) return std::nullopt;
    rows.precision.add(fmt::format("{}", time), time);
  }
  try {
    const Grid grid = time_grid(rows, std::nullopt);
    for (size_t k = 0; k < times.size(); ++k)
      if (grid.step(times[k]) != static_cast<double>(k)) return std::nullopt;
    return grid.dt;
  } catch (const IoError&) {
    return std::nullopt;
  }
}

Grid time_grid(const TimeColumn& rows, std::optional<double> stated) {
  if (!stated)
    check_common_steps(
        rows,
        "times that count from the begin of each experiment needed, or a line '# dt = …' above the header where "
        "samples are missing");
  Fit fit = in_order(rows);
  const double largest = std::max({std::abs(fit.time.front()), std::abs(fit.time.back()), rows.largest});
  const double resolution = 4 * epsilon * largest, rounding = rows.precision.unit(largest) + resolution;
  const double usual = stated ? rows.unit.from_seconds(*stated) : usual_gap(rows, fit, resolution);
  if (!stated && usual == 0) return {fit.time.front(), 1.0, false};
  if (!(usual > 0) || !std::isfinite(usual)) fail("dt: {} found, a positive time in seconds needed", usual);
  const double even = 2 * (exact * usual + resolution), least = 1e-2 * exact * usual + resolution;
  fit_grid(usual, stated.has_value(), even, std::clamp(rounding, least, even), fit);
  if (fit.wrong) {
    Fit rounded = fit;
    fit_grid(usual, stated.has_value(), rounding, rounding, rounded);
    if (rounding <= roughest * rounded.grid.dt && (stated || rounded.rows >= enough)) fit = std::move(rounded);
  }
  if (fit.wrong) fail_uneven(rows, fit, usual, rounding, stated.has_value());
  check_all_steps(rows, fit, stated, "# dt");
  return fit.grid;
}

MovedGrid moved_grid(const TimeColumn& rows, double stated) {
  const double dt = rows.unit.from_seconds(stated);
  if (!(dt > 0) || !std::isfinite(dt)) fail("dt: {} found, a positive time in seconds needed", dt);
  const auto [moved, farthest_row] = nearest_grid(rows, dt);
  if (moved.largest > farthest * dt)
    fail(
        "{}, column '{}': {} found, which lies more than a tenth of a step beside even steps of {:.10g}; another dt, or "
        "even times needed: resample (option resample)",
        place(rows, farthest_row), rows.name, rows.time[farthest_row], dt);
  Fit fit = in_order(rows);
  for (const double time : fit.time) fit.step.push_back(moved.grid.step(time) - moved.grid.step(fit.time.front()));
  fit.grid = moved.grid;
  check_all_steps(rows, fit, stated, "dt");
  return moved;
}

}  // namespace tokid::io
