// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers.hpp"

#include <algorithm>

namespace tokid {

namespace {

constexpr size_t most_reported = 5;

}  // namespace

Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported) {
  std::erase_if(outliers, [&](const Outlier& o) {
    return o.weight == 1 && std::count(reported.begin(), reported.end(), o.experiment) > 0;
  });
  // Those that are still used come first.
  std::stable_partition(outliers.begin(), outliers.end(), [](const Outlier& o) { return o.weight == 1; });
  Findings result;
  for (size_t i = 0; i < std::min(most_reported, outliers.size()); ++i) {
    const Outlier& o = outliers[i];
    result.push_back({.kind = Finding::Kind::experiment_outlying,
                      .channels = o.outputs,
                      .experiments = {{o.experiment, o.name}},
                      .numbers = {{"ratio", o.ratio}, {"weight", o.weight}, {"held_out", double(o.held_out)}}});
  }
  if (outliers.size() > most_reported)
    result.push_back({.kind = Finding::Kind::more_outlying_experiments,
                      .numbers = {{"count", double(outliers.size() - most_reported)}}});
  return result;
}

}  // namespace tokid
