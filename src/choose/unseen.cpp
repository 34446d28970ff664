// SPDX-License-Identifier: BSD-3-Clause
#include "choose/unseen.hpp"

#include <stdexcept>
#include <utility>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "choose/regression.hpp"
#include "data/rows.hpp"
#include "tokid/parallel.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

namespace {

// Fold f as departures. Experiments with 1 in `out` may be held out, but do not train.
Split fold_without(const std::vector<char>& out, const Ensemble& measured, Index f, Index folds, const Plan& plan) {
  const std::vector<Index> held_out = fold_rows(measured.experiments(), f, folds);
  std::vector<Index> training = other_rows(measured.experiments(), held_out);
  std::erase_if(training, [&](Index n) { return out[size_t(n)] != 0; });
  Split parts{measured.subset(training), measured.subset(held_out), held_out};
  if (!plan.nominal) return parts;
  Nominal nominal = nominal_trajectory(parts.training);
  if (plan.nominal_period > 0) share_phases(nominal, plan.nominal_period);
  parts.training = departures(std::move(parts.training), nominal);
  parts.held_out = departures(std::move(parts.held_out), nominal);
  return parts;
}

// RMS of each output of each experiment over the steps that are known; NaN if there are none.
Matrix root_mean_squares(const Ensemble& e) {
  Matrix square = Matrix::Zero(e.experiments(), e.outputs()), count = square;
  for (Index k = 0; k < e.steps(); ++k) {
    const auto known = (!e.output(k).array().isNaN()).eval();
    square.array() += known.select(e.output(k).array().square(), 0.0);
    count.array() += known.cast<double>();
  }
  return (square.array() / count.array()).sqrt();
}

// Adds these experiments, as departures, by a model of departures.
void add(const Model& model, const Ensemble& e, const std::vector<Index>& experiments, const Plan& plan,
         Unseen& result) {
  const Prediction predicted = predict(model, e, {1, plan.initial_state});
  result.response(experiments, Eigen::all) = root_mean_squares(simulate_data(model, e, plan.initial_state));
  for (size_t k = 0; k < result.innovations.size(); ++k)
    result.innovations[k](experiments, Eigen::all) = predicted.innovations[k];
}

void add(const Split& data, const Plan& plan, Unseen& result) {
  const Ensemble& training = data.training;
  const bool enough = plan.coupled || training.experiments() >= experiments_for(training, plan.lags, plan);
  const Model model = enough ? realise(training, regressions(training, plan), training.free, plan) : Model();
  if (model.steps() == 0) throw std::invalid_argument("experiments: too few found for a model without some of them");
  add(model, data.held_out, data.held_out_rows, plan, result);
}

Unseen none_of(const Ensemble& e) {
  return {Innovations(size_t(e.steps()), Matrix::Constant(e.experiments(), e.outputs(), nan)),
          Matrix::Constant(e.experiments(), e.outputs(), nan)};
}

}  // namespace

std::optional<Unseen> unseen(const Ensemble& measured, const Plan& plan, const std::vector<char>& out,
                             const Execution& execution) {
  const Index folds = fold_count(measured.experiments());
  Unseen result = none_of(measured);
  try {
    // Each fold writes rows of its own.
    parallel_for(0, folds, execution, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) add(fold_without(out, measured, f, folds, plan), plan, result);
    });
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
  return result;
}

Unseen seen(const Ensemble& measured, Model model, const Plan& plan) {
  Unseen result = none_of(measured);
  const std::vector<Index> all = range(0, measured.experiments());
  if (model.y_nominal.size() == 0) {
    add(model, measured, all, plan, result);
  } else {
    const Nominal nominal{std::move(model.u_nominal), std::move(model.y_nominal)};
    model.u_nominal = model.y_nominal = {};
    add(model, departures(measured, nominal), all, plan, result);
  }
  return result;
}

}  // namespace tokid
