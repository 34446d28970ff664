// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/words.hpp"

namespace tokid {

namespace {

constexpr size_t most_reported = 5;

// Two digits are enough.
std::string times(double ratio) {
  if (ratio >= 1e4) return "more than 10000";
  const double unit = ratio >= 1000 ? 100 : ratio >= 100 ? 10 : ratio >= 10 ? 1 : 0.1;
  return fmt::format("{:.{}f}", std::round(ratio / unit) * unit, unit < 1 ? 1 : 0);
}

}  // namespace

std::vector<std::string> warnings_of(std::vector<Outlier> outliers, const std::vector<Index>& told) {
  std::erase_if(outliers, [&](const Outlier& o) { return std::count(told.begin(), told.end(), o.experiment) > 0; });
  std::vector<std::string> result;
  for (size_t i = 0; i < std::min(most_reported, outliers.size()); ++i) {
    const Outlier& o = outliers[i];
    result.push_back(fmt::format(
        "experiment {} does not fit the others: its leave-one-out residuals are {} times as "
        "large as theirs{}{}",
        words::experiment(o.experiment, o.name), times(o.ratio), o.explanation.empty() ? "" : "; ", o.explanation));
  }
  if (outliers.size() > most_reported)
    result.push_back(fmt::format("{} more do not fit the others: are these runs of one system, in the same units?",
                                 words::plural(Index(outliers.size() - most_reported), "experiment")));
  return result;
}

}  // namespace tokid
