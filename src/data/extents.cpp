// SPDX-License-Identifier: BSD-3-Clause
#include "data/extents.hpp"

#include <algorithm>
#include <cmath>

#include "base/integers.hpp"
#include "data/scales.hpp"
#include "data/subjects.hpp"

namespace tokid {

std::vector<Extent> extents(const Ensemble& e) {
  std::vector<Extent> result(size_t(e.experiments()));
  // Visits the columns in this direction, until all experiments have a sample, or none are left.
  const auto visit = [&](bool forward, auto&& found) {
    std::vector<Index> open = range(0, e.experiments());
    for (Index i = 0; i < e.samples().cols() && !open.empty(); ++i) {
      const Index column = forward ? i : e.samples().cols() - 1 - i;
      std::erase_if(open, [&](Index n) {
        if (std::isnan(e.samples()(n, column))) return false;
        found(result[size_t(n)], column / e.channels());
        return true;
      });
    }
  };
  visit(true, [](Extent& own, Index k) { own.begin = k; });
  visit(false, [](Extent& own, Index k) { own.end = k + 1; });
  return result;
}

std::vector<Index> lengths(const Ensemble& e) {
  if (!e.length.empty()) return e.length;
  std::vector<Index> result;
  for (const Extent& own : extents(e)) result.push_back(own.end);
  return result;
}

Extent reached(const Ensemble& e, Index needed) {
  std::vector<Index> change(size_t(e.steps()) + 1, 0);
  for (const Extent& own : extents(e)) ++change[size_t(own.begin)], --change[size_t(own.end)];
  Extent result{e.steps(), 0};
  Index count = 0;
  for (Index k = 0; k < e.steps(); ++k) {
    count += change[size_t(k)];
    if (count < needed) continue;
    result = {std::min(result.begin, k), k + 1};
  }
  return result.end > 0 ? result : Extent{0, e.steps()};
}

Ensemble begin_of(const Ensemble& e, Index end) {
  Ensemble result = stretch(e, 0, end);
  result.free = e.free;
  result.remarks = e.remarks;
  return result;
}

Findings findings_of_reach(const Ensemble& e, const std::vector<Index>& rows, Extent reached, Index needed) {
  const std::vector<Extent> all = extents(e);
  Finding before{.kind = Finding::Kind::early_steps_of_few}, after{.kind = Finding::Kind::late_steps_of_few};
  Extent outside = reached;
  for (const Index n : rows) {
    const Extent& own = all[size_t(n)];
    if (own.begin == own.end) continue;
    outside = {std::min(outside.begin, own.begin), std::max(outside.end, own.end)};
    if (own.begin < reached.begin) before.experiments.push_back(experiment(e, n));
    if (own.end > reached.end) after.experiments.push_back(experiment(e, n));
  }
  before.steps = range(outside.begin, reached.begin);
  after.steps = range(reached.end, outside.end);
  Findings result;
  for (Finding* one : {&before, &after}) {
    if (one->experiments.empty()) continue;
    one->numbers = {{"needed", double(needed)}};
    result.push_back(std::move(*one));
  }
  return result;
}

Index missing_samples(const Ensemble& ensemble) {
  Index beyond = 0;
  for (const Index length : lengths(ensemble)) beyond += (ensemble.steps() - length) * ensemble.channels();
  return ensemble.missing() - beyond;
}

ChannelSummary channel_summary(const Ensemble& e, Index channel) {
  ChannelSummary s;
  // Welford's update needs one pass, without cancellation for channels far from zero.
  double squares = 0.0;
  const std::vector<Index> length = lengths(e);
  for (Index k = 0; k < e.steps(); ++k)
    for (Index n = 0; n < e.experiments(); ++n) {
      if (k >= length[static_cast<size_t>(n)]) continue;
      const double value = e.samples()(n, k * e.channels() + channel);
      if (std::isnan(value)) {
        ++s.missing;
        continue;
      }
      if (s.samples++ == 0) s.mean = s.min = s.max = value;
      const double step = value - s.mean;
      s.mean += step / double(s.samples);
      squares += step * (value - s.mean);
      s.min = std::min(s.min, value);
      s.max = std::max(s.max, value);
    }
  if (s.samples > 0) s.std = spread_above_rounding(std::sqrt(squares / double(s.samples)), s.mean);
  return s;
}

}  // namespace tokid
