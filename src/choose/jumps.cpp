// SPDX-License-Identifier: BSD-3-Clause
#include "choose/jumps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "base/integers.hpp"
#include "choose/regression_errors.hpp"

namespace tokid {

namespace {

// Standard errors by which a jump reduces the held-out error. The step was chosen among all steps.
constexpr double significant_jump = 2.5;
// Fewer steps do not determine the matrices before or after a jump.
constexpr Index fewest_steps = 3;
constexpr size_t most_jumps = 8;

std::vector<Index> with(std::vector<Index> steps, Index step) {
  steps.insert(std::upper_bound(steps.begin(), steps.end(), step), step);
  return steps;
}

// The search with regressions of p lags.
class JumpSearch {
 public:
  JumpSearch(const Ensemble& e, const SmoothingOptions& o, Index lags, double smoothing)
      : e_(e), o_(o), lags_(lags), smoothing_(smoothing), errors_(e, o, fold_count(e.experiments()), {1}) {}

  std::vector<Jump> run() {
    std::vector<Index> steps;
    std::vector<double> losses;
    Found before = best(steps, {1 / half_decade, half_decade});
    while (steps.size() < most_jumps) {
      const std::optional<Index> step = likeliest(steps);
      if (!step) break;
      Found after = best(with(steps, *step), {half_decade, 10.0});
      if (!is_sharp(steps, *step, before, after)) break;
      losses.insert(losses.begin() + (std::upper_bound(steps.begin(), steps.end(), *step) - steps.begin()),
                    (before.error.value - after.error.value) / standard_error(after.error, before.error));
      steps = with(steps, *step);
      before = std::move(after);
    }
    std::vector<Jump> jumps;
    for (size_t i = 0; i < steps.size(); ++i) {
      steps[i] = located(steps, i);
      jumps.push_back({steps[i], losses[i]});
    }
    return jumps;
  }

 private:
  using Found = RegressionErrors::Found;
  static inline const double half_decade = std::sqrt(10.0);

  // The best λ of a few around the chosen one, or the stated λ.
  Found best(const std::vector<Index>& jumps, const std::vector<double>& factors) const {
    Found least = errors_.found(lags_, smoothing_, jumps);
    if (o_.smoothing) return least;
    for (const double factor : factors)
      if (Found found = errors_.found(lags_, factor * smoothing_, jumps); found.error.value < least.error.value)
        least = std::move(found);
    return least;
  }

  // Does the jump predict better than no jump, and than changes as fast in the p+1 steps before or after it? Where the
  // matrices only vary fast for a while, it does not.
  bool is_sharp(const std::vector<Index>& jumps, Index step, const Found& before, const Found& after) const {
    if (!clearly_smaller(after.error, before.error, significant_jump)) return false;
    for (const Index aside : {step - lags_ - 1, step + lags_ + 1})
      if (!clearly_smaller(after.error, errors_.found(lags_, after.smoothing, with(jumps, aside)).error,
                           significant_jump))
        return false;
    return true;
  }

  // The step of the largest gain, away from known jumps. A jump lowers λ, so the gains are those of a larger one.
  std::optional<Index> likeliest(const std::vector<Index>& jumps) const {
    constexpr double stiffer = 10.0;
    SmoothArxOptions regression{lags_, o_.initial_state, o_.feedthrough};
    regression.variation.smoothing = stiffer * smoothing_;
    regression.execution.threads = o_.execution.threads;
    Vector gains = jump_gains(e_, regression);
    const Index margin = std::min(lags_ + fewest_steps, gains.size());
    gains.head(margin).setZero();
    gains.tail(margin).setZero();
    for (const Index jump : jumps) {
      const Index begin = std::max<Index>(0, jump - 2 * lags_), end = std::min(gains.size(), jump + 2 * lags_ + 1);
      gains.segment(begin, end - begin).setZero();
    }
    Index step = 0;
    return gains.size() > 0 && gains.maxCoeff(&step) > 0 ? std::optional(step) : std::nullopt;
  }

  // A jump a few steps earlier or later with the least error, summed over the lag orders. A regression with many lags
  // hardly depends on the step.
  Index located(const std::vector<Index>& jumps, size_t i) const {
    Index best = jumps[i];
    double least = std::numeric_limits<double>::infinity();
    for (Index step = std::max<Index>(1, jumps[i] - lags_); step <= std::min(e_.steps() - 1, jumps[i] + lags_);
         ++step) {
      std::vector<Index> moved = jumps;
      moved.erase(moved.begin() + std::ptrdiff_t(i));
      if (std::find(moved.begin(), moved.end(), step) != moved.end()) continue;
      moved = with(std::move(moved), step);
      double sum = 0.0;
      for (const Index p : o_.lags) sum += errors_.found(p, smoothing_, moved).error.value;
      if (sum < least) least = sum, best = step;
    }
    return best;
  }

  const Ensemble& e_;
  const SmoothingOptions& o_;
  Index lags_;
  double smoothing_;
  RegressionErrors errors_;
};

}  // namespace

std::vector<Jump> find_jumps(const Ensemble& ensemble, const SmoothingOptions& options, Index lags, double smoothing) {
  // Around a jump, p steps have past samples of both sides. With a third of the lags, far fewer steps do, and a
  // regression still predicts well enough.
  SmoothingOptions fewer = options;
  fewer.lags.resize(size_t(ceil_div(lags, 3)));
  std::iota(fewer.lags.begin(), fewer.lags.end(), Index{1});
  return JumpSearch(ensemble, fewer, fewer.lags.back(), smoothing).run();
}

}  // namespace tokid
