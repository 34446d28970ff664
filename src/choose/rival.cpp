// SPDX-License-Identifier: BSD-3-Clause
#include "choose/rival.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "data/output_weights.hpp"

namespace tokid {

namespace {

constexpr double all_alike = std::numeric_limits<double>::infinity();  // λ of one model for all steps
// λ of models that vary, where one model for all steps was chosen.
constexpr double slow[] = {1e3, 316.0, 100.0};

// Adds the errors of predictions that begin at step s, from the samples before it and the inputs from it on. A missing
// sample before or at a step makes the prediction NaN, which does not count.
class Predictions {
 public:
  Predictions(const Ensemble& e, const GtvArx& arx, const std::vector<Index>& horizons)
      : e_(e), arx_(arx), horizons_(horizons) {}

  void add(Index s, Index count, Squares& sum) {
    const Index d = e_.channels(), r = e_.inputs(), m = e_.outputs(), p = arx_.step[size_t(s)].lags, from = s - p;
    rows_ = e_.samples().middleCols(from * d, (s + count - from) * d);
    for (Index h = 1, i = 0; h <= count; ++h) {
      const Index k = s + h - 1, q = arx_.step[size_t(k)].lags;
      predicted_.noalias() =
          rows_.middleCols((k - q - from) * d, arx_.regressors(k)) * arx_.coefficients(k).transpose();
      if (h == horizons_[size_t(i)]) sum.add(i++, predicted_, e_, k);
      rows_.middleCols((k - from) * d + r, m) = predicted_;
    }
  }

 private:
  const Ensemble& e_;
  const GtvArx& arx_;
  const std::vector<Index>& horizons_;
  Matrix rows_, predicted_;
};

// The held-out errors of regressions.
class Candidates {
 public:
  Candidates(const Ensemble& e, const SmoothingOptions& o, Index held_out)
      : options_(o),
        from_(first_scored(o.initial_state, o.lags.back(), 0)),
        horizons_(horizons_within(e.steps() - from_)),
        weights_(weights_of(o.output_weights, e.outputs())) {
    const Index folds = fold_count(e.experiments());
    for (Index f = 0; f < std::min(held_out, folds); ++f) parts_.push_back(fold(e, f, folds, o.centred));
  }

  struct Found {
    Rival rival;
    HeldOutError error;
  };
  Found found(Index lags, double smoothing) const {
    const Index columns = Index(horizons_.size()) * weights_.size();
    const bool constant = std::isinf(smoothing);
    const SmoothArxOptions o{lags, options_.initial_state, options_.feedthrough,
                             constant ? TimeVariation{0.0, 1} : TimeVariation{smoothing}};
    std::vector<Squares> of_folds(parts_.size());
    parallel_for(0, Index(parts_.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) {
        const Ensemble& held_out = parts_[size_t(f)].held_out;
        const GtvArx arx = smooth_arx(parts_[size_t(f)].training, o);
        Squares& own = of_folds[size_t(f)] = Squares(held_out.experiments(), columns);
        Predictions predictions(held_out, arx, horizons_);
        for (Index s = from_; s < held_out.steps(); ++s)
          predictions.add(s, begins_far(s, held_out.steps(), horizons_) ? horizons_.back() : 1, own);
      }
    });
    Squares all = joined(of_folds);
    HeldOutError error = held_out_error(all, weights_);
    return {{lags, smoothing, std::move(all), horizons_, from_}, std::move(error)};
  }

 private:
  const SmoothingOptions& options_;
  Index from_;
  std::vector<Index> horizons_;
  Vector weights_;
  std::vector<Split> parts_;
};

}  // namespace

std::optional<Rival> rival_of(const Ensemble& ensemble, const SmoothingOptions& options, Index lags, double smoothing,
                              Index reached, Index folds) {
  const Candidates candidates(ensemble, options, folds);
  std::optional<Candidates::Found> best;
  const auto take_if_smaller = [&](Candidates::Found found) {
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
    const Index seen = best->rival.lags;
    std::optional<Candidates::Found> before;
    for (const Index p : options.lags) {
      if (p <= reached) continue;
      Candidates::Found found = candidates.found(p, smoothing);
      const bool better = !before || clearly_smaller(found.error, before->error);
      if (!better && p > seen) break;
      if (better) before = found;
      take_if_smaller(std::move(found));
    }
  }
  if (!best) return std::nullopt;
  return std::move(best->rival);
}

}  // namespace tokid
