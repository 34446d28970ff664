// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/recording.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "base/statistics.hpp"
#include "data/subjects.hpp"

namespace tokid {

namespace {

// A constant end is reported only if it has this number of steps, and this multiple of the median over the experiments.
constexpr double fewest_held = 8, times_usual_end = 3;
// A jump by a turn differs from the turn by the motion of one step. All other motions are smaller than this share of a
// turn, and the angles fill this share of it.
constexpr double largest_motion = 0.25, least_range = 0.75;

// A change is one from a sample to another sample. Samples that are missing tell nothing.
struct Changes {
  Index last = 0, before = 0;  // the last step with a change of a channel; the number of changes before it
  Index end = 0;               // the first step after the last sample
};

std::vector<Changes> changes(const Ensemble& e) {
  const Index d = e.channels();
  std::vector<Changes> result(static_cast<size_t>(e.experiments()));
  for (Index k = 0; k < e.steps(); ++k)
    for (Index n = 0; n < e.experiments(); ++n) {
      Changes& own = result[size_t(n)];
      bool changed = false;
      for (Index c = 0; c < d; ++c) {
        const double value = e.samples()(n, k * d + c);
        if (std::isnan(value)) continue;
        own.end = k + 1;
        changed = changed || (k > 0 && std::abs(value - e.samples()(n, (k - 1) * d + c)) > 0);
      }
      if (!changed) continue;
      own.before += own.last > 0;
      own.last = k;
    }
  return result;
}

std::optional<Finding> early_ends(const Ensemble& e, Index origin) {
  const std::vector<Changes> found = changes(e);
  std::vector<double> held;
  for (const Changes& own : found) held.push_back(double(own.end - own.last));
  if (held.size() < 2) return std::nullopt;
  const double usual = statistics::median(held);
  Finding result{.kind = Finding::Kind::experiments_end_early};
  for (Index n = 0; n < e.experiments(); ++n) {
    const Changes& own = found[size_t(n)];
    if (own.before == 0 || held[size_t(n)] < fewest_held || held[size_t(n)] < times_usual_end * usual) continue;
    result.experiments.push_back({n, e.experiment_name(n)});
    result.steps.push_back(origin + own.last);
  }
  if (result.experiments.empty()) return std::nullopt;
  return result;
}

// The jumps of output j by a whole turn; nothing if the output does not look like an angle between two limits.
std::optional<Finding> turns(const Ensemble& e, Index j, double turn, Index origin) {
  double least = std::numeric_limits<double>::infinity(), most = -least, motion = 0.0;
  const auto each = [&](auto&& use) {
    for (Index k = 0; k < e.steps(); ++k)
      for (Index n = 0; n < e.experiments(); ++n)
        if (!std::isnan(e.y(n, k, j))) use(n, k);
  };
  const auto jumps = [&](Index n, Index k) {
    return k > 0 && std::abs(e.y(n, k, j) - e.y(n, k - 1, j)) > (1 - largest_motion) * turn;
  };
  each([&](Index n, Index k) {
    least = std::min(least, e.y(n, k, j));
    most = std::max(most, e.y(n, k, j));
    const double change = k > 0 ? std::abs(e.y(n, k, j) - e.y(n, k - 1, j)) : 0.0;
    if (!jumps(n, k) && change > motion) motion = change;
  });
  if (most - least < least_range * turn || most - least > turn * (1 + 1e-6) || motion > largest_motion * turn)
    return std::nullopt;
  Finding result{.kind = Finding::Kind::angle_wraps, .channels = {output_channel(e.names, j)}};
  Index count = 0;
  each([&](Index n, Index k) {
    if (!jumps(n, k)) return;
    // Without the turn, it is a motion as large as the others. An output that switches between two values has no
    // others.
    if (std::abs(turn - std::abs(e.y(n, k, j) - e.y(n, k - 1, j))) > motion) return;
    if (count++ > 0) return;
    result.experiments = {{n, e.experiment_name(n)}};
    result.steps = {origin + k};
  });
  if (count == 0) return std::nullopt;
  result.numbers = {{"turn", turn}, {"count", double(count)}};
  return result;
}

}  // namespace

Findings findings_of_recording(const Ensemble& e, Index origin) {
  Findings result;
  if (auto found = early_ends(e, origin)) result.push_back(*std::move(found));
  for (Index j = 0; j < e.outputs(); ++j)
    for (const double turn : {2 * std::numbers::pi, 360.0})
      if (auto found = turns(e, j, turn, origin)) result.push_back(*std::move(found));
  return result;
}

}  // namespace tokid
