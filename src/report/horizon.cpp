// SPDX-License-Identifier: BSD-3-Clause
#include "report/horizon.hpp"

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "model/expected_errors.hpp"
#include "model/initial_state.hpp"
#include "model/observer_step.hpp"
#include "report/bounds.hpp"

namespace tokid::report {

namespace {

// The covariances of the innovations that the model states for its steps. If it states none: the mean covariance of
// `innovations`, for all steps.
std::vector<Matrix> innovation_covariances(const Model& model, const Innovations& innovations) {
  if (model.has(&Step::has_innovation_cov)) {
    std::vector<Matrix> stated;
    for (const Step& step : model.step) stated.emplace_back(step.innovation_cov());
    return stated;
  }
  Matrix sum = Matrix::Zero(model.outputs, model.outputs);
  Index count = 0;
  for (const Matrix& e : innovations)
    for (const auto row : e.rowwise())
      if (row.allFinite()) sum += row.transpose() * row, ++count;
  if (count > 0) sum /= double(count);
  return std::vector<Matrix>(size_t(model.steps()), sum);
}

Vector fits(const Vector& variance, const Vector& spread) {
  return 100 * (1 - variance.cwiseSqrt().array() / spread.array());
}

// Mean of the variances over the samples that are compared, from a step on.
Vector mean_variance(const Matrix& variances, const Ensemble& data, const Ensemble& computed, Index first_step) {
  Vector sum = Vector::Zero(data.outputs()), count = sum;
  for (Index k = first_step; k < data.steps(); ++k)
    for (Index j = 0; j < data.outputs(); ++j) {
      if (std::isnan(variances(k, j))) continue;
      const auto both = !(data.output(k).col(j).array() - computed.output(k).col(j).array()).isNaN();
      sum(j) += double(both.count()) * variances(k, j);
      count(j) += double(both.count());
    }
  return sum.array() / count.array();  // NaN without a compared sample
}

// The effect of the inputs' departures from their mean on each output, in the last of `horizon` steps from a zero
// state. It is the RMS over the experiments and over at most 64 starts.
Vector forced_response(const Model& model, const Ensemble& data, Index begin, Index end, Index horizon) {
  constexpr Index most_starts = 64;
  const Index starts = std::max<Index>(1, end - begin - horizon + 1);
  const Index stride = std::max<Index>(1, (starts + most_starts - 1) / most_starts);
  Vector squares = Vector::Zero(model.outputs);
  double count = 0.0;
  for (Index start = begin; start < begin + starts; start += stride) {
    Matrix x = Matrix::Zero(data.experiments(), model.n(start)), y, next;
    const Index last = std::min(start + horizon, end) - 1;
    for (Index k = start; k <= last; ++k) {
      Matrix u = data.input(k);
      u = u.array().isNaN().select(0.0, u);
      if (data.experiments() > 1) u.rowwise() -= Eigen::RowVectorXd(u.colwise().mean());
      if (k == last) {
        observer::output(model.at(k), x, u, y);
        squares += y.colwise().squaredNorm();
      }
      observer::next_state(model.at(k), x, u, next);
      x.swap(next);
    }
    count += double(data.experiments());
  }
  return (squares / count).cwiseSqrt();
}

}  // namespace

DecidingHorizon deciding_horizon(const Model& model, const Ensemble& data, const Comparison& compared,
                                 const ReportOptions& options, const Vector& spread,
                                 const std::vector<Index>& moving_outputs) {
  if (ends_early(model, data.steps()))
    return deciding_horizon(continued(model, data.steps()), data, compared, options, spread, moving_outputs);
  constexpr Index most_steps = 100;
  const Validation& v = compared.validation;
  DecidingHorizon result;
  result.fit = v.simulation;
  result.stated = model.has(&Step::has_innovation_cov);
  const Index end = std::min(model.k_end(), data.steps());
  if (v.one_step.samples == 0 || model.states() == 0 || moving_outputs.empty()) return result;
  const auto good = [&](const Fit& fit) {
    return std::all_of(moving_outputs.begin(), moving_outputs.end(),
                       [&](Index j) { return fit.fit(j) >= bounds::good_fit; });
  };
  const bool simulates = good(v.simulation);
  if (simulates && good(v.one_step)) return result;
  const std::vector<Matrix> covariances = innovation_covariances(model, compared.prediction.innovations);
  const InitialState initial = initial_state_of(model, data, options.initial_state);
  // If the initial states are unknown, the observer estimates them from the first samples.
  Index begin = std::max(v.first_predicted, model.k_begin);
  if (!starts_from_zero(model, initial))
    begin = std::min(std::max(begin, model.k_begin + estimation_window(model)), end - 1);
  const Index horizons = std::max<Index>(1, std::min({most_steps, end - begin, data.steps() - 1}));
  const Matrix ahead = expected_prediction_errors(model, covariances, begin, end, horizons);
  const Vector simulated = mean_variance(expected_simulation_errors(model, covariances, initial, data.steps()), data,
                                         compared.simulated, options.first_step);
  result.expected_one_step = fits(ahead.row(0).transpose(), spread);
  result.expected_simulation = result.expected = fits(simulated, spread);

  // An exact model predicts well if its errors are small relative to the spread of the outputs, or little larger than
  // its one-step errors.
  const auto well = [&](const Vector& variance) {
    return std::all_of(moving_outputs.begin(), moving_outputs.end(), [&](Index j) {
      const double small = (1 - bounds::expected_fit / 100) * spread(j);
      return !(variance(j) > std::max(small * small, bounds::like_one_step * bounds::like_one_step * ahead(0, j)));
    });
  };
  if (simulates || well(simulated)) return result;
  result.steps = 1;
  while (result.steps < horizons && well(ahead.row(result.steps).transpose())) ++result.steps;
  result.expected = fits(ahead.row(result.steps - 1).transpose(), spread);
  Ensemble computed =
      result.steps == 1 ? compared.prediction.y : predict(model, data, {result.steps, options.initial_state}).y;
  for (Index k = 0; k < std::min(data.steps(), begin + result.steps - 1); ++k) computed.output(k).setConstant(nan);
  result.fit = fit(data, computed, model.y_nominal);
  const Vector forced = forced_response(model, data, begin, end, result.steps);
  for (const Index j : moving_outputs)
    if (result.fit.rmse(j) > 0) result.inputs = std::max(result.inputs, forced(j) / result.fit.rmse(j));
  return result;
}

}  // namespace tokid::report
