// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "base/nan.hpp"
#include "modes/tracks.hpp"
#include "tokid/modes.hpp"

namespace tokid {

namespace {

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

// Frequencies, then damping ratios, of each step.
Vector values(const Modes& modes) {
  const Index n = modes.count();
  const Matrix frequency = natural_frequencies(modes), damping = damping_ratios(modes);
  Vector result(2 * n * modes.steps());
  for (Index k = 0; k < modes.steps(); ++k) {
    result.segment(2 * n * k, n) = frequency.row(k).transpose();
    result.segment(2 * n * k + n, n) = damping.row(k).transpose();
  }
  return result;
}

// The part of the values, (S × n), from entry `begin` of each step on.
Matrix part(const Matrix& all, const Modes& modes, Index begin) {
  Matrix result(modes.steps(), modes.count());
  for (Index k = 0; k < modes.steps(); ++k)
    result.row(k) = all.col(0).segment(2 * modes.count() * k + begin, modes.count()).transpose();
  return result;
}

Interval part(const Interval& all, const Modes& modes, Index begin) {
  return {part(all.estimate, modes, begin), part(all.deviation, modes, begin), part(all.lower, modes, begin),
          part(all.upper, modes, begin)};
}

}  // namespace

ModeBounds mode_bounds(const Model& model, const Ensemble& data, const ModesOptions& options,
                       const ConfidenceOptions& confidence) {
  ModeBounds result;
  result.modes = modes(model, options);
  result.level = confidence.level;
  ModesOptions same{result.modes.window, options.slow, {}};
  const Functional function = [&](const Model& other) {
    Modes found = modes(other, same);
    Modes ordered = result.modes;
    for (Index k = 0; k < ordered.steps(); ++k) {
      const Index at = ordered.begin + k - found.begin;
      const bool there = at >= 0 && at < found.steps();
      ordered.poles.row(k) = in_order_of(ordered.poles.row(k).transpose(),
                                         there ? Eigen::VectorXcd(found.poles.row(at).transpose()) : Eigen::VectorXcd())
                                 .transpose();
    }
    return values(ordered);
  };
  FunctionBounds found = function_bounds(model, data, function, confidence, result.modes.steps());
  result.frequency = part(found.interval, result.modes, 0);
  result.damping = part(found.interval, result.modes, result.modes.count());
  result.replicates = found.replicates;
  result.findings = std::move(found.findings);
  return result;
}

}  // namespace tokid
