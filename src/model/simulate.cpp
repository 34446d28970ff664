// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/channels.hpp"
#include "model/continuation.hpp"
#include "model/initial_state.hpp"
#include "model/observer_rows.hpp"
#include "model/observer_step.hpp"
#include "model/smoother.hpp"
#include "model/state_estimate.hpp"
#include "model/step_by_step.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Inputs and outputs of one step as departures from the nominal trajectory.
void input_departure(const Model& model, const Ensemble& data, Index k, Matrix& u) {
  u = data.input(k);
  subtract_nominal(model.u_nominal, k, u);
}

void output_departure(const Model& model, const Ensemble& data, Index k, Matrix& y) {
  y = data.output(k);
  subtract_nominal(model.y_nominal, k, y);
}

Matrix output_departure(const Model& model, const Ensemble& data, Index k) {
  Matrix y;
  output_departure(model, data, k, y);
  return y;
}

// An ensemble with the given inputs, in which the outputs are missing.
Ensemble outputs_for(const Model& model, const Ensemble& inputs) {
  // If the data state no sample time, the result gets that of the model.
  Ensemble result(inputs.experiments(), inputs.steps(), model.inputs, model.outputs,
                  inputs.dt_stated ? inputs.dt : model.dt);
  result.dt_stated = inputs.dt_stated || model.provenance.dt_stated;
  for (Index k = 0; k < inputs.steps(); ++k) result.input(k) = inputs.input(k);
  result.names = model.names;
  result.length = inputs.length;
  result.experiment_names = inputs.experiment_names;
  result.initial_state = inputs.initial_state;
  return result;
}

void store_output(const Model& model, Index k, const Matrix& y, Ensemble& result) {
  auto stored = result.output(k);
  stored = y;
  if (k < model.y_nominal.rows()) stored.rowwise() += model.y_nominal.row(k);
}

}  // namespace

Ensemble simulate(const Model& model, const Ensemble& inputs, const Matrix& x0) {
  if (ends_early(model, inputs.steps())) return simulate(continued(model, inputs.steps()), inputs, x0);
  check_channels(model, inputs, false);
  const Index experiments = inputs.experiments();
  Ensemble result = outputs_for(model, inputs);
  if (model.steps() == 0) return result;
  const Index n0 = model.n(model.k_begin);
  if (x0.size() > 0 && (x0.rows() != n0 || x0.cols() != experiments))
    throw std::invalid_argument(
        fmt::format("x0: {} x {} found, {} states x {} experiments needed", x0.rows(), x0.cols(), n0, experiments));
  Matrix x = Matrix::Zero(experiments, n0);
  if (x0.size() > 0)
    x = x0.transpose();
  else if (has_initial_estimate(model, inputs.initial_state.value_or(model.initial_state)))
    x.rowwise() += model.x0_mean.transpose();
  simulate_each(model, inputs, model.k_begin, std::move(x),
                [&](Index k, const Matrix& y) { store_output(model, k, y, result); });
  return result;
}

void simulate_each(const Model& model, const Ensemble& inputs, Index k, Matrix x,
                   const std::function<void(Index, const Matrix&)>& use) {
  Matrix u, y, next;
  for (const Index end = std::min(model.k_end(), inputs.steps()); k < end; ++k) {
    checkpoint();
    input_departure(model, inputs, k, u);
    observer::output(model.at(k), x, u, y);
    use(k, y);
    observer::next_state(model.at(k), x, u, next);
    x.swap(next);
  }
}

namespace {

// The outputs at step `last`, simulated from the state x (N × n_k) at step k. Both move on to this step.
Matrix outputs_at(const Model& model, const Ensemble& data, Index last, Index& k, Matrix& x) {
  Matrix u, next, y;
  for (; k < last; ++k) {
    input_departure(model, data, k, u);
    observer::next_state(model.at(k), x, u, next);
    x.swap(next);
  }
  input_departure(model, data, k, u);
  observer::output(model.at(k), x, u, y);
  return y;
}

// The outputs at step k + ahead - 1, simulated from the state x at step k.
Matrix outputs_ahead(const Model& model, const Ensemble& data, Index k, Matrix x, Index ahead) {
  return outputs_at(model, data, k + ahead - 1, k, x);
}

bool knows_noise(const Model& model) { return model.has(&Step::has_Q) && model.has(&Step::has_R); }

bool samples_missing(const Ensemble& data, Index begin, Index end) {
  return end > begin && data.samples().middleCols(begin * data.channels(), (end - begin) * data.channels()).hasNaN();
}

// E[x_k | samples before k] (N × n_k) from the first step of the model on; samples may be missing.
std::vector<Matrix> filtered_states(Model model, const Ensemble& data, bool from_zero) {
  if (from_zero) model.x0_mean.resize(0), model.x0_cov.resize(0, 0);
  return kalman::predicted_states(model, kalman::samples_of(model, data, kalman::Tail::keep));
}

}  // namespace

void check_horizon(Index horizon, Index steps) {
  if (horizon < 1) throw std::invalid_argument(fmt::format("horizon: {} found, at least 1 needed", horizon));
  if (horizon > 1 && horizon >= steps)
    throw std::invalid_argument(fmt::format(
        "horizon: {} found, at most {} needed: the data have {} steps, and a prediction over all of them is a "
        "simulation",
        horizon, std::max<Index>(1, steps - 1), steps));
}

namespace {

// The state at the first step, if it is known.
std::optional<Vector> known_start(const Model& model, const Ensemble& data, const PredictOptions& options) {
  const InitialState initial = initial_state_of(model, data, options.initial_state);
  return observer::known_start(model, initial, options.initial_estimate);
}

// At each step, calls before(k, state) with a function that gives x̂_k (N × n_k), then after(k, ŷ_k, y_k - ŷ_k). Rows
// are NaN where the state is not known.
template <class Before, class After>
void observe(const Model& model, const Ensemble& data, const PredictOptions& options, Before&& before, After&& after) {
  if (model.steps() == 0) return;
  const InitialState initial = initial_state_of(model, data, options.initial_state);
  const Index end = std::min(model.k_end(), data.steps());
  const std::optional<Vector> start = known_start(model, data, options);
  if (start && knows_noise(model) && samples_missing(data, model.k_begin, end)) {
    const std::vector<Matrix> states = filtered_states(model, data, starts_from_zero(model, initial));
    for (Index k = model.k_begin; k < end; ++k) {
      const Matrix& x = states[model.index(k)];
      before(k, [&x] { return x; });
      const Matrix y = outputs_ahead(model, data, k, x, 1);
      after(k, y, output_departure(model, data, k) - y);
    }
    return;
  }
  observer::Rows rows(model, data.experiments(), observer::first_step(model, start), start);
  Matrix u, measured, y(data.experiments(), model.outputs), innovation(y);
  while (rows.k() < end) {
    checkpoint();
    const Index k = rows.k();
    before(k, [&rows] { return rows.state(); });
    input_departure(model, data, k, u);
    output_departure(model, data, k, measured);
    rows.advance(observer::Rows::of(u), observer::Rows::of(measured), y, innovation);
    after(k, y, innovation);
  }
}

}  // namespace

void predict_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                  const std::function<void(Index, const Matrix&)>& use) {
  check_channels(model, data, true);
  observe(
      model, data, {1, initial_state}, [](Index, auto&&) {},
      [&](Index k, const Matrix&, const Matrix& innovation) { use(k, innovation); });
}

void predict_ahead_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                        const std::vector<Index>& horizons, const std::function<bool(Index)>& begins,
                        const std::function<void(Index, Index, const Matrix&)>& use) {
  if (ends_early(model, data.steps()))
    return predict_ahead_each(continued(model, data.steps()), data, initial_state, horizons, begins, use);
  check_channels(model, data, true);
  observe(
      model, data, {1, initial_state},
      [&](Index begin, auto&& state) {
        if (horizons.size() < 2 || !begins(begin)) return;
        Matrix x = state();
        Index k = begin;
        for (size_t i = 1; i < horizons.size(); ++i) {
          const Matrix y = outputs_at(model, data, begin + horizons[i] - 1, k, x);
          use(Index(i), k, y);
        }
      },
      [&](Index k, const Matrix& predicted, const Matrix&) { use(0, k, predicted); });
}

Prediction predict(const Model& model, const Ensemble& data, const PredictOptions& options) {
  if (ends_early(model, data.steps())) return predict(continued(model, data.steps()), data, options);
  check_channels(model, data, true);
  const Index horizon = options.horizon;
  check_horizon(horizon, data.steps());
  const Index end = std::min(model.k_end(), data.steps());

  Prediction result{outputs_for(model, data), {}};
  result.innovations.assign(size_t(data.steps()), Matrix::Constant(data.experiments(), model.outputs, nan));
  // At the first steps, fewer than `horizon` steps after the start, a known initial state is the latest information.
  if (const std::optional<Vector> start = known_start(model, data, options)) {
    const Matrix x = start->transpose().replicate(data.experiments(), 1);
    for (Index ahead = 1; ahead < horizon && model.k_begin + ahead - 1 < end; ++ahead)
      store_output(model, model.k_begin + ahead - 1, outputs_ahead(model, data, model.k_begin, x, ahead), result.y);
  }
  observe(
      model, data, options,
      [&](Index k, auto&& state) {
        if (horizon > 1 && horizon <= end - k)
          store_output(model, k + horizon - 1, outputs_ahead(model, data, k, state(), horizon), result.y);
      },
      [&](Index k, const Matrix& y, const Matrix& innovation) {
        result.innovations[size_t(k)] = innovation;
        if (horizon == 1) store_output(model, k, y, result.y);
      });
  return result;
}

namespace {

// The pattern of available samples of one experiment in a window: for each step, one flag per input and one per output.
std::vector<bool> pattern(const Ensemble& data, Index n, Index k, Index window) {
  std::vector<bool> present;
  for (Index j = k; j < k + window; ++j) {
    for (Index i = 0; i < data.inputs(); ++i) present.push_back(std::isfinite(data.u(n, j, i)));
    for (Index i = 0; i < data.outputs(); ++i) present.push_back(std::isfinite(data.y(n, j, i)));
  }
  return present;
}

}  // namespace

Matrix estimate_state(const Model& model, const Ensemble& data, Index k, Index window) {
  if (ends_early(model, std::min(k + window, data.steps())))
    return estimate_state(continued(model, data.steps()), data, k, window);
  check_channels(model, data, true);
  if (k < model.k_begin || window < 1 || k + window > std::min(model.k_end(), data.steps()))
    throw std::invalid_argument(fmt::format(
        "estimate_state: steps {} to {} found, steps within {} to {} needed, which model and data both have", k,
        k + window - 1, model.k_begin, std::min(model.k_end(), data.steps()) - 1));
  std::map<std::vector<bool>, std::vector<Index>> groups;
  for (Index n = 0; n < data.experiments(); ++n) groups[pattern(data, n, k, window)].push_back(n);
  Matrix x = Matrix::Constant(model.n(k), data.experiments(), nan);
  for (const auto& [present, rows] : groups) {
    bool inputs_known = true;
    for (size_t c = 0; c < present.size(); ++c)
      inputs_known = inputs_known && (present[c] || Index(c) % data.channels() >= data.inputs());
    if (!inputs_known) continue;
    const Ensemble part = data.subset(rows);
    observer::Window samples{k, std::vector<Matrix>(size_t(window)), std::vector<Matrix>(size_t(window))};
    for (Index j = 0; j < window; ++j) {
      input_departure(model, part, k + j, samples.u[size_t(j)]);
      output_departure(model, part, k + j, samples.y[size_t(j)]);
    }
    x(Eigen::all, rows) = observer::estimate(model, samples).transpose();
  }
  return x;
}

namespace {

// The start of a simulation of data: the step, and the states there (N × n_k).
struct Start {
  Index k;
  Matrix x;
};

// Empty if the data do not determine the states.
std::optional<Start> start_of(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  const InitialState initial = initial_state_of(model, data, initial_state);
  if (starts_from_zero(model, initial))
    return Start{model.k_begin, Matrix::Zero(data.experiments(), model.n(model.k_begin))};
  if (has_initial_estimate(model, initial) && knows_noise(model))
    return Start{model.k_begin, kalman::smoothed_first_states(model, kalman::samples_of(model, data, kalman::Tail::drop,
                                                                                        estimation_window(model)))};
  const Index k = model.full_begin(), window = estimation_window(model);
  if (k + window > std::min(model.k_end(), data.steps())) return std::nullopt;
  return Start{k, estimate_state(model, data, k, window).transpose()};
}

}  // namespace

void simulate_data_each(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state,
                        const std::function<void(Index, const Matrix&)>& use) {
  if (std::optional<Start> start = start_of(model, data, initial_state))
    simulate_each(model, data, start->k, std::move(start->x), use);
}

Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  if (ends_early(model, data.steps())) return simulate_data(continued(model, data.steps()), data, initial_state);
  check_channels(model, data, false);
  Ensemble result = outputs_for(model, data);
  simulate_data_each(model, data, initial_state, [&](Index k, const Matrix& y) { store_output(model, k, y, result); });
  return result;
}

}  // namespace tokid
