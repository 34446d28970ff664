// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <vector>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/continuation.hpp"
#include "modes/frozen.hpp"
#include "modes/spectra.hpp"
#include "modes/tracks.hpp"
#include "tokid/modes.hpp"

namespace tokid {

namespace {

constexpr Index freezing_reach = 2;  // steps on either side over which the error of freezing the time is averaged

// For each step: n frequencies, n damping ratios, and the 2n errors of freezing the time. The error grows with the
// square of the window. The change with another window is therefore a known multiple of it.
constexpr Index frozen_parts = 4;
Matrix frozen_values(const Eigen::MatrixXcd& poles, const Eigen::MatrixXcd& others, double ratio) {
  Modes found, other;
  found.poles = poles;
  other.poles = others;
  const Index n = found.count();
  const double share = ratio * ratio - 1;
  const Matrix frequency = natural_frequencies(found), damping = damping_ratios(found),
               frequency_error = (natural_frequencies(other) - frequency) / share,
               damping_error = (damping_ratios(other) - damping) / share;
  Matrix result(found.steps(), frozen_parts * n);
  result << frequency, damping, frequency_error, damping_error;
  return result;
}

// The real and the imaginary parts (2n) of the exponents that are nearest to `original` (n), up to multiples of `turn`
// of imaginary parts: the logarithms of negative multipliers have two signs. NaN for multipliers of zero.
Vector exponents_near(const Eigen::VectorXcd& original, const Eigen::VectorXcd& found, double turn) {
  const Index n = original.size();
  Vector result = Vector::Constant(2 * n, nan);
  if (found.size() != n) return result;
  const auto change = [&](Index i, Index j) {
    const std::complex<double> plain = found(j) - original(i);
    return std::complex<double>(plain.real(), std::remainder(plain.imag(), turn));
  };
  Matrix cost(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j)
      cost(i, j) = original(i) == found(j) ? 0.0 : std::fmin(std::abs(change(i, j)), 1e3 * turn);
  const std::vector<Index> column = modes_of::assignment(cost);
  for (Index i = 0; i < n; ++i) {
    const std::complex<double> moved = original(i) + change(i, column[size_t(i)]);
    if (!std::isfinite(moved.real()) || !std::isfinite(moved.imag())) continue;
    result(i) = moved.real();
    result(n + i) = moved.imag();
  }
  return result;
}

// One row of values per step as a vector, and back. `extra` is the same at all steps.
Vector joined(const Matrix& rows, const Vector& extra) {
  Matrix all(rows.rows(), rows.cols() + extra.size());
  all << rows, extra.transpose().replicate(rows.rows(), 1);
  return all.reshaped<Eigen::RowMajor>();
}

// The values of one part as (S × n).
Matrix part(const Matrix& all, const Modes& modes, Index which) {
  const auto rows = all.reshaped<Eigen::RowMajor>(modes.steps(), all.size() / modes.steps());
  return rows.middleCols(which * modes.count(), modes.count());
}

// The interval of `count` values from entry `begin` of the first step on, as (count × 1): they are the same at all
// steps.
Interval common_interval(const Interval& all, Index begin, Index count) {
  const auto first = [&](const Matrix& values) { return Matrix(values.col(0).segment(begin, count)); };
  return {first(all.estimate), first(all.deviation), first(all.lower), first(all.upper)};
}

// The square of the error of freezing the time at step k, as far as it is larger than its own standard error. Squares
// are averaged over neighbouring steps. Steps near the ends, where a longer window does not fit, take those of the
// nearest steps. Infinite if no step has another window.
double freezing_square(const Matrix& error, const Matrix& deviation, Index k, Index i) {
  const Index steps = error.rows();
  double sum = 0.0, count = 0.0;
  const auto add = [&](Index s) {
    if (s < 0 || s >= steps) return;
    const double excess = error(s, i) * error(s, i) - deviation(s, i) * deviation(s, i);
    if (std::isfinite(excess)) sum += excess, count += 1;
  };
  add(k);
  for (Index distance = 1; distance < steps && (distance <= freezing_reach || count == 0); ++distance)
    add(k - distance), add(k + distance);
  return count > 0 ? std::max(0.0, sum / count) : std::numeric_limits<double>::infinity();
}

// The interval of frequencies (which = 0) or damping ratios (1), with the error of freezing the time.
Interval interval(const FunctionBounds& all, const Modes& modes, Index which, double t) {
  Interval result{part(all.interval.estimate, modes, which), part(all.interval.deviation, modes, which),
                  part(all.interval.lower, modes, which), part(all.interval.upper, modes, which)};
  const Matrix error = part(all.interval.estimate, modes, which + 2),
               deviation = part(all.interval.deviation, modes, which + 2);
  const double least = which == 0 ? 0.0 : -1.0, most = which == 0 ? std::numeric_limits<double>::infinity() : 1.0;
  for (Index i = 0; i < modes.count(); ++i)
    for (Index k = 0; k < modes.steps(); ++k) {
      const double wider = std::hypot(result.deviation(k, i), std::sqrt(freezing_square(error, deviation, k, i)));
      if (wider > result.deviation(k, i)) {
        result.deviation(k, i) = wider;
        result.lower(k, i) = result.estimate(k, i) - t * wider;
        result.upper(k, i) = result.estimate(k, i) + t * wider;
      }
      if (which == 1) {
        const double ratio = result.estimate(k, i), first_order = modes.variation(k, i) * (1 - ratio * ratio);
        if (std::isfinite(first_order)) {
          result.lower(k, i) = ratio - std::hypot(ratio - result.lower(k, i), first_order);
          result.upper(k, i) = ratio + std::hypot(result.upper(k, i) - ratio, first_order);
        }
      }
      if (result.lower(k, i) < least) result.lower(k, i) = least;
      if (result.upper(k, i) > most) result.upper(k, i) = most;
    }
  return result;
}

}  // namespace

ModeBounds mode_bounds(const Model& model, const Ensemble& data, const ModesOptions& options,
                       const ConfidenceOptions& confidence) {
  ModeBounds result;
  result.modes = modes(model, options);
  result.level = confidence.level;
  const bool repeats = goes_on(model);
  const Index window = result.modes.window, other = modes_of::other_window(modes_of::lasting(model), window);
  const Eigen::VectorXcd exponents = repeats ? floquet_exponents(model) : Eigen::VectorXcd();
  const double turn = 2 * std::numbers::pi / (double(model.period) * model.dt);
  const Functional function = [&](const Model& replicate) {
    const Vector extra = repeats ? exponents_near(exponents, floquet_exponents(replicate), turn) : Vector();
    const Eigen::MatrixXcd poles =
        modes_of::poles_in_order(result.modes.poles, result.modes.begin, modes_of::spectra(replicate, window, {}));
    if (other == 0)
      return joined(frozen_values(poles, Eigen::MatrixXcd::Constant(poles.rows(), poles.cols(), {nan, nan}), 2.0),
                    extra);
    return joined(
        frozen_values(poles,
                      modes_of::poles_in_order(poles, result.modes.begin, modes_of::spectra(replicate, other, {})),
                      double(other) / double(window)),
        extra);
  };
  const FunctionBounds found = function_bounds(model, data, function, confidence, result.modes.steps());
  const double t = statistics::student_quantile((1 + confidence.level) / 2, found.freedom);
  result.frequency = interval(found, result.modes, 0, t);
  result.damping = interval(found, result.modes, 1, t);
  if (repeats) {
    const Index begin = frozen_parts * result.modes.count(), count = exponents.size();
    result.exponents_real = common_interval(found.interval, begin, count);
    result.exponents_imag = common_interval(found.interval, begin + count, count);
  }
  result.replicates = found.replicates;
  result.findings = found.findings;
  return result;
}

}  // namespace tokid
