// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/nan.hpp"
#include "modes/frozen.hpp"
#include "modes/spectra.hpp"
#include "tokid/modes.hpp"
#include "uncertainty/interval.hpp"

namespace tokid {

namespace {

constexpr Index freezing_reach = 2;  // steps on either side over which the error of freezing the time is averaged

// For each step: n frequencies, n damping ratios, and the 2n errors of freezing the time. The error grows with the
// square of the window. The change with another window is therefore a known multiple of it.
constexpr Index parts = 4;
Vector values(const Eigen::MatrixXcd& poles, const Eigen::MatrixXcd& others, double ratio) {
  Modes found, other;
  found.poles = poles;
  other.poles = others;
  const Index n = found.count();
  const double share = ratio * ratio - 1;
  const Matrix frequency = natural_frequencies(found), damping = damping_ratios(found),
               frequency_error = (natural_frequencies(other) - frequency) / share,
               damping_error = (damping_ratios(other) - damping) / share;
  Vector result(parts * n * found.steps());
  for (Index k = 0; k < found.steps(); ++k)
    result.segment(parts * n * k, parts * n) << frequency.row(k).transpose(), damping.row(k).transpose(),
        frequency_error.row(k).transpose(), damping_error.row(k).transpose();
  return result;
}

// The values of one part as (S × n).
Matrix part(const Matrix& all, const Modes& modes, Index which) {
  const Index n = modes.count();
  Matrix result(modes.steps(), n);
  for (Index k = 0; k < modes.steps(); ++k) result.row(k) = all.col(0).segment((parts * k + which) * n, n).transpose();
  return result;
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
  const Index window = result.modes.window, other = modes_of::other_window(model, window);
  const Functional function = [&](const Model& replicate) {
    const Eigen::MatrixXcd poles =
        modes_of::poles_in_order(result.modes.poles, result.modes.begin, modes_of::spectra(replicate, window, {}));
    if (other == 0) return values(poles, Eigen::MatrixXcd::Constant(poles.rows(), poles.cols(), {nan, nan}), 2.0);
    return values(poles, modes_of::poles_in_order(poles, result.modes.begin, modes_of::spectra(replicate, other, {})),
                  double(other) / double(window));
  };
  const FunctionBounds found = function_bounds(model, data, function, confidence, result.modes.steps());
  const double t = uncertainty::StudentT(confidence.level)(found.freedom);
  result.frequency = interval(found, result.modes, 0, t);
  result.damping = interval(found, result.modes, 1, t);
  result.replicates = found.replicates;
  result.findings = found.findings;
  return result;
}

}  // namespace tokid
