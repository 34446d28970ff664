// SPDX-License-Identifier: BSD-3-Clause
#include "choose/regression_errors.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "data/output_weights.hpp"

namespace tokid {

namespace {

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

}  // namespace

RegressionErrors::RegressionErrors(const Ensemble& e, const SmoothingOptions& o, Index held_out,
                                   std::vector<Index> horizons, Index folds)
    : options_(o),
      ahead_(ahead_in(e, o.initial_state == InitialState::zero ? 0 : o.lags.back(), std::move(horizons), o.period)),
      weights_(weights_of(o.output_weights, e.outputs())) {
  if (folds == 0) folds = fold_count(e.experiments());
  for (Index f = 0; f < std::min(held_out, folds); ++f) parts_.push_back(fold(e, f, folds, o.centred));
}

std::vector<Squares> RegressionErrors::squares(Index begin, Index end, Index lags, double smoothing,
                                               const std::vector<Index>& jumps) const {
  SmoothArxOptions o{lags, options_.initial_state, options_.feedthrough};
  if (std::isinf(smoothing))
    o.variation.period = 1;
  else
    o.variation = {smoothing, 0, jumps};
  std::vector<Squares> result(size_t(std::max<Index>(0, end - begin)));
  parallel_for(begin, end, {options_.execution.threads, {}}, [&](Index from, Index to) {
    for (Index f = from; f < to; ++f) {
      const Ensemble& held_out = parts_[size_t(f)].held_out;
      const GtvArx arx = smooth_arx(parts_[size_t(f)].training, o);
      Squares& own = result[size_t(f - begin)] =
          Squares(held_out.experiments(), Index(ahead_.horizons.size()) * weights_.size());
      Predictions predictions(held_out, arx, ahead_.horizons);
      for (Index s = ahead_.from; s < held_out.steps(); ++s)
        predictions.add(s, ahead_.all_begin(s, held_out.steps()) ? ahead_.horizons.back() : 1, own);
    }
  });
  return result;
}

HeldOutError RegressionErrors::error_of(const std::vector<Squares>& folds) const {
  return held_out_error(joined(folds), weights_);
}

RegressionErrors::Found RegressionErrors::found(Index lags, double smoothing, const std::vector<Index>& jumps) const {
  return found(squares(0, folds(), lags, smoothing, jumps), lags, smoothing, jumps);
}

RegressionErrors::Found RegressionErrors::found(const std::vector<Squares>& folds, Index lags, double smoothing,
                                                const std::vector<Index>& jumps) const {
  Squares all = joined(folds);
  HeldOutError error = held_out_error(all, weights_);
  return {lags, smoothing, jumps, std::move(all), std::move(error)};
}

}  // namespace tokid
