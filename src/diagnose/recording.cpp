// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/recording.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "data/subjects.hpp"

namespace tokid {

namespace {

// A constant end is reported only if it has this number of steps, and this multiple of the longest pause before it.
constexpr double fewest_held = 8, times_usual_end = 3;
// A channel that changes less often than this tells nothing about the end.
constexpr Index fewest_changes = 3;
// A jump by a turn differs from the turn by the motion of one step. All other motions are smaller than this share of a
// turn, and the angles fill this share of it.
constexpr double largest_motion = 0.25, least_range = 0.75;

// The changes of a channel in an experiment, from a sample to the next one that is present.
struct ChannelCourse {
  double value = std::numeric_limits<double>::quiet_NaN();  // of the last sample
  Index last = 0, end = 0;  // the last step with a change; the step after the last sample
  Index pause = 0;          // the longest time between two changes [steps]
  Index changes = 0;
};

// The step from which all channels of an experiment stay constant to its last sample, if that is no rest: at a rest,
// the inputs stop before the outputs do. In a recording that was filled, all channels stop at once, each within the
// longest pause that it has made before.
std::optional<Index> early_end(const std::vector<ChannelCourse>& channels, Index inputs) {
  Index begin = 0, end = std::numeric_limits<Index>::max(), pause = 1;
  for (const ChannelCourse& c : channels) {
    begin = std::max(begin, c.last);
    end = std::min(end, c.end);  // a channel without samples tells nothing about the steps after it
    if (c.changes >= fewest_changes) pause = std::max(pause, c.pause);
  }
  const auto stops = [&](auto first, auto last) {
    return std::any_of(first, last, [](const ChannelCourse& c) { return c.changes >= fewest_changes; }) &&
           std::all_of(first, last, [&](const ChannelCourse& c) {
             return c.changes < fewest_changes || begin - c.last < std::max<Index>(1, c.pause);
           });
  };
  if (!stops(channels.begin(), channels.begin() + inputs) || !stops(channels.begin() + inputs, channels.end()))
    return std::nullopt;
  const double held = double(end - begin);
  if (held < fewest_held || held < times_usual_end * double(pause)) return std::nullopt;
  return begin;
}

std::optional<Finding> early_ends(const Ensemble& e) {
  const Index d = e.channels();
  std::vector<std::vector<ChannelCourse>> courses(size_t(e.experiments()),
                                                  std::vector<ChannelCourse>(static_cast<size_t>(d)));
  for (Index k = 0; k < e.steps(); ++k)
    for (Index n = 0; n < e.experiments(); ++n)
      for (Index c = 0; c < d; ++c) {
        const double value = e.samples()(n, k * d + c);
        if (std::isnan(value)) continue;
        ChannelCourse& own = courses[size_t(n)][size_t(c)];
        if (std::abs(value - own.value) > 0) {
          if (own.changes > 0) own.pause = std::max(own.pause, k - own.last);
          own.last = k;
          ++own.changes;
        }
        own.value = value;
        own.end = k + 1;
      }
  Finding result{.kind = Finding::Kind::experiments_end_early};
  for (Index n = 0; n < e.experiments(); ++n)
    if (const std::optional<Index> begin = early_end(courses[size_t(n)], e.inputs())) {
      result.experiments.push_back({n, e.experiment_name(n)});
      result.steps.push_back(*begin);
    }
  if (result.experiments.empty()) return std::nullopt;
  return result;
}

// The jumps of output j by a whole turn; nothing if the output does not look like an angle between two limits.
std::optional<Finding> turns(const Ensemble& e, Index j, double turn) {
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
    result.steps = {k};
  });
  if (count == 0) return std::nullopt;
  result.numbers = {{"turn", turn}, {"count", double(count)}};
  return result;
}

}  // namespace

Findings findings_of_recording(const Ensemble& e) {
  Findings result;
  if (auto found = early_ends(e)) result.push_back(*std::move(found));
  for (Index j = 0; j < e.outputs(); ++j)
    for (const double turn : {2 * std::numbers::pi, 360.0})
      if (auto found = turns(e, j, turn)) result.push_back(*std::move(found));
  return result;
}

}  // namespace tokid
