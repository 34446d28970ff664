// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "base/nan.hpp"
#include "linalg/tall_product.hpp"
#include "model/channels.hpp"
#include "model/step_by_step.hpp"
#include "noise/em/smoother.hpp"
#include "tokid/identify.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Names need not be there.
void check_names(const char* name, const std::vector<std::string>& names, Index needed) {
  if (!names.empty() && Index(names.size()) != needed)
    throw std::invalid_argument(fmt::format("model: {} entries of {} found, {} needed", names.size(), name, needed));
}

constexpr std::pair<const char*, bool (Step::*)() const> besides[] = {{"innovation_cov", &Step::has_innovation_cov},
                                                                      {"Q", &Step::has_Q},
                                                                      {"R", &Step::has_R},
                                                                      {"K", &Step::has_K},
                                                                      {"singular_values", &Step::has_singular_values},
                                                                      {"condition", &Step::has_condition},
                                                                      {"rank", &Step::has_rank},
                                                                      {"lags", &Step::has_lags}};

void check_step(const Model& model, Index s) {
  const Step& step = model.step[size_t(s)];
  if (!step.has_matrices()) throw std::invalid_argument(fmt::format("model: step {} has no matrices", s));
  if (step.inputs() != model.inputs || step.outputs() != model.outputs)
    throw std::invalid_argument(fmt::format("model: step {} has {} inputs and {} outputs, {} and {} needed", s,
                                            step.inputs(), step.outputs(), model.inputs, model.outputs));
  if (s > 0 && step.states() != model.step[size_t(s) - 1].next_states())
    throw std::invalid_argument(fmt::format("model: A[{}] has {} columns, {} needed: the rows of A[{}]", s,
                                            step.states(), model.step[size_t(s) - 1].next_states(), s - 1));
  for (const auto& [name, has] : besides)
    if ((step.*has)() != model.has(has))
      throw std::invalid_argument(fmt::format("model: {} is known of step {} or of step 0, not of both", name, s));
  const auto finite = [&](const char* name, const Step::View& a) {
    if (!a.allFinite())
      throw std::invalid_argument(fmt::format("model: {}[{}] has a value that is not finite", name, s));
  };
  finite("A", step.A());
  finite("B", step.B());
  finite("C", step.C());
  finite("D", step.D());
  finite("G", step.G());
  if (step.has_innovation_cov()) finite("innovation_cov", step.innovation_cov());
  if (step.has_Q()) finite("Q", step.Q());
  if (step.has_R()) finite("R", step.R());
  if (step.has_K()) finite("K", step.K());
}

// Inputs and outputs of one step as departures from the nominal trajectory.
void input_departure(const Model& model, const Ensemble& data, Index k, Matrix& u) {
  u = data.input(k);
  if (k < model.u_nominal.rows()) u.rowwise() -= model.u_nominal.row(k);
}

Matrix input_departure(const Model& model, const Ensemble& data, Index k) {
  Matrix u;
  input_departure(model, data, k, u);
  return u;
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

// The ensemble of the given inputs, with the model's outputs still missing.
Ensemble outputs_for(const Model& model, const Ensemble& inputs) {
  // Inputs without a sample time have the model's.
  Ensemble result(inputs.experiments(), inputs.steps(), model.inputs, model.outputs,
                  inputs.dt_stated ? inputs.dt : model.dt);
  result.dt_stated = inputs.dt_stated || states_dt(model);
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

// Experiments as rows: z = x aᵀ + u bᵀ.
void combine(const Matrix& x, const ConstMatrixRef& a, const Matrix& u, const ConstMatrixRef& b, Matrix& z) {
  z.resize(x.rows(), a.rows());
  linalg::tall_products({{x, a}, {u, b}}, z);
}

// y = x Cᵀ + u Dᵀ
void output(const Model& model, Index k, const Matrix& x, const Matrix& u, Matrix& y) {
  const size_t s = model.index(k);
  combine(x, model.step[s].C(), u, model.step[s].D(), y);
}

Matrix output(const Model& model, Index k, const Matrix& x, const Matrix& u) {
  Matrix y;
  output(model, k, x, u, y);
  return y;
}

// x⁺ = x Aᵀ + u Bᵀ
void next_state(const Model& model, Index k, const Matrix& x, const Matrix& u, Matrix& next) {
  const size_t s = model.index(k);
  combine(x, model.step[s].A(), u, model.step[s].B(), next);
}

Matrix next_state(const Model& model, Index k, const Matrix& x, const Matrix& u) {
  Matrix next;
  next_state(model, k, x, u, next);
  return next;
}

}  // namespace

Index Model::n(Index k) const {
  if (step.empty()) return 0;
  return k < k_end() ? at(k).states() : step.back().next_states();
}

Index Model::states() const {
  Index most = n(k_end());
  for (const Step& s : step) most = std::max(most, s.states());
  return most;
}

Index Model::full_begin() const {
  const Index full = states();
  Index k = k_begin;
  while (n(k) < full) ++k;
  return k;
}

Index Model::full_end() const {
  const Index full = states();
  Index k = full_begin();
  while (k <= k_end() && n(k) == full) ++k;
  return k;
}

Index Model::max_lags() const {
  Index most = 1;
  for (const Step& s : step)
    if (s.has_lags()) most = std::max(most, s.lags());
  return most;
}

void Model::check() const {
  if (inputs < 0 || outputs < 1 || k_begin < 0)
    throw std::invalid_argument(fmt::format("model: {} inputs, {} outputs, first step {}", inputs, outputs, k_begin));
  if (period < 0) throw std::invalid_argument(fmt::format("model: period {} found, 0 or more needed", period));
  if (!(dt > 0) || !std::isfinite(dt))
    throw std::invalid_argument(fmt::format("model: dt = {} found, a positive time in seconds needed", dt));
  check_names("input_names", names.input_names, inputs);
  check_names("output_names", names.output_names, outputs);
  check_names("input_units", names.input_units, inputs);
  check_names("output_units", names.output_units, outputs);
  for (Index s = 0; s < steps(); ++s) check_step(*this, s);
  if ((u_nominal.size() > 0 || y_nominal.size() > 0) &&
      (u_nominal.cols() != inputs || y_nominal.cols() != outputs || u_nominal.rows() != y_nominal.rows()))
    throw std::invalid_argument(fmt::format(
        "model: u_nominal is {} x {} and y_nominal {} x {}, equal steps with {} inputs and {} outputs needed",
        u_nominal.rows(), u_nominal.cols(), y_nominal.rows(), y_nominal.cols(), inputs, outputs));
  if (!u_nominal.allFinite() || !y_nominal.allFinite() || !x0_mean.allFinite() || !x0_cov.allFinite())
    throw std::invalid_argument("model: u_nominal, y_nominal, x0_mean or x0_cov has a value that is not finite");
}

bool ends_early(const Model& model, Index steps) {
  return model.period > 0 && model.steps() >= model.period && model.k_end() < steps;
}

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
    output(model, k, x, u, y);
    use(k, y);
    next_state(model, k, x, u, next);
    x.swap(next);
  }
}

Index estimation_window(const Model& model) {
  return std::max(model.max_lags(), (model.states() + model.outputs - 1) / model.outputs);
}

namespace {

// The observer over all experiments, one row each. A blind experiment is one whose state is not, or no longer, known:
// its predictions are NaN until the last samples, as many as the observer remembers, tell the state again.
class Observer {
 public:
  // From step k on, where x is the state of all experiments, if it is known.
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

  // x̂_k, rows of NaN where the state is not known.
  Matrix state() const {
    Matrix x = x_;
    blank(x);
    return x;
  }

  // To step k+1, with ŷ_k and y_k - ŷ_k (N × m), rows of NaN where x̂_k is not known.
  void advance(Matrix& y, Matrix& innovation) {
    input_departure(model_, data_, k_, u_);
    const bool inputs_missing = !std::isfinite(u_.sum());  // at least so where one is
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
  // Rows of those that are blind become NaN.
  void blank(Matrix& rows) const {
    if (all_see_) return;
    for (size_t n = 0; n < since_.size(); ++n)
      if (since_[n] != sees) rows.row(Index(n)).setConstant(nan);
  }

  // x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) from the inputs u_                                       (9)
  void correct(Index k, const Ensemble& data, Matrix& x, Matrix& y, Matrix& innovation) {
    output(model_, k, x, u_, y);
    output_departure(model_, data, k, innovation);
    innovation -= y;
    seen_ = innovation;
    const size_t s = model_.index(k);
    if (!std::isfinite(seen_.sum())) fill_in(s, seen_);
    next_.resize(x.rows(), model_.n(k + 1));
    linalg::tall_products({{x, model_.step[s].A()}, {u_, model_.step[s].B()}, {seen_, model_.step[s].G(), true}},
                          next_);
    x.swap(next_);
  }

  // Missing innovations become what those of the other outputs say of them, E[ε_q | ε_o] = S_qo S_oo⁻¹ ε_o: the gain
  // relies on outputs of the same noise to cancel it. Zero where nothing is known.
  void fill_in(size_t s, Matrix& innovations) const {
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
        const Step::View covariance = model_.step[s].innovation_cov();
        const Matrix whitener = linalg::whitener(covariance(seen, seen));
        conditional = covariance(missing, seen) * whitener.transpose() * whitener;
        before = missing;
      }
      const Vector known = innovations(n, seen).transpose();
      innovations(n, missing) = (conditional * known).transpose();
    }
  }

  // Blind experiments whose samples since then may tell the state. A window that fails grows, up to twice its size.
  void recover() {
    if (all_see_) return;
    std::map<Index, std::vector<Index>> windows;  // first step → experiments
    for (size_t n = 0; n < since_.size(); ++n) {
      if (since_[n] == sees || k_ - since_[n] < window_) continue;
      const Index from = std::max(since_[n], k_ - 2 * window_);
      if (may_tell(Index(n), from)) windows[from].push_back(Index(n));
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

  bool may_tell(Index n, Index from) const {
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
  std::vector<Index> since_;  // (N) first step of the samples since an experiment went blind, or `sees`
  bool all_see_;
  Matrix u_, y_, innovation_, seen_, next_;  // of one step
};

}  // namespace

std::vector<std::string> differences(const Model& model, const Ensemble& data) {
  std::vector<std::string> result;
  // Sample times that went through single precision or decimal text are still the same.
  if (data.dt_stated && std::abs(model.dt - data.dt) > 1e-6 * model.dt)
    result.push_back(fmt::format("the data's dt = {} s differs from the model's dt = {} s{}", data.dt, model.dt,
                                 states_dt(model) ? "" : ", which was identified from data without a sample time"));
  const auto compare = [&result](const char* what, const std::vector<std::string>& found,
                                 const std::vector<std::string>& known) {
    if (!found.empty() && !known.empty() && found != known)
      result.push_back(fmt::format("the data's {} are named {}, the model's {}", what, fmt::join(found, ", "),
                                   fmt::join(known, ", ")));
  };
  compare("inputs", data.names.input_names, model.names.input_names);
  if (data.outputs() > 0) compare("outputs", data.names.output_names, model.names.output_names);
  const auto compare_units = [&result](const auto& name, const std::vector<std::string>& found,
                                       const std::vector<std::string>& known) {
    for (size_t c = 0; c < std::min(found.size(), known.size()); ++c)
      if (!found[c].empty() && !known[c].empty() && found[c] != known[c])
        result.push_back(fmt::format("the data's {} is in {}, the model's in {}: nothing is converted", name(Index(c)),
                                     found[c], known[c]));
  };
  compare_units([&](Index i) { return "input " + model.names.input(i); }, data.names.input_units,
                model.names.input_units);
  if (data.outputs() > 0)
    compare_units([&](Index j) { return "output " + model.names.output(j); }, data.names.output_units,
                  model.names.output_units);
  return result;
}

Index unknowns(const Model& model, Index k) {
  if (!model.has(&Step::has_lags)) return 0;
  return model.inputs + (model.method == "tvera" ? model.at(k).lags() * (model.inputs + model.outputs) : model.n(k));
}

bool starts_from_zero(const Model& model, InitialState initial) {
  return model.steps() > 0 && (model.n(model.k_begin) == 0 || (initial == InitialState::zero && model.k_begin == 0));
}

bool has_initial_estimate(const Model& model, InitialState initial) {
  const Index n = model.steps() > 0 ? model.n(model.k_begin) : 0;
  return n > 0 && initial == InitialState::unknown && model.initial_state == InitialState::unknown &&
         model.x0_mean.size() == n && model.x0_cov.rows() == n && model.x0_cov.cols() == n;
}

namespace {

// Outputs of the steps after the state x (N × n_k) at step k, without correction: those of step k + ahead - 1.
Matrix outputs_ahead(const Model& model, const Ensemble& data, Index k, Matrix x, Index ahead) {
  for (const Index last = k + ahead - 1; k < last; ++k) x = next_state(model, k, x, input_departure(model, data, k));
  return output(model, k, x, input_departure(model, data, k));
}

bool knows_noise(const Model& model) { return model.has(&Step::has_Q) && model.has(&Step::has_R); }

bool samples_missing(const Ensemble& data, Index begin, Index end) {
  return end > begin && data.samples().middleCols(begin * data.channels(), (end - begin) * data.channels()).hasNaN();
}

// E[x_k | samples before k] (N × n_k) at the steps from the model's first on, around what is missing.
std::vector<Matrix> filtered_states(Model model, const Ensemble& data, bool from_zero) {
  if (from_zero) model.x0_mean.resize(0), model.x0_cov.resize(0, 0);
  std::vector<Matrix> states = em::predicted_states(model, em::samples_of(model, data, em::Tail::keep));
  for (Matrix& x : states) x = x.transpose().eval();
  return states;
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

// The state at the first step, where it is known.
std::optional<Vector> known_start(const Model& model, const Ensemble& data, const PredictOptions& options) {
  const InitialState initial = options.initial_state.value_or(data.initial_state.value_or(model.initial_state));
  if (starts_from_zero(model, initial)) return Vector::Zero(model.n(model.k_begin));
  if (options.initial_estimate && has_initial_estimate(model, initial)) return model.x0_mean;
  return std::nullopt;
}

// Calls before(k, state) with a function that gives x̂_k (N × n_k), then after(k, ŷ_k, y_k - ŷ_k), step by step: rows of
// NaN where the state is not known.
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
  // Before the horizon has passed, a known initial state is the latest information.
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

// The samples of one experiment that a state estimate can use: bit per output of the window, and whether all inputs are
// there.
std::vector<bool> pattern(const Ensemble& data, Index n, Index k, Index window) {
  std::vector<bool> present;
  for (Index j = k; j < k + window; ++j) {
    for (Index i = 0; i < data.inputs(); ++i) present.push_back(std::isfinite(data.u(n, j, i)));
    for (Index i = 0; i < data.outputs(); ++i) present.push_back(std::isfinite(data.y(n, j, i)));
  }
  return present;
}

// Coordinates whose smallest singular value is below this share of the largest would cost half of the digits.
constexpr double frame_condition = 1e-8;

// Directions of the state that show in the samples by less than this share of the clearest are not seen.
constexpr double unseen = 1e-12;

// States of experiments with the same samples present; NaN where those don't tell all of the state.
Matrix estimate_alike(const Model& model, const Ensemble& data, Index k, Index window, const Matrix& whitener) {
  const Index m = model.outputs, experiments = data.experiments(), n = model.n(k);
  Matrix sensitivity(window * m, n), innovations(window * m, experiments);
  Matrix transition = Matrix::Identity(n, n);  // of the error of x_k through the observer
  Matrix x = Matrix::Zero(experiments, n);
  for (Index j = k; j < k + window; ++j) {
    const size_t s = model.index(j);
    const Matrix u = input_departure(model, data, j);
    Matrix innovation = output_departure(model, data, j) - output(model, j, x, u);
    Vector present = Vector::Ones(m);
    for (Index i = 0; i < m; ++i)
      if (!std::isfinite(data.y(0, j, i))) present(i) = 0.0, innovation.col(i).setZero();
    const Matrix seen = present.asDiagonal() * model.step[s].C();
    sensitivity.middleRows((j - k) * m, m) = whitener * seen * transition;
    innovations.middleRows((j - k) * m, m) = whitener * innovation.transpose();
    x = next_state(model, j, x, u) - innovation * model.step[s].G().transpose();
    transition = (model.step[s].A() + model.step[s].G() * seen) * transition;
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
    throw std::invalid_argument(fmt::format("estimate_state: steps {} to {} asked for, {} to {} have model and data", k,
                                            k + window - 1, model.k_begin, std::min(model.k_end(), data.steps()) - 1));
  // One whitener for the window: the covariance of a single step may be singular by rounding.
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

// Where a simulation of data starts: the step, and the states there (N × n_k).
struct Start {
  Index k;
  Matrix x;
};

// Nothing: the data do not tell the states.
std::optional<Start> start_of(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  const InitialState initial = initial_state.value_or(data.initial_state.value_or(model.initial_state));
  if (starts_from_zero(model, initial))
    return Start{model.k_begin, Matrix::Zero(data.experiments(), model.n(model.k_begin))};
  if (has_initial_estimate(model, initial) && knows_noise(model))
    return Start{model.k_begin,
                 em::smoothed_first_states(model, em::samples_of(model, data, em::Tail::drop, estimation_window(model)))
                     .transpose()};
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

namespace {

// C_k A_{k-1} … A_{i+1} X_i
Matrix response(const Model& model, Index k, Index i, Step::View (Step::*entrance)() const) {
  if (i < model.k_begin || k <= i || k >= model.k_end())
    throw std::invalid_argument(fmt::format("pulse response: steps k = {}, i = {} asked for, {} <= i < k < {} needed",
                                            k, i, model.k_begin, model.k_end()));
  Matrix x = (model.at(i).*entrance)();
  for (Index j = i + 1; j < k; ++j) x = model.at(j).A() * x;
  return model.at(k).C() * x;
}

}  // namespace

Matrix pulse_response(const Model& model, Index k, Index i) { return response(model, k, i, &Step::B); }
Matrix gain_pulse_response(const Model& model, Index k, Index i) { return response(model, k, i, &Step::G); }

std::vector<Matrix> pulse_responses(const Model& model, Index band) {
  if (band < 1) throw std::invalid_argument(fmt::format("band: {} found, at least 1 needed", band));
  const Index r = model.inputs;
  std::vector<Matrix> result(model.step.size(), Matrix::Constant(model.outputs, band * r, nan));
  for (Index i = model.k_begin; i < model.k_end(); ++i) {
    checkpoint();
    Matrix x = model.at(i).B();
    for (Index k = i + 1; k < std::min(model.k_end(), i + 1 + band); ++k) {
      result[model.index(k)].middleCols((k - i - 1) * r, r).noalias() = model.at(k).C() * x;
      x = model.at(k).A() * x;
    }
  }
  return result;
}

Matrix observability(const Model& model, Index k, Index rows) {
  if (k < model.k_begin || k > model.k_end())
    throw std::invalid_argument(
        fmt::format("observability: step {} found, {} to {} needed", k, model.k_begin, model.k_end()));
  if (rows < 0) throw std::invalid_argument(fmt::format("observability: {} rows found, 0 or more needed", rows));
  const Index count = std::max<Index>(0, std::min(rows, model.k_end() - k));
  Matrix o(count * model.outputs, model.n(k));
  Matrix transition = Matrix::Identity(model.n(k), model.n(k));
  for (Index a = 0; a < count; ++a) {
    const size_t s = model.index(k + a);
    o.middleRows(a * model.outputs, model.outputs) = model.step[s].C() * transition;
    transition = model.step[s].A() * transition;
  }
  return o;
}

Model continued(Model model, Index end) {
  if (model.period <= 0 || model.steps() < model.period) return model;
  const size_t period = size_t(model.period);
  for (Index k = model.k_end(); k < end; ++k) model.step.push_back(Step(model.step[model.step.size() - period]));
  for (Matrix* nominal : {&model.u_nominal, &model.y_nominal}) {
    const Index known = nominal->rows();
    if (known < model.period || known >= end) continue;
    nominal->conservativeResize(end, Eigen::NoChange);
    for (Index k = known; k < end; ++k) nominal->row(k) = Eigen::RowVectorXd(nominal->row(k - model.period));
  }
  return model;
}

Model from_step(Model model, Index k) {
  if (k < model.k_begin || k > model.k_end())
    throw std::invalid_argument(
        fmt::format("from_step: step {} found, {} to {} needed", k, model.k_begin, model.k_end()));
  model.step.erase(model.step.begin(), model.step.begin() + (k - model.k_begin));
  if (k > model.k_begin) {  // the moments describe the state at the old first step
    model.x0_mean.resize(0);
    model.x0_cov.resize(0, 0);
  }
  model.k_begin = k;
  return model;
}

Model transform(const Model& model, const std::vector<Matrix>& S) {
  if (static_cast<Index>(S.size()) != model.steps() + 1)
    throw std::invalid_argument(
        fmt::format("transform: {} matrices found, {} (one for each state) needed", S.size(), model.steps() + 1));
  Model result = model;
  std::vector<Matrix> inverse(S.size());
  for (size_t s = 0; s < S.size(); ++s) {
    const Index n = model.n(model.k_begin + Index(s));
    if (S[s].rows() != n || S[s].cols() != n)
      throw std::invalid_argument(
          fmt::format("transform: S[{}] is {} x {}, {} x {} needed", s, S[s].rows(), S[s].cols(), n, n));
    const linalg::MinimumNorm solution = linalg::minimum_norm(S[s], Matrix::Identity(S[s].rows(), S[s].cols()), unseen);
    if (solution.rank < S[s].cols())
      throw std::invalid_argument(
          fmt::format("transform: S[{}] has rank {}, {} needed", s, solution.rank, S[s].cols()));
    inverse[s] = solution.x;
  }
  for (size_t s = 0; s + 1 < S.size(); ++s) {
    result.step[s].A() = S[s + 1] * model.step[s].A() * inverse[s];
    result.step[s].B() = S[s + 1] * model.step[s].B();
    result.step[s].C() = model.step[s].C() * inverse[s];
    result.step[s].G() = S[s + 1] * model.step[s].G();
    if (model.has(&Step::has_Q)) result.step[s].set_Q(S[s + 1] * model.step[s].Q() * S[s + 1].transpose());
    if (model.has(&Step::has_K)) result.step[s].set_K(S[s] * model.step[s].K());
  }
  if (model.x0_mean.size() > 0) result.x0_mean = S[0] * model.x0_mean;
  if (model.x0_cov.size() > 0) result.x0_cov = S[0] * model.x0_cov * S[0].transpose();
  return result;
}

namespace {

// The run of steps around s that `coordinates(k)`, the candidate for S_k, takes into the frame: as far as it tells all
// of the state. Empty where it fails at step s already.
template <class Coordinates>
FramedModel framed(const Model& model, Index s, Coordinates&& coordinates) {
  std::vector<Matrix> S;
  for (Index k = model.k_begin; k <= model.k_end(); ++k) S.emplace_back(Matrix::Identity(model.n(k), model.n(k)));
  const auto enters = [&](Index k) {
    if (k < model.k_begin || k > model.k_end()) return false;
    const Matrix candidate = coordinates(k);
    if (candidate.rows() != model.n(k) || candidate.size() == 0) return false;
    const Vector sigma = linalg::singular_values(candidate);
    if (!(sigma(sigma.size() - 1) > frame_condition * sigma(0))) return false;
    S[model.index(k)] = candidate;
    return true;
  };
  FramedModel result{{}, s, s};
  if (!enters(s)) return result;
  while (enters(result.begin - 1)) --result.begin;
  while (enters(++result.end)) continue;
  result.model = transform(model, S);
  return result;
}

}  // namespace

FramedModel reference_frame(const Model& model, Index s, Index rows) {
  if (s < model.k_begin || rows < 1 || s >= model.k_end() || rows > model.k_end() - s || model.n(s) == 0)
    throw std::invalid_argument(fmt::format(
        "reference frame: step {} with {} block rows asked for; a step with states and so many steps behind it is "
        "needed, states are there at steps {} to {}, the model ends with step {}",
        s, rows, model.full_begin(), model.full_end() - 1, model.k_end() - 1));
  const Matrix projection = linalg::pseudo_inverse(observability(model, s, rows));
  FramedModel result = framed(model, s, [&](Index k) {
    return k + rows <= model.k_end() ? Matrix(projection * observability(model, k, rows)) : Matrix();
  });
  if (result.begin == result.end)
    throw std::invalid_argument(fmt::format(
        "reference frame: {} block rows of step {} don't tell its {} states apart; more rows or another step needed",
        rows, s, model.n(s)));
  result.model.frame = "reference";
  return result;
}

FramedModel align(const Model& model, const Model& reference, Index rows) {
  if (model.inputs != reference.inputs || model.outputs != reference.outputs)
    throw std::invalid_argument(fmt::format("align: models with {} and {} inputs, {} and {} outputs", model.inputs,
                                            reference.inputs, model.outputs, reference.outputs));
  const Index last = std::min(model.k_end(), reference.k_end()) - rows;
  Index s = std::max(model.full_begin(), reference.k_begin);
  while (s < last && model.n(s) != reference.n(s)) ++s;
  if (rows < 1 || s > last)
    throw std::invalid_argument(
        fmt::format("align: no step has the same state dimension in both models and {} block rows in each", rows));
  FramedModel result = framed(model, s, [&](Index k) {
    if (k < reference.k_begin || k > last) return Matrix();
    return Matrix(linalg::pseudo_inverse(observability(reference, k, rows)) * observability(model, k, rows));
  });
  if (result.begin == result.end)
    throw std::invalid_argument(fmt::format(
        "align: {} block rows of step {} don't tell its {} states apart; more rows needed", rows, s, model.n(s)));
  result.model.frame = reference.frame;
  return result;
}

Model smooth_frame(const Model& model, Index rows) {
  std::vector<Matrix> S;
  Matrix previous(0, 0);  // O_{k-1} in the new coordinates
  for (Index k = model.k_begin; k <= model.k_end(); ++k) {
    const Index n = model.n(k);
    const Matrix o = observability(model, k, rows);
    const Index common = std::min(o.rows(), previous.rows());
    Matrix target = Matrix::Zero(common, n);
    const Index shared = std::min(n, previous.cols());
    target.leftCols(shared) = previous.topLeftCorner(common, shared);
    const Matrix rotation =
        common > 0 && n > 0 ? linalg::procrustes(o.topRows(common), target) : Matrix(Matrix::Identity(n, n));
    S.emplace_back(rotation.transpose());  // x' = Qᵀ x, so O' = O Q
    previous = o * rotation;
  }
  Model result = transform(model, S);
  result.frame = "smooth";
  return result;
}

Similarity kinematically_similar(const Model& a, const Model& b, double tolerance, Index band) {
  if (a.inputs != b.inputs || a.outputs != b.outputs)
    throw std::invalid_argument(fmt::format("kinematically_similar: models with {} and {} inputs, {} and {} outputs",
                                            a.inputs, b.inputs, a.outputs, b.outputs));
  const Index begin = std::max(a.k_begin, b.k_begin), end = std::min(a.k_end(), b.k_end());
  if (band <= 0) band = 2 * std::max(a.states(), b.states());
  // Forward from each pulse: one product per parameter, and the scale of each step k collected on the way.
  Vector difference = Vector::Zero(std::max<Index>(0, end - begin)), scale = difference;
  const auto compare = [&](Index k, const ConstMatrixRef& x, const ConstMatrixRef& y) {
    difference(k - begin) = std::max(difference(k - begin), (x - y).norm());
    scale(k - begin) = std::max({scale(k - begin), x.norm(), y.norm()});
  };
  for (Index i = begin; i < end; ++i) {
    checkpoint();
    compare(i, a.at(i).D(), b.at(i).D());
    Matrix x = a.at(i).B(), y = b.at(i).B();
    for (Index k = i + 1; k < std::min(end, i + 1 + band); ++k) {
      compare(k, a.at(k).C() * x, b.at(k).C() * y);
      x = a.at(k).A() * x;
      y = b.at(k).A() * y;
    }
  }
  Similarity result;
  for (Index k = 0; k < difference.size(); ++k)
    if (scale(k) > 0) result.max_difference = std::max(result.max_difference, difference(k) / scale(k));
  result.similar = result.max_difference <= tolerance;
  return result;
}

}  // namespace tokid
