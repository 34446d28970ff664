// SPDX-License-Identifier: BSD-3-Clause
#include "choose/unseen.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "tokid/parallel.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

namespace {

struct Part {
  std::vector<Index> training, tested;  // rows
};

Part part_of(Index f, Index folds, const std::vector<char>& out) {
  Part part;
  for (Index n = 0; n < Index(out.size()); ++n)
    if (n % folds == f)
      part.tested.push_back(n);
    else if (!out[size_t(n)])
      part.training.push_back(n);
  return part;
}

struct Departing {
  Ensemble training, tested;
};

Departing departing(const Ensemble& measured, const Part& part, const Plan& plan) {
  Departing result{measured.subset(part.training), measured.subset(part.tested)};
  if (!plan.nominal) return result;
  Nominal nominal = nominal_trajectory(result.training);
  if (plan.nominal_period > 0) share_phases(nominal, plan.nominal_period);
  result.training = departures(std::move(result.training), nominal);
  result.tested = departures(std::move(result.tested), nominal);
  return result;
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

void add(const Ensemble& measured, const Part& part, const Plan& plan, Unseen& result) {
  const Departing data = departing(measured, part, plan);
  Model model = realise(data.training, regressions(data.training, plan), data.training.free, plan);
  if (model.steps() == 0) throw std::invalid_argument("experiments: too few found for a model without some of them");
  const Prediction predicted = predict(model, data.tested, {1, plan.initial_state});
  const Matrix response = root_mean_squares(simulate_data(model, data.tested, plan.initial_state));
  for (size_t i = 0; i < part.tested.size(); ++i) {
    result.response.row(part.tested[i]) = response.row(Index(i));
    for (size_t k = 0; k < result.innovations.size(); ++k)
      result.innovations[k].row(part.tested[i]) = predicted.innovations[k].row(Index(i));
  }
}

}  // namespace

std::optional<Unseen> unseen(const Ensemble& measured, const Plan& plan, const std::vector<char>& out,
                             const Execution& execution) {
  const Index N = measured.experiments(), m = measured.outputs(), folds = fold_count(N);
  Unseen result{Innovations(size_t(measured.steps()), Matrix::Constant(N, m, nan)), Matrix::Constant(N, m, nan)};
  try {
    // Each fold writes rows of its own.
    parallel_for(0, folds, {execution.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f)
        if (const Part part = part_of(f, folds, out); !part.tested.empty()) add(measured, part, plan, result);
    });
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
  return result;
}

}  // namespace tokid
