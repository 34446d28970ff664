// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/channels.hpp"
#include "model/observer_step.hpp"
#include "model/smoother.hpp"
#include "model/step_by_step.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Inputs and outputs of one step as departures from the nominal trajectory.
void input_departure(const Model& model, const Ensemble& data, Index k, Matrix& u) {
  u = data.input(k);
  if (k < model.u_nominal.rows()) u.rowwise() -= model.u_nominal.row(k);
}

void output_departure(const Model& model, const Ensemble& data, Index k, Matrix& y) {
  y = data.output(k);
  if (k < model.y_nominal.rows()) y.rowwise() -= model.y_nominal.row(k);
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

// The observer for all experiments, with one row for each. An experiment is blind while its state is not known. The
// predictions of a blind experiment are NaN until enough samples determine its state again.
class Observer {
 public:
  // Starts at step k. x is the state of all experiments, if it is known.
  Observer(const Model& model, const Ensemble& data, Index k, const std::optional<Vector>& x)
      : model_(model),
        data_(data),
        window_(estimation_window(model)),
        k_(k),
        x_(Matrix::Zero(data.experiments(), model.n(k))),
        since_(size_t(data.experiments()), x ? sees : k),
        all_see_(x.has_value()) {
    if (x) x_.rowwise() += x->transpose();
  }

  Index k() const { return k_; }

  // x̂_k, with rows of NaN where the state is not known.
  Matrix state() const {
    Matrix x = x_;
    blank(x);
    return x;
  }

  // Advances to step k+1. Returns ŷ_k and y_k - ŷ_k (N × m), with rows of NaN where x̂_k is not known.
  void advance(Matrix& y, Matrix& innovation) {
    input_departure(model_, data_, k_, u_);
    const bool inputs_missing = !std::isfinite(u_.sum());  // true at least if one is missing
    if (inputs_missing) {
      for (Index n = 0; n < u_.rows(); ++n) {
        if (u_.row(n).allFinite()) continue;
        u_.row(n).setZero();
        since_[size_t(n)] = k_ + 1;
        all_see_ = false;
      }
    }
    correct(k_, data_, x_, y, innovation);
    blank(y);
    blank(innovation);
    ++k_;
    if (k_ < model_.k_end()) recover();
  }

 private:
  // Sets the rows of blind experiments to NaN.
  void blank(Matrix& rows) const {
    if (all_see_) return;
    for (size_t n = 0; n < since_.size(); ++n)
      if (since_[n] != sees) rows.row(Index(n)).setConstant(nan);
  }

  // x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) from the inputs u_                                       (9)
  void correct(Index k, const Ensemble& data, Matrix& x, Matrix& y, Matrix& innovation) {
    const Step& step = model_.at(k);
    observer::output(step, x, u_, y);
    output_departure(model_, data, k, innovation);
    innovation -= y;
    seen_ = innovation;
    if (!std::isfinite(seen_.sum())) fill_in(step, seen_);
    observer::next_state(step, x, u_, seen_, next_);
    x.swap(next_);
  }

  // Estimates missing innovations from the available ones of the same step: E[ε_q | ε_o] = S_qo S_oo⁻¹ ε_o, with q
  // missing and o available. This is necessary, because the gain may use several outputs to cancel their common noise.
  // If the model has no covariance S, missing innovations become zero.
  void fill_in(const Step& step, Matrix& innovations) const {
    std::vector<Index> seen, missing, before;
    Matrix conditional;  // (missing × seen), the same for experiments with the same gaps
    for (Index n = 0; n < innovations.rows(); ++n) {
      missing.clear();
      seen.clear();
      for (Index j = 0; j < innovations.cols(); ++j) (std::isnan(innovations(n, j)) ? missing : seen).push_back(j);
      if (missing.empty()) continue;
      if (seen.empty() || !model_.has(&Step::has_innovation_cov)) {
        for (const Index j : missing) innovations(n, j) = 0.0;
        continue;
      }
      if (missing != before) {
        const Step::View covariance = step.innovation_cov();
        const Matrix whitener = linalg::whitener(covariance(seen, seen));
        conditional = covariance(missing, seen) * whitener.transpose() * whitener;
        before = missing;
      }
      const Vector known = innovations(n, seen).transpose();
      innovations(n, missing) = (conditional * known).transpose();
    }
  }

  // Restores the state of a blind experiment if its recent samples determine the state. If the window is too short, it
  // grows up to twice its size.
  void recover() {
    if (all_see_) return;
    std::map<Index, std::vector<Index>> windows;  // first step → experiments
    for (size_t n = 0; n < since_.size(); ++n) {
      if (since_[n] == sees || k_ - since_[n] < window_) continue;
      const Index from = std::max(since_[n], k_ - 2 * window_);
      if (may_determine(Index(n), from)) windows[from].push_back(Index(n));
    }
    for (const auto& [from, rows] : windows) {
      const Ensemble part = data_.subset(rows);
      Matrix x = estimate_state(model_, part, from, k_ - from).transpose();
      for (Index k = from; k < k_; ++k) {
        input_departure(model_, part, k, u_);
        correct(k, part, x, y_, innovation_);
      }
      for (size_t i = 0; i < rows.size(); ++i) {
        if (!x.row(Index(i)).allFinite()) continue;
        x_.row(rows[i]) = x.row(Index(i));
        since_[size_t(rows[i])] = sees;
      }
    }
    all_see_ = std::all_of(since_.begin(), since_.end(), [](Index k) { return k == sees; });
  }

  bool may_determine(Index n, Index from) const {
    Index samples = 0;
    for (Index k = from; k < k_; ++k) {
      if (!data_.input(k).row(n).allFinite()) return false;
      for (const double y : data_.output(k).row(n)) samples += std::isfinite(y);
    }
    return samples >= model_.n(from);
  }

  static constexpr Index sees = -1;

  const Model& model_;
  const Ensemble& data_;
  Index window_, k_;
  Matrix x_;                  // (N × n_k)
  std::vector<Index> since_;  // (N) first step after the loss of the state, or `sees`
  bool all_see_;
  Matrix u_, y_, innovation_, seen_, next_;  // values of one step
};

}  // namespace

namespace {

// The outputs at step k + ahead - 1, simulated from the state x (N × n_k) at step k.
Matrix outputs_ahead(const Model& model, const Ensemble& data, Index k, Matrix x, Index ahead) {
  Matrix u, next, y;
  for (const Index last = k + ahead - 1; k < last; ++k) {
    input_departure(model, data, k, u);
    observer::next_state(model.at(k), x, u, next);
    x.swap(next);
  }
  input_departure(model, data, k, u);
  observer::output(model.at(k), x, u, y);
  return y;
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
  const InitialState initial = options.initial_state.value_or(data.initial_state.value_or(model.initial_state));
  if (starts_from_zero(model, initial)) return Vector::Zero(model.n(model.k_begin));
  if (options.initial_estimate && has_initial_estimate(model, initial)) return model.x0_mean;
  return std::nullopt;
}

// At each step, calls before(k, state) with a function that gives x̂_k (N × n_k), then after(k, ŷ_k, y_k - ŷ_k). Rows
// are NaN where the state is not known.
template <class Before, class After>
void observe(const Model& model, const Ensemble& data, const PredictOptions& options, Before&& before, After&& after) {
  if (model.steps() == 0) return;
  const InitialState initial = options.initial_state.value_or(data.initial_state.value_or(model.initial_state));
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
  Observer observer(model, data, start ? model.k_begin : model.full_begin(), start);
  for (Matrix y, innovation; observer.k() < end;) {
    checkpoint();
    const Index k = observer.k();
    before(k, [&observer] { return observer.state(); });
    observer.advance(y, innovation);
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

// Directions of the state count as not observed if their effect on the samples is below this share of the largest
// effect.
constexpr double unseen = 1e-12;

// The states of experiments with the same pattern of available samples. They are NaN if these samples do not determine
// all of the state.
Matrix estimate_alike(const Model& model, const Ensemble& data, Index k, Index window, const Matrix& whitener) {
  const Index m = model.outputs, experiments = data.experiments(), n = model.n(k);
  Matrix sensitivity(window * m, n), innovations(window * m, experiments);
  Matrix transition = Matrix::Identity(n, n);  // transition of the error of x_k through the observer
  Matrix x = Matrix::Zero(experiments, n), u, innovation, next;
  for (Index j = k; j < k + window; ++j) {
    const Step& step = model.at(j);
    input_departure(model, data, j, u);
    observer::innovation(step, x, u, output_departure(model, data, j), innovation);
    Vector present = Vector::Ones(m);
    for (Index i = 0; i < m; ++i)
      if (!std::isfinite(data.y(0, j, i))) present(i) = 0.0, innovation.col(i).setZero();
    const Matrix seen = present.asDiagonal() * step.C();
    sensitivity.middleRows((j - k) * m, m) = whitener * seen * transition;
    innovations.middleRows((j - k) * m, m) = whitener * innovation.transpose();
    observer::next_state(step, x, u, innovation, next);
    x.swap(next);
    transition = (step.A() + step.G() * seen) * transition;
  }
  const linalg::MinimumNorm solution = linalg::minimum_norm(sensitivity, innovations, unseen);
  return solution.rank < n ? Matrix::Constant(n, experiments, nan) : solution.x;
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
  // One whitener for the whole window, because rounding errors may make the covariance of a single step singular.
  Matrix covariance = Matrix::Zero(model.outputs, model.outputs);
  if (model.has(&Step::has_innovation_cov))
    for (Index j = k; j < k + window; ++j) covariance += model.at(j).innovation_cov();
  const Matrix whitener = linalg::whitener(covariance);

  std::map<std::vector<bool>, std::vector<Index>> groups;
  for (Index n = 0; n < data.experiments(); ++n) groups[pattern(data, n, k, window)].push_back(n);
  Matrix x = Matrix::Constant(model.n(k), data.experiments(), nan);
  for (const auto& [present, rows] : groups) {
    bool inputs_known = true;
    for (size_t c = 0; c < present.size(); ++c)
      inputs_known = inputs_known && (present[c] || Index(c) % data.channels() >= data.inputs());
    if (!inputs_known) continue;
    x(Eigen::all, rows) = estimate_alike(model, data.subset(rows), k, window, whitener);
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
  const InitialState initial = initial_state.value_or(data.initial_state.value_or(model.initial_state));
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
