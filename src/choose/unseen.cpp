// SPDX-License-Identifier: BSD-3-Clause
#include "choose/unseen.hpp"

#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
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

void add(const Split& data, const Plan& plan, Unseen& result) {
  Model model = realise(data.training, regressions(data.training, plan), data.training.free, plan);
  if (model.steps() == 0) throw std::invalid_argument("experiments: too few found for a model without some of them");
  const Prediction predicted = predict(model, data.held_out, {1, plan.initial_state});
  const Matrix response = root_mean_squares(simulate_data(model, data.held_out, plan.initial_state));
  result.response(data.held_out_rows, Eigen::all) = response;
  for (size_t k = 0; k < result.innovations.size(); ++k)
    result.innovations[k](data.held_out_rows, Eigen::all) = predicted.innovations[k];
}

}  // namespace

std::optional<Unseen> unseen(const Ensemble& measured, const Plan& plan, const std::vector<char>& out,
                             const Execution& execution) {
  const Index N = measured.experiments(), m = measured.outputs(), folds = fold_count(N);
  Unseen result{Innovations(size_t(measured.steps()), Matrix::Constant(N, m, nan)), Matrix::Constant(N, m, nan)};
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

}  // namespace tokid
