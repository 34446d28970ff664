// SPDX-License-Identifier: BSD-3-Clause
#include "choose/rival.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "choose/regression_errors.hpp"

namespace tokid {

namespace {

constexpr double all_alike = std::numeric_limits<double>::infinity();  // λ of one model for all steps
// λ of models that vary, where one model for all steps was chosen.
constexpr double slow[] = {1e3, 316.0, 100.0};

}  // namespace

std::optional<Rival> rival_of(const Ensemble& ensemble, const SmoothingOptions& options, Index lags, double smoothing,
                              Index reached, Index folds) {
  using Found = RegressionErrors::Found;
  const Index from = first_scored(options.initial_state, options.lags.back(), 0);
  const RegressionErrors candidates(ensemble, options, folds, horizons_within(ensemble.steps() - from));
  std::optional<Found> best;
  const auto take_if_smaller = [&](Found found) {
    const bool smaller = !best || found.error.value < best->error.value;
    if (smaller) best = std::move(found);
    return smaller;
  };
  if (std::isinf(smoothing)) {
    for (const double slower : slow)
      if (!take_if_smaller(candidates.found(std::min(lags, options.lags.back()), slower))) break;
  } else {
    for (const Index p : options.lags) take_if_smaller(candidates.found(p, all_alike));
    // One model for all steps determines its coefficients best. It shows which lags matter, also after a dead time.
    const Index seen = best->lags;
    std::optional<Found> before;
    for (const Index p : options.lags) {
      if (p <= reached) continue;
      Found found = candidates.found(p, smoothing);
      const bool better = !before || clearly_smaller(found.error, before->error);
      if (!better && p > seen) break;
      if (better) before = found;
      take_if_smaller(std::move(found));
    }
  }
  if (!best) return std::nullopt;
  return Rival{best->lags, best->smoothing, std::move(best->squares), candidates.horizons(), candidates.from()};
}

}  // namespace tokid
