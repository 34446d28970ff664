// SPDX-License-Identifier: BSD-3-Clause
#include "noise/observer_form.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

namespace tokid {

namespace {

Index largest_lags(const GtvArx& arx) { return std::ranges::max(arx.step, {}, &GtvArxStep::lags).lags; }

// The regressions that predict each step.
class Regressions {
 public:
  Regressions(const GtvArx& arx, Index period, std::vector<GtvArx> first = {})
      : all_(arx), first_(std::move(first)), lags_(largest_lags(arx)), period_(period) {}

  Index lags() const { return lags_; }
  // The coefficients of step k; else those of the first regression, of another period, or of the last step.
  std::pair<const GtvArx&, Index> at(Index k) const {
    if (!first_.empty()) k = std::max<Index>(1, k);
    if (k < Index(first_.size())) return {first_[size_t(k)], k};
    if (period_ > 0) {
      while (k < lags_) k += period_;
      while (k >= all_.steps()) k -= period_;
    }
    return {all_, std::min(k, all_.steps() - 1)};
  }

 private:
  const GtvArx& all_;
  std::vector<GtvArx> first_;  // of the steps 1, 2, …; the one at 0 is empty
  Index lags_, period_;
};

Step observer_step(const Regressions& regressions, Index k, bool feedthrough) {
  const auto [own, at] = regressions.at(k);
  const Index m = own.outputs, p = regressions.lags();
  Step step(p * m, p * m, own.inputs, m);
  step.C().leftCols(m).setIdentity();
  if (feedthrough) step.D() = own.D(at);
  step.A().topRightCorner((p - 1) * m, (p - 1) * m).setIdentity();
  for (Index i = 1; i <= p; ++i) {
    const auto [later, then] = regressions.at(k + i);
    const Matrix a = later.output_block(then, i);
    const auto block = [&](auto&& matrix) { return matrix.middleRows((i - 1) * m, m); };
    block(step.A()).leftCols(m) += a;
    block(step.B()) = a * step.D() + later.input_block(then, i);
    block(step.G()) = -a;
  }
  step.set_lags(std::max<Index>(1, own.step[size_t(at)].lags));
  return step;
}

// The residual covariance of step k. Where each step has its own coefficients, they have used up degrees of freedom.
Matrix covariance(const GtvArx& arx, Index k, bool own) {
  const double rows = double(arx.step[size_t(k)].rows);
  const bool counted = arx.step[size_t(k)].freedom > 0;  // by gtv_arx()
  return arx.residual_cov(k) * (own && !counted ? rows / std::max(1.0, rows - double(arx.regressors(k))) : 1.0);
}

// The mean residual covariance of the steps from `begin` on.
Matrix mean_covariance(const GtvArx& arx, Index begin, bool own) {
  Matrix sum = Matrix::Zero(arx.outputs, arx.outputs);
  double rows = 0.0;
  for (Index k = begin; k < arx.steps(); ++k) {
    const double count = double(arx.step[size_t(k)].rows);
    sum += count * covariance(arx, k, own);
    rows += count;
  }
  return sum / std::max(1.0, rows);
}

bool each_alone(const TimeVariation& variation) { return variation.smoothing == 0 && variation.period == 0; }

// The steps from `begin` to `end`.
void add_steps(const Regressions& regressions, const GtvArx& arx, const TimeVariation& variation, Index begin,
               Index end, Model& model) {
  const bool own = each_alone(variation);
  const Matrix shared = own ? Matrix() : mean_covariance(arx, arx.k_begin, false);
  for (Index k = begin; k < end; ++k) {
    model.step.push_back(observer_step(regressions, k, arx.feedthrough));
    model.step.back().set_innovation_cov(own ? covariance(arx, k, true) : shared);
  }
}

// The covariance of y_0 - D_0 u_0 over the experiments that have these samples.
Matrix covariance_without_past(const Ensemble& e, const Matrix& D) {
  const Matrix error = e.output(0) - e.input(0) * D.transpose();
  Matrix sum = Matrix::Zero(error.cols(), error.cols());
  double count = 0.0;
  for (const auto& row : error.rowwise())
    if (row.allFinite()) sum += row.transpose() * row, ++count;
  return sum / std::max(1.0, count);
}

Model without_steps(const Windows& windows, const TimeVariation& variation, Index k_begin) {
  Model model;
  model.inputs = windows.inputs();
  model.outputs = windows.outputs();
  model.dt = windows.dt;
  model.names = windows.names;
  model.method = "regression";
  model.period = variation.period;
  model.k_begin = k_begin;
  return model;
}

}  // namespace

Model observer_form(const Windows& windows, const GtvArx& arx, const TimeVariation& variation) {
  const Index period = variation.period, p = largest_lags(arx);
  if (period > 0 && arx.steps() < p + std::min(period, arx.steps()))
    throw std::invalid_argument(
        fmt::format("steps: {} found, at least {} needed (lag order and period)", arx.steps(), p + period));
  Model model = without_steps(windows, variation, period > 0 ? 0 : arx.k_begin);
  add_steps({arx, period}, arx, variation, model.k_begin, variation.groups(arx.steps()), model);
  return continued(std::move(model), arx.steps());
}

Model observer_form_from_start(const Ensemble& departures, const GtvArx& arx, const SmoothArxOptions& options) {
  const Index p = options.lags, m = arx.outputs;
  // As many steps as regressions of few lags need to be smooth over time.
  const Ensemble begin = stretch(departures, 0, std::min(departures.steps(), 2 * p));
  std::vector<GtvArx> first(static_cast<size_t>(p));
  std::vector<Matrix> covariances(static_cast<size_t>(p));
  SmoothArxOptions shorter = options;
  for (Index k = 1; k < p; ++k) {
    shorter.lags = k;
    first[size_t(k)] = smooth_arx(begin, shorter);
    covariances[size_t(k)] = mean_covariance(first[size_t(k)], k, each_alone(options.variation));
  }

  const TimeVariation& variation = options.variation;
  Model model = without_steps(departures, variation, 0);
  const Regressions all(arx, 0, std::move(first));
  for (Index k = 0; k < p; ++k) {
    model.step.push_back(observer_step(all, k, arx.feedthrough));
    if (k > 0) model.step.back().set_innovation_cov(covariances[size_t(k)]);
  }
  model.step.front().set_innovation_cov(covariance_without_past(departures, model.step.front().D()));
  add_steps(all, arx, variation, p, arx.steps(), model);
  model.initial_state = InitialState::unknown;
  model.x0_mean = Vector::Zero(p * m);
  model.x0_cov = Matrix::Zero(p * m, p * m);
  return model;
}

}  // namespace tokid
