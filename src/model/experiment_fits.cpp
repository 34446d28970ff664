// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <utility>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/comparison.hpp"
#include "model/continuation.hpp"
#include "model/error_sums.hpp"
#include "model/step_by_step.hpp"

namespace tokid {

namespace {

// The sums of each output of each experiment.
class Sums {
 public:
  Sums(Index experiments, Index outputs)
      : outputs_(outputs), sums_(size_t(experiments), std::vector<ErrorSums>(size_t(outputs))) {}

  // y and errors (N × m) of one step; a NaN in `errors` is left out
  void add(const Matrix& y, const Matrix& errors) {
    for (Index j = 0; j < outputs_; ++j)
      for (Index n = 0; n < y.rows(); ++n)
        if (const double e = errors(n, j); !std::isnan(e)) sums_[size_t(n)][size_t(j)].add({1, y(n, j), 0.0, e * e});
  }

  // The fits and RMS errors (N × m each).
  std::pair<Matrix, Matrix> fits(bool departures) const {
    Matrix fit(Index(sums_.size()), outputs_), rmse = fit;
    for (Index n = 0; n < fit.rows(); ++n) {
      const Fit one = fit_of(sums_[size_t(n)], departures);
      fit.row(n) = one.fit.transpose();
      rmse.row(n) = one.rmse.transpose();
    }
    return {fit, rmse};
  }

 private:
  Index outputs_;
  std::vector<std::vector<ErrorSums>> sums_;
};

Matrix over_median(const Matrix& rmse) {
  Matrix result = Matrix::Constant(rmse.rows(), rmse.cols(), nan);
  for (Index j = 0; j < rmse.cols(); ++j) {
    std::vector<double> known;
    for (const double error : rmse.col(j))
      if (!std::isnan(error)) known.push_back(error);
    const double usual = statistics::median(std::move(known));
    if (usual > 0) result.col(j) = rmse.col(j) / usual;
  }
  return result;
}

std::vector<Index> by_falling_excess(const Matrix& excess) {
  std::vector<Index> rows(size_t(excess.rows()));
  std::iota(rows.begin(), rows.end(), Index(0));
  const Vector largest = excess.array().isNaN().select(-1.0, excess).rowwise().maxCoeff();
  std::stable_sort(rows.begin(), rows.end(), [&](Index a, Index b) { return largest(a) > largest(b); });
  return rows;
}

}  // namespace

ExperimentFits experiment_fits(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return experiment_fits(continued(model, data.steps()), data, options);
  check_steps(model, data, options);
  Sums simulation(data.experiments(), model.outputs), one_step = simulation;
  Matrix y, error;
  const auto take = [&](Index k) {
    y = data.output(k);
    subtract_nominal(model.y_nominal, k, y);
  };
  predict_each(model, data, options.initial_state, [&](Index k, const Matrix& innovation) {
    if (k < options.first_step) return;
    take(k);
    one_step.add(y, innovation);
  });
  simulate_data_each(model, data, options.initial_state, [&](Index k, const Matrix& simulated) {
    if (k < options.first_step) return;
    take(k);
    error = y - simulated;
    simulation.add(y, error);
  });
  const bool departures = model.y_nominal.rows() > 0;
  ExperimentFits result;
  std::tie(result.simulation_fit, result.simulation_rmse) = simulation.fits(departures);
  std::tie(result.one_step_fit, result.one_step_rmse) = one_step.fits(departures);
  result.excess = over_median(result.one_step_rmse);
  result.worst_first = by_falling_excess(result.excess);
  return result;
}

}  // namespace tokid
