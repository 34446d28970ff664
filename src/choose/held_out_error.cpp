// SPDX-License-Identifier: BSD-3-Clause
#include "choose/held_out_error.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/step_by_step.hpp"

namespace tokid {

namespace {

// The largest share of squared errors one step ahead: of a model that diverges. More steps ahead it is 1, that of the
// mean motion.
constexpr double diverged = 1e24;

}  // namespace

void Squares::add(Index i, const ConstMatrixRef& predicted, const Ensemble& measured, Index k) {
  const Index m = measured.outputs();
  const auto y = measured.output(k);
  const auto counted = (!(y - predicted).array().isNaN()).eval();
  errors.middleCols(i * m, m).array() += counted.select((y - predicted).array().square(), 0.0);
  outputs.middleCols(i * m, m).array() += counted.select(y.array().square(), 0.0);
}

Squares joined(const std::vector<Squares>& folds) {
  Index experiments = 0;
  for (const Squares& fold : folds) experiments += fold.errors.rows();
  Squares all(experiments, folds.front().errors.cols());
  Index row = 0;
  for (const Squares& fold : folds) {
    all.errors.middleRows(row, fold.errors.rows()) = fold.errors;
    all.outputs.middleRows(row, fold.errors.rows()) = fold.outputs;
    row += fold.errors.rows();
  }
  return all;
}

Index first_scored(InitialState initial, Index lags, Index period) {
  return initial == InitialState::zero ? 0 : period > 0 ? lags : 2 * lags;
}

Ahead ahead_in(const Ensemble& data, Index from, std::vector<Index> horizons, Index period) {
  std::erase_if(horizons, [&](Index h) { return h > 1 && 2 * h > data.steps() - from; });
  return {from, std::move(horizons), period > 1 || data.missing() > 0 ? 1 : 2};
}

Model of_departures(Model model, const Ensemble& data) {
  model.y_nominal = Matrix::Zero(data.steps(), data.outputs());
  model.u_nominal = Matrix::Zero(data.steps(), data.inputs());
  return model;
}

Predicted predicted_by(Model model, const Ensemble& departures, InitialState initial, const Ahead& ahead) {
  const Index m = departures.outputs(), steps = departures.steps();
  Predicted result(ahead.horizons.size(), Matrix::Constant(departures.experiments(), steps * m, nan));
  predict_ahead_each(
      of_departures(std::move(model), departures), departures, initial, ahead.horizons,
      [&](Index s) { return s >= ahead.from && ahead.all_begin(s, steps); },
      [&](Index i, Index k, const Matrix& y) {
        if (k >= ahead.from) result[size_t(i)].middleCols(k * m, m) = y;
      });
  return result;
}

Squares squares_of(const Predicted& predicted, const Ensemble& departures, const Ahead& ahead, const Predicted* like) {
  const Index m = departures.outputs();
  Squares result(departures.experiments(), Index(ahead.horizons.size()) * m);
  for (size_t i = 0; i < predicted.size(); ++i)
    for (Index k = ahead.from; k < departures.steps(); ++k) {
      const auto y = predicted[i].middleCols(k * m, m);
      if (like)
        result.add(Index(i), y + 0.0 * (*like)[i].middleCols(k * m, m), departures, k);
      else
        result.add(Index(i), y, departures, k);
    }
  return result;
}

HeldOutError held_out_error(const Squares& s, const Vector& weights) {
  const Index m = weights.size(), horizons = s.errors.cols() / std::max<Index>(1, m);
  HeldOutError result{0.0, Vector::Zero(horizons), Vector::Zero(s.errors.rows())};
  const double count = double(s.errors.rows());
  for (Index i = 0; i < horizons; ++i) {
    const double cap = i > 0 ? 1.0 : diverged;
    Vector share = Vector::Zero(m);
    bool any = false;
    for (Index j = 0; j < m; ++j) {
      const double y = s.outputs.col(i * m + j).sum();
      if (!(y > 0 && weights(j) > 0)) continue;
      any = true;
      share(j) = s.errors.col(i * m + j).sum() / y;
      if (!(share(j) < cap)) share(j) = cap;
    }
    if (!any && i == 0) result.of_horizon(0) = 0.5 * std::log(diverged);  // the model predicts nothing
    const double least = std::max(1e-300, least_counted * least_counted * share.maxCoeff());
    for (Index j = 0; j < m; ++j) {
      const Index c = i * m + j;
      const double y = s.outputs.col(c).sum(), weight = weights(j) / weights.sum();
      if (!(y > 0 && weight > 0)) continue;
      result.of_horizon(i) += weight * 0.5 * std::log(std::max(share(j), least));
      if (share(j) < least || share(j) >= cap) continue;
      result.influence +=
          weight / double(horizons) * 0.5 * count * (s.errors.col(c) / s.errors.col(c).sum() - s.outputs.col(c) / y);
    }
  }
  result.value = result.of_horizon.mean();
  return result;
}

HeldOutError infinite_error(const Ahead& ahead, Index experiments) {
  const Vector none = Vector::Constant(Index(ahead.horizons.size()), std::numeric_limits<double>::infinity());
  return {none(0), none, Vector::Zero(experiments)};
}

HeldOutErrors errors_at_horizons(const Squares& s, const Vector& weights) {
  const Index m = weights.size(), horizons = s.errors.cols() / m;
  const double count = double(s.errors.rows());
  HeldOutErrors result{Vector::Constant(horizons, nan), Vector::Constant(horizons, nan)};
  for (Index i = 0; i < horizons; ++i) {
    double sum = 0.0, counted = 0.0;
    Vector influence = Vector::Zero(s.errors.rows());
    for (Index c = i * m; c < (i + 1) * m; ++c) {
      const double error = s.errors.col(c).sum(), y = s.outputs.col(c).sum(), weight = weights(c - i * m);
      if (!(y > 0 && weight > 0)) continue;
      const double relative = std::sqrt(error / y);
      sum += weight * relative;
      counted += weight;
      if (error > 0) influence += weight * relative * 0.5 * count * (s.errors.col(c) / error - s.outputs.col(c) / y);
    }
    if (counted == 0) continue;
    result.error(i) = sum / counted;
    result.standard_error(i) = influence.norm() / counted / std::sqrt(count * (count - 1));
  }
  return result;
}

double standard_error(const HeldOutError& a, const HeldOutError& b) {
  const double count = double(a.influence.size());
  return std::sqrt((a.influence - b.influence).squaredNorm() / (count * (count - 1)));
}

bool clearly_smaller(const HeldOutError& a, const HeldOutError& b, double standard_errors) {
  const double error = standard_error(a, b);
  return a.influence.size() > 1 &&
         a.value <
             b.value - (std::isfinite(error) ? standard_errors * error : 0.0);  // no derivative of an infinite value
}

double errors_to_give_up(Index experiments) {
  constexpr double probability = 1e-3;
  return experiments > 1 ? statistics::student_quantile(1 - probability, double(experiments - 1))
                         : std::numeric_limits<double>::infinity();
}

}  // namespace tokid
