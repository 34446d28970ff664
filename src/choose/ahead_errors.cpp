// SPDX-License-Identifier: BSD-3-Clause
#include "choose/ahead_errors.hpp"

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "choose/held_out_error.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Outputs whose variance is a smaller share of their squared size are exact, and their errors are rounding errors.
constexpr double least_share = 1e-12;

// The variances (m) of the errors of y_k, predicted from step `begin` on, at which the state is known.
Vector variances(const Model& model, Index begin, Index k) {
  Matrix p = Matrix::Zero(model.n(begin), model.n(begin));
  for (Index j = begin; j < k; ++j) {
    const Step& step = model.at(j);
    p = step.A() * p * step.A().transpose() + step.G() * step.innovation_cov() * step.G().transpose();
  }
  const Step& last = model.at(k);
  return (last.C() * p * last.C().transpose() + last.innovation_cov()).diagonal();
}

// The variance of predictions of held-out experiments over models of other experiments, as many as these: by the
// jackknife, the sum of squares over the models of all F folds. It is made of the variance s² of the F - 1 models that
// have seen the experiments, and of the distance of their mean to the model that has not. This distance is larger, and
// the others may be only some of the F - 1. NaN entries stay NaN.
Eigen::ArrayXd spread(const Ensemble& predicted, const std::vector<Ensemble>& by_others, Index folds, Index k,
                      Index output) {
  const double others = double(by_others.size()), all = double(folds) - 1;
  const Eigen::ArrayXd own = predicted.output(k).col(output);
  Eigen::ArrayXd mean = Eigen::ArrayXd::Zero(own.size()), variance = mean;
  for (const Ensemble& other : by_others) mean += other.output(k).col(output).array() / others;
  if (others > 1)
    for (const Ensemble& other : by_others)
      variance += (other.output(k).col(output).array() - mean).square() / (others - 1);
  const Eigen::ArrayXd distance = (own - mean).square() - variance * (1 / others - 1 / all);
  return (all - 1) * variance + all / double(folds) * distance;
}

}  // namespace

AheadErrors& AheadErrors::operator+=(const AheadErrors& other) {
  if (square.size() == 0) return *this = other;
  square += other.square;
  expected += other.expected;
  spread += other.spread;
  return *this;
}

double AheadErrors::ratio() const {
  double sum = 0.0;
  Index count = 0;
  for (Index j = 0; j < square.size(); ++j)
    if (square(j) > 0 && expected(j) > 0) sum += std::log(square(j) / expected(j)) / 2, ++count;
  return count > 0 ? std::exp(sum / double(count)) : nan;
}

double AheadErrors::model_share() const {
  double sum = 0.0;
  Index count = 0;
  for (Index j = 0; j < square.size(); ++j)
    if (square(j) > 0) sum += std::clamp(spread(j) / square(j), 0.0, 1.0), ++count;
  return count > 0 ? sum / double(count) : nan;
}

AheadErrors ahead_errors(const Model& model, const Ensemble& predicted, const std::vector<Ensemble>& by_others,
                         Index folds, const Ensemble& measured, Index horizon) {
  const Vector none = Vector::Zero(model.outputs);
  AheadErrors result{none, none, none};
  const Index end = std::min(model.k_end(), measured.steps());
  for (Index k = model.k_begin + horizon; k < end; ++k) {
    const Vector variance = variances(model, k - horizon + 1, k);
    for (Index j = 0; j < model.outputs; ++j) {
      const Eigen::ArrayXd y = measured.output(k).col(j), e = y - predicted.output(k).col(j).array();
      const double size = y.isFinite().select(y.square(), 0.0).maxCoeff();
      if (!(variance(j) > least_share * size)) continue;
      const Eigen::ArrayXd v = spread(predicted, by_others, folds, k, j);
      const auto both = e.isFinite() && v.isFinite();
      result.square(j) += both.select(e.square(), 0.0).sum();
      result.expected(j) += double(both.count()) * variance(j);
      result.spread(j) += both.select(v, 0.0).sum();
    }
  }
  return result;
}

AheadCertainty ahead_certainty(const std::vector<Model>& models, const std::vector<const Ensemble*>& held_out,
                               Index folds, InitialState initial, int threads) {
  constexpr Index horizon = AheadCertainty::horizon;
  std::vector<AheadErrors> errors(models.size());
  parallel_for(0, Index(models.size()), {threads, {}}, [&](Index begin, Index end) {
    for (size_t f = size_t(begin); f < size_t(end); ++f) {
      const Ensemble& measured = *held_out[f];
      const Index h = std::min(horizon, std::max<Index>(1, measured.steps() - 1));
      const auto predicted = [&](size_t g) {
        return predict(of_departures(models[g], measured), measured, {h, initial}).y;
      };
      std::vector<Ensemble> by_others;
      for (size_t g = 0; g < models.size(); ++g)
        if (g != f) by_others.push_back(predicted(g));
      errors[f] = ahead_errors(models[f], predicted(f), by_others, folds, measured, horizon);
    }
  });
  AheadErrors sum;
  for (const AheadErrors& fold : errors) sum += fold;
  return {sum.ratio(), sum.model_share()};
}

}  // namespace tokid
