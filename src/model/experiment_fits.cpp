// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/comparison.hpp"
#include "model/continuation.hpp"
#include "model/error_sums.hpp"
#include "model/outlying_samples.hpp"
#include "model/step_by_step.hpp"

namespace tokid {

namespace {

// Collects the errors of each output of each experiment.
class ExperimentErrors {
 public:
  ExperimentErrors(const Model& model, const Ensemble& data)
      : model_(model),
        data_(data),
        simulation_(size_t(data.experiments()), std::vector<ErrorSums>(size_t(data.outputs()))),
        one_step_(simulation_) {}

  // Errors (N × m) of step k. NaN: no error.
  void predicted(Index k, const Matrix& errors) { add(k, errors, one_step_); }
  void simulated(Index k, const Matrix& errors) { add(k, errors, simulation_); }

  ExperimentFits fits() const;

 private:
  using Sums = std::vector<std::vector<ErrorSums>>;  // (N) of (m)

  void add(Index k, const Matrix& errors, Sums& sums) const {
    for (Index j = 0; j < errors.cols(); ++j) {
      const double nominal = k < model_.y_nominal.rows() ? model_.y_nominal(k, j) : 0.0;
      for (Index n = 0; n < errors.rows(); ++n)
        if (const double e = errors(n, j); !std::isnan(e))
          sums[size_t(n)][size_t(j)].add({1, data_.y(n, k, j) - nominal, 0.0, e * e});
    }
  }

  const Model& model_;
  const Ensemble& data_;
  Sums simulation_, one_step_;
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

// The largest error that is not outlying.
double limit_of(const Vector& errors) {
  std::vector<double> finite;
  for (const double error : errors)
    if (std::isfinite(error)) finite.push_back(error);
  return finite.empty() ? nan
                        : std::max(least_outlying_error, outlying_experiment * statistics::median(std::move(finite)));
}

std::vector<Index> by_falling_excess(const Vector& excess) {
  std::vector<Index> rows(size_t(excess.size()));
  std::iota(rows.begin(), rows.end(), Index(0));
  const Vector known = excess.array().isNaN().select(-1.0, excess);
  std::stable_sort(rows.begin(), rows.end(), [&](Index a, Index b) { return known(a) > known(b); });
  return rows;
}

ExperimentFits ExperimentErrors::fits() const {
  const Index experiments = data_.experiments(), outputs = data_.outputs();
  const bool departures = model_.y_nominal.rows() > 0;
  const Vector spread = output_spread(model_, data_);
  ExperimentFits result;
  // Returns the parts (N × m) of the outputs in the squared error of each experiment.
  const auto set = [&](const Sums& sums, Matrix& fit, Matrix& rmse, ExperimentFits::Counts& samples, Vector& error) {
    Matrix part(experiments, outputs);
    fit.resize(experiments, outputs);
    rmse.resize(experiments, outputs);
    samples.resize(experiments, outputs);
    error.resize(experiments);
    for (Index n = 0; n < experiments; ++n) {
      const Fit one = fit_of(sums[size_t(n)], departures);
      fit.row(n) = one.fit.transpose();
      rmse.row(n) = one.rmse.transpose();
      double squares = 0.0;
      for (Index j = 0; j < outputs; ++j) {
        const ErrorSums& sum = sums[size_t(n)][size_t(j)];
        samples(n, j) = sum.count;
        part(n, j) = sum.error / (spread(j) * spread(j));
        squares += part(n, j);
      }
      error(n) = samples.row(n).sum() > 0 ? std::sqrt(squares / double(samples.row(n).sum())) : nan;
    }
    return part;
  };
  const Matrix simulated = set(simulation_, result.simulation_fit, result.simulation_rmse, result.simulation_samples,
                               result.simulation_error);
  const Matrix predicted =
      set(one_step_, result.one_step_fit, result.one_step_rmse, result.one_step_samples, result.one_step_error);
  result.over_median = over_median(result.one_step_rmse);
  result.simulation_limit = limit_of(result.simulation_error);
  result.one_step_limit = limit_of(result.one_step_error);
  result.excess.resize(experiments);
  result.worst_output.resize(size_t(experiments));
  for (Index n = 0; n < experiments; ++n) {
    const double of_simulation = result.simulation_error(n) / result.simulation_limit;
    const double of_predictions = result.one_step_error(n) / result.one_step_limit;
    result.excess(n) = std::fmax(of_simulation, of_predictions);  // leaves out NaN
    if (std::isnan(result.excess(n))) continue;
    Index worst = 0;
    (of_simulation == result.excess(n) ? simulated : predicted).row(n).maxCoeff(&worst);
    result.worst_output[size_t(n)] = worst;
  }
  result.worst_first = by_falling_excess(result.excess);
  return result;
}

}  // namespace

ExperimentFits experiment_fits(const Model& model, const Ensemble& data, const Innovations& innovations,
                               const Ensemble& simulated, Index first_step) {
  ExperimentErrors errors(model, data);
  for (Index k = first_step; k < data.steps(); ++k) {
    errors.predicted(k, innovations[size_t(k)]);
    errors.simulated(k, data.output(k) - simulated.output(k));
  }
  return errors.fits();
}

ExperimentFits experiment_fits(const Model& model, const Ensemble& data, const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return experiment_fits(continued(model, data.steps()), data, options);
  check_steps(model, data, options);
  ExperimentErrors errors(model, data);
  predict_each(model, data, options.initial_state, [&](Index k, const Matrix& innovation) {
    if (k >= options.first_step) errors.predicted(k, innovation);
  });
  Matrix error;
  simulate_data_each(model, data, options.initial_state, [&](Index k, const Matrix& simulated) {
    if (k < options.first_step) return;
    error = data.output(k) - simulated;
    subtract_nominal(model.y_nominal, k, error);
    errors.simulated(k, error);
  });
  return errors.fits();
}

}  // namespace tokid
