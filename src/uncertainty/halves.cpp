// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/halves.hpp"

#include <cmath>

namespace tokid::uncertainty {

namespace {

constexpr double agreeing = 0.95;

std::optional<MarkovBounds> bounds_of(const Ensemble& half, GtvArxOptions o, Index band) {
  const GtvArx arx = gtv_arx(half, o);
  Index free = 0;
  for (Index k = arx.k_begin; k < arx.steps(); ++k) free += arx.step[size_t(k)].freedom > 0;
  if (2 * free < arx.steps() - arx.k_begin) return std::nullopt;
  return markov_bounds(arx, band, {agreeing, {o.execution.threads, {}}});
}

}  // namespace

std::optional<double> agreement_of_halves(const Ensemble& data, const GtvArxOptions& regressions, Index band,
                                          const Execution& execution) {
  GtvArxOptions o = regressions;
  o.execution = {execution.threads, {}};
  std::vector<Index> rows[2];
  for (Index n = 0; n < data.experiments(); ++n) rows[n % 2].push_back(n);
  if (rows[1].empty()) return std::nullopt;
  const std::optional<MarkovBounds> even = bounds_of(data.subset(rows[0]), o, band);
  const std::optional<MarkovBounds> odd = even ? bounds_of(data.subset(rows[1]), o, band) : std::nullopt;
  if (!odd) return std::nullopt;
  double agree = 0.0, compared = 0.0;
  for (size_t k = 0; k < even->step.size(); ++k) {
    const Interval &a = even->step[k], &b = odd->step[k];
    for (Index i = 0; i < a.estimate.size(); ++i) {
      const double width =
          std::hypot(a.upper.reshaped()(i) - a.lower.reshaped()(i), b.upper.reshaped()(i) - b.lower.reshaped()(i)) / 2;
      if (!std::isfinite(width) || width == 0) continue;
      agree += std::abs(a.estimate.reshaped()(i) - b.estimate.reshaped()(i)) <= width;
      compared += 1;
    }
  }
  if (compared == 0) return std::nullopt;
  return agree / compared;
}

}  // namespace tokid::uncertainty
