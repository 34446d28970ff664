// Converts times as written to steps of a grid: fits a line to the times of each experiment, and one grid to all.
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

// Fewer rows do not distinguish even times from other, rounded times.
constexpr Index few = 8;
// Shares of a step: the deviation of even times, and the largest unit of rounded times.
constexpr double exact = 1e-6, roughest = 1.0 / 3.0;

// ---- the spacing ----

// Distinct times. Times that differ by no more than rounding errors are one.
std::vector<double> distinct(std::vector<double> times, double resolution) {
  std::sort(times.begin(), times.end());
  double largest = 0.0;
  for (size_t i = 1; i < times.size(); ++i) largest = std::max(largest, times[i] - times[i - 1]);
  const double same = std::max(resolution, 1e-6 * largest);
  times.erase(std::unique(times.begin(), times.end(), [&](double a, double b) { return b - a <= same; }), times.end());
  return times;
}

// Of the spacings that the times allow, the intended one has few digits, or its frequency has.
double with_few_digits(double dt, double uncertainty) {
  const auto rounded = [](double value, int digits) {
    const std::string text = fmt::format("{:.{}g}", value, digits);
    double result = 0.0;
    std::from_chars(text.data(), text.data() + text.size(), result);
    return result;
  };
  for (int digits = 1; digits <= 12; ++digits)
    for (const double meant : {rounded(dt, digits), 1.0 / rounded(1.0 / dt, digits)})
      if (std::abs(meant - dt) <= uncertainty) return meant;
  return dt;
}

// The even spacing: the smallest distance counts the steps of the others, and the whole range refines it.
double spacing(const std::vector<double>& times) {
  if (times.size() < 2) return 1.0;
  double smallest = inf, steps = 0.0;
  for (size_t i = 1; i < times.size(); ++i) smallest = std::min(smallest, times[i] - times[i - 1]);
  for (size_t i = 1; i < times.size(); ++i) steps += std::round((times[i] - times[i - 1]) / smallest);
  const double refined = (times.back() - times.front()) / steps;
  return with_few_digits(refined,
                         2 * epsilon * (refined + std::max(std::abs(times.front()), std::abs(times.back())) / steps));
}

// ---- the times of one experiment ----

// The line t = begin + k dt, and the largest distance of a row from it.
struct Axis {
  Index rows = 0;
  double first = inf, last = -inf;
  double unit = 0.0;           // in which its times are written
  double begin = 0.0, dt = 0;  // 0: too few rows
  double steps = 0.0;          // dt from first to last
  double off = 0.0;
  size_t worst = 0;        // row
  double uncounted = 0.0;  // about this number of steps in the gap beside that row, too many to count
  bool is_even = false;    // up to the rounding of the written times
};

// Allowed distances of times from the line, and from each other, for even times or for rounded times. Rounding costs
// half a unit, and the line through rounded times costs half of that again.
struct Tolerance {
  double off = 0.0, apart = 0.0;
};

Tolerance of_even_times(double dt, double resolution) {
  const double off = exact * dt + resolution;
  return {off, 2 * off};
}

Tolerance of_rounded_times(double unit, double resolution) { return {0.75 * unit, unit + resolution}; }

// The times of one experiment in order, and their steps.
class Stretch {
 public:
  Stretch(const std::vector<double>& time, std::vector<size_t> rows)
      : rows_(std::move(rows)), time_(rows_.size()), step_(rows_.size(), 0.0) {
    std::sort(rows_.begin(), rows_.end(), [&](size_t a, size_t b) { return time[a] < time[b]; });
    std::transform(rows_.begin(), rows_.end(), time_.begin(), [&](size_t row) { return time[row]; });
  }

  // Fits the line with a stated spacing.
  void fit_stated(double dt, Axis& axis) {
    for (size_t i = 1; i < time_.size(); ++i) step_[i] = step_[i - 1] + std::round(gap(i) / dt);
    fit(0, time_.size() - 1, dt, axis);
  }

  // Fits a line to the longest run without gaps, and extends it row by row across the smaller gap. The spacing so far
  // counts the steps of the gap, and each row makes the spacing more exact. It ends at a row off the line, which would
  // bend it.
  void fit_growing(double resolution, bool rounded, Axis& axis) {
    const double usual = usual_gap();
    auto [begin, end] = longest_run(1.5 * usual);
    for (size_t i = begin + 1; i <= end; ++i) step_[i] = step_[i - 1] + (gap(i) > 0.5 * usual ? 1.0 : 0.0);
    if (begin == end || !(step_[end] > step_[begin])) return;
    fit(begin, end, std::nullopt, axis);
    const Tolerance most = rounded ? of_rounded_times(axis.unit, resolution) : of_even_times(axis.dt, resolution);
    if (axis.off > most.off) return;
    while (begin > 0 || end + 1 < time_.size()) {
      const bool forward = begin == 0 || (end + 1 < time_.size() && gap(end + 1) <= gap(begin));
      const double distance = gap(forward ? end + 1 : begin);
      const double known = step_[end] - step_[begin], dt = (time_[end] - time_[begin]) / known;
      const double steps = std::round(distance / dt), uncertainty = most.apart * (1.0 + steps / known);
      const size_t from = forward ? end++ : begin--, next = forward ? end : begin;
      const bool is_counted = steps <= 1.0 || uncertainty < 0.5 * dt;
      if (const double off = std::abs(distance - steps * dt); off > uncertainty || !is_counted) {
        axis.off = std::max(off, axis.off), axis.worst = rows_[next];
        axis.uncounted = is_counted ? 0.0 : steps;
        return;
      }
      step_[next] = step_[from] + (forward ? steps : -steps);
    }
    fit(begin, end, std::nullopt, axis);
    axis.is_even = axis.off <= most.off;
  }

 private:
  double gap(size_t i) const { return time_[i] - time_[i - 1]; }

  // Gaps and repeated rows are not usual.
  double usual_gap() const {
    std::vector<double> gaps;
    for (size_t i = 1; i < time_.size(); ++i)
      if (gap(i) > 0) gaps.push_back(gap(i));
    if (gaps.empty()) return 0.0;
    const auto usual = gaps.begin() + std::ptrdiff_t(gaps.size() / 4);
    std::nth_element(gaps.begin(), usual, gaps.end());
    return *usual;
  }

  std::pair<size_t, size_t> longest_run(double most) const {
    std::pair<size_t, size_t> longest{0, 0};
    for (size_t i = 1, begin = 0; i < time_.size(); ++i) {
      if (gap(i) > most) begin = i;
      if (i - begin > longest.second - longest.first) longest = {begin, i};
    }
    return longest;
  }

  // Fits by least squares.
  void fit(size_t begin, size_t end, std::optional<double> stated, Axis& axis) const {
    const double rows = double(end - begin + 1);
    double mean_step = 0.0, mean_time = 0.0, squares = 0.0, products = 0.0;
    for (size_t i = begin; i <= end; ++i) {
      mean_step += (step_[i] - step_[begin]) / rows;
      mean_time += (time_[i] - time_[begin]) / rows;
    }
    const auto step = [&](size_t i) { return step_[i] - step_[begin] - mean_step; };
    const auto time = [&](size_t i) { return time_[i] - time_[begin] - mean_time; };
    for (size_t i = begin; i <= end; ++i) {
      squares += step(i) * step(i);
      products += step(i) * time(i);
    }
    axis.dt = stated ? *stated : products / squares;
    axis.steps = step_[end] - step_[begin];
    axis.begin = time_[begin] + (mean_time - axis.dt * mean_step);
    axis.off = 0.0;
    for (size_t i = begin; i <= end; ++i)
      if (const double off = std::abs(time(i) - step(i) * axis.dt); off > axis.off)
        axis.off = off, axis.worst = rows_[i];
  }

  std::vector<size_t> rows_;
  std::vector<double> time_, step_;
};

void fit_stated(Stretch& stretch, double dt, double resolution, Axis& axis) {
  stretch.fit_stated(dt, axis);
  const double rounding = axis.unit <= roughest * dt ? of_rounded_times(axis.unit, resolution).off : 0.0;
  axis.is_even = axis.off <= std::max(of_even_times(dt, resolution).off, rounding);
}

void fit_growing(Stretch& stretch, double resolution, Axis& axis) {
  if (axis.rows < few) return;
  const Axis before = axis;
  stretch.fit_growing(resolution, false, axis);
  if (axis.is_even || !(axis.unit <= roughest * axis.dt)) return;
  Axis rounded = before;
  stretch.fit_growing(resolution, true, rounded);
  if (of_rounded_times(axis.unit, resolution).off > of_even_times(axis.dt, resolution).off) axis = rounded;
}

std::vector<Axis> axes_of(const TimeColumn& rows, std::optional<double> stated, double resolution) {
  std::vector<Axis> axes(rows.experiments.size());
  std::vector<std::vector<size_t>> own_rows(axes.size());
  for (size_t i = 0; i < rows.time.size(); ++i) {
    Axis& own = axes[size_t(rows.experiment[i])];
    ++own.rows;
    own.first = std::min(own.first, rows.time[i]);
    own.last = std::max(own.last, rows.time[i]);
    own_rows[size_t(rows.experiment[i])].push_back(i);
  }
  for (size_t n = 0; n < axes.size(); ++n) {
    Axis& own = axes[n];
    own.unit = rows.precision.unit(std::max(std::abs(own.first), std::abs(own.last)));
    Stretch stretch(rows.time, std::move(own_rows[n]));
    if (stated)
      fit_stated(stretch, *stated, resolution, own);
    else
      fit_growing(stretch, resolution, own);
  }
  return axes;
}

// Are times farther off the line than double precision explains?
bool is_rounded(const Axis& axis, double resolution) { return axis.off > resolution; }

// Allowed distance of a time from the line, and of the line from the intended one.
double slack(const Axis& axis, double resolution) {
  return is_rounded(axis, resolution) ? std::max({axis.unit, 2 * axis.off, resolution}) : resolution;
}

double meant(const Axis& axis, double resolution) {
  return with_few_digits(axis.dt, 2 * epsilon * axis.dt + 0.5 * slack(axis, resolution) / std::max(axis.steps, 1.0));
}

// ---- the times of all ----

// Experiments with different sample times would have gaps where the others have samples.
void check_spacings(const TimeColumn& rows, const std::vector<Axis>& axes, size_t longest, double resolution) {
  const Axis& common = axes[longest];
  size_t other = longest, fastest = longest;
  for (size_t n = 0; n < axes.size(); ++n) {
    const Axis& own = axes[n];
    if (!own.is_even) continue;
    if (own.dt < axes[fastest].dt) fastest = n;
    const double apart = std::abs(own.dt - common.dt);
    const double most = 2 * exact * common.dt + slack(own, resolution) + slack(common, resolution);
    if (apart * own.steps > most && apart > std::abs(axes[other].dt - common.dt)) other = n;
  }
  if (other == longest) return;
  const size_t slow = axes[other].dt > common.dt ? other : longest, fast = slow == other ? longest : other;
  const bool may_be_gaps = std::round(axes[slow].dt / axes[fastest].dt) > 1.0;
  fail(
      "column '{}': steps of {:.10g} in experiment '{}' and of {:.10g} in experiment '{}' found, one sample time needed{}",
      rows.name, meant(axes[slow], resolution), rows.experiments[slow], meant(axes[fast], resolution),
      rows.experiments[fast],
      may_be_gaps ? fmt::format(", or a line '# dt = {}' above the header where samples are missing",
                                rows.unit.in_seconds(meant(axes[fastest], resolution)))
                  : " (or step numbers in a column 'k')");
}

// Steps between the steps of others are no common steps.
void check_origins(const TimeColumn& rows, const std::vector<Axis>& axes, size_t longest, double resolution) {
  const Axis& common = axes[longest];
  for (size_t n = 0; n < axes.size(); ++n) {
    if (!axes[n].is_even) continue;
    const double distance = axes[n].begin - common.begin, steps = std::round(distance / common.dt);
    const double behind = distance - steps * common.dt;
    double most = std::abs(steps) * slack(common, resolution) / std::max(common.steps, 1.0) + 2 * exact * common.dt;
    for (const Axis* axis : {&axes[n], &common}) most += slack(*axis, resolution);
    if (std::abs(behind) > most)
      fail(
          "column '{}': experiment '{}' begins {:.4g} {} a step of experiment '{}', the same steps of {} needed: "
          "times from the begin of each experiment on",
          rows.name, rows.experiments[n], std::abs(behind), behind > 0 ? "after" : "before", rows.experiments[longest],
          meant(common, resolution));
  }
}

// The axis with the most steps, if any is even.
std::optional<size_t> longest_of(const std::vector<Axis>& axes) {
  std::optional<size_t> longest;
  for (size_t n = 0; n < axes.size(); ++n)
    if (axes[n].is_even && (!longest || axes[n].steps > axes[*longest].steps)) longest = n;
  return longest;
}

// Allowed distances of rows from the grid, by experiment.
struct Fit {
  Grid grid;
  std::vector<double> most;
};

Fit fitted(const TimeColumn& rows, const std::vector<Axis>& axes, std::optional<double> dt, double resolution) {
  Fit result;
  Grid& grid = result.grid;
  grid.begin = *std::min_element(rows.time.begin(), rows.time.end());
  const std::optional<size_t> longest = longest_of(axes);
  if (!dt && longest) {
    check_spacings(rows, axes, *longest, resolution);
    check_origins(rows, axes, *longest, resolution);
  }
  const std::vector<double> times = distinct(rows.time, resolution);
  grid.shows_dt = dt || times.size() > 1;
  grid.dt = dt ? *dt : longest ? meant(axes[*longest], resolution) : spacing(times);
  // A stated sample time shows that gaps are intended.
  if (!dt)
    check_common_steps(rows,
                       fmt::format("times from the begin of each experiment on needed, or a line '# dt = {}' above "
                                   "the header where samples are missing",
                                   rows.unit.in_seconds(grid.dt)));
  const bool rounded = longest && std::any_of(axes.begin(), axes.end(), [&](const Axis& axis) {
                         return axis.is_even && is_rounded(axis, resolution);
                       });
  // Rounded times lie on both sides of the grid, so the grid need not start at the first time.
  if (rounded) {
    const double begin = axes[*longest].begin;
    grid.begin = begin - std::round((begin - grid.begin) / grid.dt) * grid.dt;
  }
  for (const Axis& axis : axes) {
    double& most = result.most.emplace_back(exact * grid.dt + resolution);
    // The line may be that of another experiment, whose times were rounded too.
    if (rounded && (axis.is_even || axis.rows < few))
      most = std::max({most, 1.5 * std::max(axis.unit, axes[*longest].unit), 2 * axis.off});
  }
  return result;
}

// Reports the uneven times of one experiment: the gap that cannot be counted, or the row that is farthest off.
void fail_uneven(const TimeColumn& rows, const std::vector<Axis>& axes) {
  const auto relative = [](const Axis& axis) { return axis.dt > 0 && !axis.is_even ? axis.off / axis.dt : 0.0; };
  for (const Axis& axis : axes)
    if (axis.uncounted > 0)
      fail(
          "line {}, column '{}': {} found, beside a gap of about {} steps of {:.6g}, more than times in units of "
          "{:.3g} can tell; a line '# dt = …' above the header or step numbers in a column 'k' needed",
          rows.line[axis.worst], rows.name, rows.time[axis.worst], axis.uncounted, axis.dt, axis.unit);
  const auto worst = std::max_element(axes.begin(), axes.end(),
                                      [&](const Axis& a, const Axis& b) { return relative(a) < relative(b); });
  if (!(relative(*worst) > exact)) return;
  fail(
      "line {}, column '{}': {} found, {:.4g} off the even steps of {:.6g} of the other rows, which are needed (or step "
      "numbers in a column 'k')",
      rows.line[worst->worst], rows.name, rows.time[worst->worst], worst->off,
      with_few_digits(worst->dt, worst->off / std::max(worst->steps, 1.0)));
}

void check_rows(const TimeColumn& rows, const std::vector<Axis>& axes, const Fit& fit, bool stated) {
  const Grid& grid = fit.grid;
  // Compared with a gap that is too large, all other times look like one.
  if (std::any_of(axes.begin(), axes.end(), [&](const Axis& a) { return a.uncounted > 0 && grid.dt > 1.5 * a.dt; }))
    fail_uneven(rows, axes);
  for (size_t i = 0; i < rows.time.size(); ++i) {
    const size_t n = size_t(rows.experiment[i]);
    const double time = rows.time[i], off = std::abs(time - grid.begin - grid.step(time) * grid.dt);
    if (off <= fit.most[n]) continue;
    if (!stated) fail_uneven(rows, axes);
    const double unit = axes[n].unit;
    const bool may_be_rounded = !stated && axes[n].rows < few && off <= 1.5 * unit && unit <= roughest * grid.dt;
    fail(
        "line {}, column '{}': {} found, {:.4g} off the even steps of {} from {} on, which are needed (or step "
        "numbers in a column 'k'{})",
        rows.line[i], rows.name, time, off, grid.dt, grid.begin,
        may_be_rounded
            ? fmt::format(", or a line '# dt = …' above the header where fewer than {} times were rounded", few)
            : "");
  }
}

// If no two rows are one stated sample time apart, the rows have another sample time.
void check_stated(const TimeColumn& rows, const Grid& grid, double stated) {
  constexpr double most = 9007199254740992.0;  // whole numbers that doubles can count
  std::int64_t common = 0;
  size_t other_steps = 0;
  double last = 0.0;
  for (const double time : rows.time) {
    const double step = grid.step(time);
    if (!(step < most)) return;
    common = std::gcd(common, std::int64_t(step));
    if (step != 0.0 && step != last) ++other_steps, last = step;
  }
  if (common <= 1 || other_steps < 2) return;
  fail("'# dt = {}' found, but all rows of column '{}' lie {:.10g} s or multiples of it apart; one of the two needed",
       stated, rows.name, stated * double(common));
}

}  // namespace

void Precision::add(std::string_view text, double value) {
  const size_t mantissa = std::min(text.find_first_of("eE"), text.size());
  int digits = 0, decimals = 0, power = 0;
  bool fraction = false;
  for (const char c : text.substr(0, mantissa)) {
    if (c == '.') fraction = true;
    if (c < '0' || c > '9') continue;
    if (digits > 0 || c != '0') ++digits;
    if (fraction) ++decimals;
  }
  if (mantissa < text.size()) {
    const size_t sign = text[mantissa + 1] == '+' ? 1 : 0;
    std::from_chars(text.data() + mantissa + 1 + sign, text.data() + text.size(), power);
  }
  constexpr int most_of_double = 400;  // a power; zero may be written with any
  digits_ = std::max(digits_, digits);
  decimals_ = std::max(decimals_, decimals - std::clamp(power, -most_of_double, most_of_double));
  constexpr int most_of_single = 9;
  single_ = single_ && (digits <= most_of_single || double(float(value)) == value);
}

double Precision::unit(double value) const {
  const double size = std::abs(value);
  const double of_digits = size > 0 ? std::pow(10.0, std::floor(std::log10(size)) + 1 - digits_) : 0.0;
  constexpr double single_epsilon = std::numeric_limits<float>::epsilon();
  return std::max({std::pow(10.0, -decimals_), of_digits, single_ ? single_epsilon * size : 0.0});
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
  std::optional<double> dt = stated;
  if (dt) *dt = rows.unit.from_seconds(*dt);
  const auto [first, last] = std::minmax_element(rows.time.begin(), rows.time.end());
  const double resolution = 4 * epsilon * std::max(std::abs(*first), std::abs(*last));
  const std::vector<Axis> axes = axes_of(rows, dt, resolution);
  const Fit fit = fitted(rows, axes, dt, resolution);
  const double spacing = fit.grid.dt;
  if (!(spacing > 0) || !std::isfinite(spacing)) fail("dt: {} found, a positive time in seconds needed", spacing);
  check_rows(rows, axes, fit, dt.has_value());
  if (stated) check_stated(rows, fit.grid, *stated);
  return fit.grid;
}

}  // namespace tokid::io
