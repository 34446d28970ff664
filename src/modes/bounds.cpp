// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "modes/frozen.hpp"
#include "modes/tracks.hpp"
#include "tokid/modes.hpp"
#include "uncertainty/interval.hpp"

namespace tokid {

namespace {

constexpr Index freezing_reach = 2;  // steps on either side over which the error of freezing the time is averaged

// The poles (n) of a replicate in the order of the original. NaN where either has none.
Eigen::VectorXcd in_order_of(const Eigen::VectorXcd& original, const Eigen::VectorXcd& found) {
  const Index n = original.size();
  Eigen::VectorXcd result = Eigen::VectorXcd::Constant(n, std::complex<double>(nan, nan));
  if (found.size() != n || !original.allFinite() || !found.allFinite()) return result;
  Matrix cost(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) cost(i, j) = std::abs(original(i) - found(j));
  const std::vector<Index> column = modes_of::assignment(cost);
  for (Index i = 0; i < n; ++i) result(i) = found(column[size_t(i)]);
  return result;
}

// The modes of another model, or with another window, at the steps and in the order of the original.
Modes in_order_of(const Modes& original, const Modes& found) {
  Modes result = original;
  for (Index k = 0; k < result.steps(); ++k) {
    const Index at = result.begin + k - found.begin;
    const bool there = at >= 0 && at < found.steps();
    result.poles.row(k) = in_order_of(Eigen::VectorXcd(original.poles.row(k).transpose()),
                                      there ? Eigen::VectorXcd(found.poles.row(at).transpose()) : Eigen::VectorXcd())
                              .transpose();
  }
  return result;
}

// For each step: n frequencies, n damping ratios, and the 2n errors of freezing the time. The error grows with the
// square of the window. The change with a shorter window is therefore a known share of it.
constexpr Index parts = 4;
Vector values(const Modes& modes, const Modes& shorter, Index shorter_window) {
  const Index n = modes.count();
  const double ratio = double(shorter_window) / double(modes.window), share = ratio < 1 ? 1 - ratio * ratio : 1.0;
  const Matrix frequency = natural_frequencies(modes), damping = damping_ratios(modes),
               frequency_error = (natural_frequencies(shorter) - frequency) / share,
               damping_error = (damping_ratios(shorter) - damping) / share;
  Vector result(parts * n * modes.steps());
  for (Index k = 0; k < modes.steps(); ++k)
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

// The square of the error of freezing the time, as far as it is larger than its own standard error. Squares are
// averaged over neighbouring steps.
double freezing_square(const Matrix& error, const Matrix& deviation, Index k, Index i) {
  double sum = 0.0, count = 0.0;
  for (Index s = std::max<Index>(0, k - freezing_reach); s <= std::min(error.rows() - 1, k + freezing_reach); ++s) {
    const double excess = error(s, i) * error(s, i) - deviation(s, i) * deviation(s, i);
    if (std::isfinite(excess)) sum += excess, count += 1;
  }
  return count > 0 ? std::max(0.0, sum / count) : 0.0;
}

// The interval of frequencies (which = 0) or damping ratios (1), with the error of freezing the time.
Interval interval(const FunctionBounds& all, const Modes& modes, Index which, double t) {
  Interval result{part(all.interval.estimate, modes, which), part(all.interval.deviation, modes, which),
                  part(all.interval.lower, modes, which), part(all.interval.upper, modes, which)};
  const Matrix error = part(all.interval.estimate, modes, which + 2),
               deviation = part(all.interval.deviation, modes, which + 2);
  for (Index i = 0; i < modes.count(); ++i)
    for (Index k = 0; k < modes.steps(); ++k) {
      const double wider = std::hypot(result.deviation(k, i), std::sqrt(freezing_square(error, deviation, k, i)));
      if (!(wider > result.deviation(k, i))) continue;
      result.deviation(k, i) = wider;
      result.lower(k, i) = result.estimate(k, i) - t * wider;
      result.upper(k, i) = result.estimate(k, i) + t * wider;
    }
  return result;
}

}  // namespace

ModeBounds mode_bounds(const Model& model, const Ensemble& data, const ModesOptions& options,
                       const ConfidenceOptions& confidence) {
  ModeBounds result;
  result.modes = modes(model, options);
  result.level = confidence.level;
  const ModesOptions same{result.modes.window, options.slow, {}},
      shorter{modes_of::half_window(model, result.modes.window), options.slow, {}};
  const Functional function = [&](const Model& other) {
    const Modes found = in_order_of(result.modes, modes(other, same));
    return values(found, in_order_of(found, modes(other, shorter)), shorter.window);
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
