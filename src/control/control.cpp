// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/control.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "base/nan.hpp"
#include "base/random.hpp"
#include "control/lq.hpp"
#include "control/system_digest.hpp"
#include "model/continuation.hpp"
#include "model/kalman_step.hpp"
#include "model/observer_rows.hpp"
#include "model/observer_step.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

Eigen::RowVectorXd nominal_at(const Model& model, const Matrix& trajectory, Index k, Index size) {
  const Index row = nominal_row(model, trajectory, k);
  if (row < 0) return Eigen::RowVectorXd::Zero(size);
  return trajectory.row(row);
}

Matrix departures(const Model& model, const Matrix& trajectory, Index k, Matrix samples) {
  subtract_nominal(trajectory, nominal_row(model, trajectory, k), samples);
  return samples;
}

void check_reference(const char* name, const Matrix& reference, Index steps, Index channels) {
  if (reference.size() == 0) return;
  if (reference.rows() != steps || reference.cols() != channels)
    throw std::invalid_argument(fmt::format("{}: {} x {} found, {} steps x {} channels needed", name, reference.rows(),
                                            reference.cols(), steps, channels));
  if (!reference.allFinite())
    throw std::invalid_argument(fmt::format("{}: a value that is not finite found, finite ones needed", name));
}

CostToGo cost_to_go_of(const lq::Solution& solution) {
  CostToGo cost;
  for (size_t s = 0; s < solution.root.size(); ++s) {
    cost.P.push_back(kalman::covariance_of(solution.root[s]));
    if (!solution.gamma.empty()) cost.p.emplace_back(solution.root[s].transpose() * solution.gamma[s]);
  }
  cost.c = solution.c;
  for (size_t s = 0; s < solution.gamma.size(); ++s) cost.c(Index(s)) += solution.gamma[s].squaredNorm();
  return cost;
}

// Does a system have the channels and the steps of a controller?
void check_system(const Controller& controller, const Model& system, const char* name) {
  const Controller& c = controller;
  system.check();
  if (system.steps() == 0) throw std::invalid_argument(fmt::format("{}: no step found, at least one needed", name));
  if (system.inputs != c.u_nominal.cols() || system.outputs != c.outputs)
    throw std::invalid_argument(fmt::format("{}: {} inputs and {} outputs found, {} and {} of the controller needed",
                                            name, system.inputs, system.outputs, c.u_nominal.cols(), c.outputs));
  if (system.k_begin > c.begin || !has_step(system, c.end() - 1))
    throw std::invalid_argument(fmt::format("{}: steps {} to {} found, {} to {} of the controller needed", name,
                                            system.k_begin, system.k_end() - 1, c.begin, c.end() - 1));
}

}  // namespace

void Controller::check() const {
  const Index S = steps(), r = u_nominal.cols();
  const auto has_shape = [S](const Matrix& a, Index columns, bool needed) {
    return (a.size() == 0 && !needed) || (a.rows() == S && a.cols() == columns);
  };
  bool fits = S > 0 && r > 0 && outputs > 0 && has_shape(u_nominal, r, true) && has_shape(y_nominal, outputs, true) &&
              has_shape(feedforward, r, false) && has_shape(u_reference, r, false) &&
              has_shape(y_reference, outputs, false) && (L.empty() || Index(L.size()) == S);
  for (const Matrix& gain : K) fits = fits && gain.rows() == r;
  for (const Matrix& gain : L) fits = fits && gain.rows() == r && gain.cols() == r;
  if (!fits) throw std::invalid_argument("controller: parts of different sizes found, those that lqr() gives needed");
  const auto check_weights = [S](const char* name, const std::vector<Matrix>& found, Index channels) {
    if (found.size() > 1 && Index(found.size()) != S)
      throw std::invalid_argument(
          fmt::format("controller: {} matrices found as {}, none, one or {} needed", found.size(), name, S));
    for (const Matrix& matrix : found)
      if (matrix.rows() != channels || matrix.cols() != channels)
        throw std::invalid_argument(fmt::format("controller: {} x {} found as {}, {} x {} needed", matrix.rows(),
                                                matrix.cols(), name, channels, channels));
  };
  check_weights("output weights", weights.output, outputs);
  check_weights("input weights", weights.input, r);
  check_weights("input-rate weights", weights.input_rate, r);
  if (weights.terminal.size() > 0) check_weights("terminal weight", {weights.terminal}, outputs);
}

void Controller::check(const Model& model) const {
  check();
  check_system(*this, model, "model");
  if (digest_of_system(model, begin, end()) != system)
    throw std::invalid_argument(
        "model: other matrices or coordinates found, those of the model needed from which the controller was designed");
  for (Index k = begin; k < end(); ++k) {
    const size_t s = size_t(k - begin);
    if (K[s].cols() != states_at(model, k))
      throw std::invalid_argument(
          fmt::format("controller: a gain of {} x {} found at step {}, {} x {} of the model needed", K[s].rows(),
                      K[s].cols(), k, model.inputs, states_at(model, k)));
    if (!K[s].allFinite() || (!L.empty() && !L[s].allFinite()))
      throw std::invalid_argument(fmt::format("controller: a gain that is not finite found at step {}", k));
  }
  if (!feedforward.allFinite() || !u_nominal.allFinite() || !y_nominal.allFinite())
    throw std::invalid_argument(
        "controller: a feedforward or nominal value that is not finite found, finite ones needed");
}

Vector Controller::input(Index k, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& u_last) const {
  if (k < begin || k >= end())
    throw std::invalid_argument(fmt::format("k: {} found, steps {} to {} needed", k, begin, end() - 1));
  const Index s = k - begin;
  const Matrix& gain = K[size_t(s)];
  if (x.size() != gain.cols() || (!L.empty() && u_last.size() != gain.rows()))
    throw std::invalid_argument(fmt::format("x, u_last: {} and {} numbers found, {} states and {} inputs needed",
                                            x.size(), u_last.size(), gain.cols(), gain.rows()));
  Vector u = u_nominal.row(s).transpose() - gain * x;
  if (!L.empty() && s > 0) u -= L[size_t(s)] * (u_last - u_nominal.row(s - 1).transpose());
  if (feedforward.size() > 0) u += feedforward.row(s).transpose();
  return u;
}

Lqr lqr(const Model& model, const CostWeights& weights, const ControlOptions& options) {
  model.check();
  if (model.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  if (model.inputs == 0) throw std::invalid_argument("model: no input found, at least one needed for control");
  const Index begin = options.begin < 0 ? model.k_begin : options.begin;
  const Index end = options.end < 0 ? model.k_end() : options.end, steps = end - begin;
  if (begin < model.k_begin || steps < 1 || !has_step(model, end - 1))
    throw std::invalid_argument(fmt::format("steps: {} to {} found, steps within {} to {} needed, which the model has",
                                            begin, end - 1, model.k_begin, model.k_end() - 1));
  const Index m = model.outputs, r = model.inputs;
  check_reference("y_reference", options.y_reference, steps, m);
  check_reference("u_reference", options.u_reference, steps, r);
  const auto target = [](const Matrix& reference) { return reference.size() > 0 ? &reference : nullptr; };
  const lq::Problem problem{
      model,
      begin,
      steps,
      lq::Roots("output", lq::with_terminal(weights.output, weights.terminal, m, steps), m, steps),
      lq::Roots("input", weights.input, r, steps),
      {},
      lq::Roots("input_rate", weights.input_rate, r, steps),
      target(options.y_reference),
      target(options.u_reference),
      nullptr};
  lq::Solution solution = lq::solve(problem, true);
  Lqr result;
  result.cost_to_go = cost_to_go_of(solution);
  Controller& controller = result.controller;
  controller.begin = begin;
  controller.outputs = m;
  controller.dt = model.dt;
  controller.system = digest_of_system(model, begin, end);
  controller.names = model.names;
  controller.K = std::move(solution.K);
  controller.L = std::move(solution.L);
  controller.feedforward = std::move(solution.v);
  controller.u_nominal.resize(steps, r);
  controller.y_nominal.resize(steps, m);
  for (Index s = 0; s < steps; ++s) {
    controller.u_nominal.row(s) = nominal_at(model, model.u_nominal, begin + s, r);
    controller.y_nominal.row(s) = nominal_at(model, model.y_nominal, begin + s, m);
  }
  controller.y_reference = options.y_reference;
  controller.u_reference = options.u_reference;
  controller.weights = weights;
  return result;
}

namespace {

// A loop of a controller, the model of its observer, and the true system.
struct Loop {
  const Controller& controller;
  const Model &model, &truth;

  Index inputs() const { return truth.inputs; }
  Index outputs() const { return truth.outputs; }
  Index begin() const { return truth.k_begin; }
  Index end() const { return controller.end(); }
  bool controls(Index k) const { return k >= controller.begin; }
  size_t step(Index k) const { return size_t(k - controller.begin); }

  // Nominal inputs and outputs that departures refer to: of the controller, or before it of the model.
  Eigen::RowVectorXd u_nominal(Index k) const {
    if (controls(k)) return controller.u_nominal.row(k - controller.begin);
    return nominal_at(model, model.u_nominal, k, inputs());
  }
  Eigen::RowVectorXd y_nominal(Index k) const {
    if (controls(k)) return controller.y_nominal.row(k - controller.begin);
    return nominal_at(model, model.y_nominal, k, outputs());
  }
  // The departures that the cost refers to.
  Eigen::RowVectorXd wanted(const Matrix& reference, Index k, Index size) const {
    if (reference.size() == 0) return Eigen::RowVectorXd::Zero(size);
    return reference.row(k - controller.begin);
  }
};

void check_loop(const Loop& loop) {
  loop.controller.check(loop.model);
  check_system(loop.controller, loop.truth, "truth");
  if (loop.truth.k_begin > loop.model.k_begin)
    throw std::invalid_argument(fmt::format("truth: first step {} found, {} or earlier needed, the first of the model",
                                            loop.truth.k_begin, loop.model.k_begin));
}

// The weights of a controller, step by step.
struct StepWeights {
  explicit StepWeights(const Controller& controller)
      : controller_(controller),
        outputs_(lq::with_terminal(controller.weights.output, controller.weights.terminal, controller.outputs,
                                   controller.steps())) {}

  Matrix output(Index s) const { return lq::weight_at(outputs_, s, controller_.outputs); }
  Matrix input(Index s) const { return lq::weight_at(controller_.weights.input, s, controller_.u_nominal.cols()); }
  Matrix rate(Index s) const { return lq::weight_at(controller_.weights.input_rate, s, controller_.u_nominal.cols()); }

 private:
  const Controller& controller_;
  std::vector<Matrix> outputs_;
};

// Roots of the noise of a step, with one column for each independent source: its effect on the next state and on the
// outputs of the same step.
struct NoiseSources {
  Matrix state, output;  // n_{k+1} × sources, m × sources
};

Matrix root_or_throw(const Step::View& covariance, const char* name, Index k) {
  const std::optional<Matrix> factor = linalg::covariance_factor(covariance);
  if (!factor)
    throw std::invalid_argument(fmt::format(
        "truth: {} is no covariance at step {}; a symmetric matrix without negative eigenvalues needed", name, k));
  return *factor;
}

NoiseSources noise_at(const Model& truth, Index k) {
  const Step& step = step_at(truth, k);
  const Index next = step.next_states(), m = truth.outputs;
  if (step.has_Q() && step.has_R()) {
    NoiseSources noise{Matrix::Zero(next, next + m), Matrix::Zero(m, next + m)};
    noise.state.leftCols(next) = root_or_throw(step.Q(), "Q", k);
    noise.output.rightCols(m) = root_or_throw(step.R(), "R", k);
    return noise;
  }
  if (!step.has_innovation_cov()) return {Matrix(next, 0), Matrix(m, 0)};
  const Matrix root = root_or_throw(step.innovation_cov(), "innovation_cov", k);
  return {-step.G() * root, root};
}

struct InitialMoments {
  Vector mean;
  Matrix root;  // the covariance is root·rootᵀ
};

InitialMoments initial_moments(const Model& truth) {
  const Index n = truth.n(truth.k_begin);
  if (!has_initial_estimate(truth, truth.initial_state)) return {Vector::Zero(n), Matrix(n, 0)};
  const std::optional<Matrix> factor = linalg::covariance_factor(truth.x0_cov);
  if (!factor)
    throw std::invalid_argument(
        "truth: x0_cov is no covariance; a symmetric matrix without negative eigenvalues needed");
  return {truth.x0_mean, *factor};
}

// E[(rows·z)ᵀ · weight · (rows·z)] for E[z zᵀ] = moments. Weight and moments are positive semidefinite, so a negative
// sum is rounding of zero. NaN remains.
double weighted(const Matrix& weight, const Matrix& rows, const Matrix& moments) {
  const double sum = (weight * rows * moments).cwiseProduct(rows).sum();
  return sum < 0 ? 0.0 : sum;
}

// The second moments of z_k = [1; x_k; x̂_k; δu_{k-1}], with x_k of the true system and x̂_k of the observer.
class LoopMoments {
 public:
  explicit LoopMoments(const Loop& loop) : loop_(loop), weights_(loop.controller), r_(loop.inputs()) {
    const InitialMoments initial = initial_moments(loop.truth);
    n_ = initial.mean.size();
    Vector mean = Vector::Zero(1 + n_ + r_);
    mean(0) = 1.0;
    mean.segment(1, n_) = initial.mean;
    moments_ = mean * mean.transpose();
    moments_.block(1, 1, n_, n_) += initial.root * initial.root.transpose();
  }

  void advance(Index k, ExpectedCost& cost) {
    if (k == loop_.model.k_begin) start_observer();
    const Step& own = step_at(loop_.truth, k);
    const Index m = loop_.outputs(), size = moments_.rows();
    const Matrix u = law(k, size);  // δu = u·z
    const Eigen::RowVectorXd u_nominal = loop_.u_nominal(k), y_nominal = loop_.y_nominal(k);

    // Outputs of the truth without noise, as departures from the nominal trajectory of the controller.
    const Matrix u_true = shifted(u, u_nominal - nominal_at(loop_.truth, loop_.truth.u_nominal, k, r_));
    Matrix y = own.D() * u_true;
    y.middleCols(1, n_) += own.C();
    y.col(0) += (nominal_at(loop_.truth, loop_.truth.y_nominal, k, m) - y_nominal).transpose();
    const NoiseSources noise = noise_at(loop_.truth, k);
    if (loop_.controls(k)) add(k, y, u, noise, cost);

    const Index n_next = own.next_states(), observed = observes(k) ? step_at(loop_.model, k).next_states() : 0;
    Matrix move = Matrix::Zero(1 + n_next + observed + r_, size);
    Matrix enters = Matrix::Zero(move.rows(), noise.state.cols());
    move(0, 0) = 1.0;
    move.middleRows(1, n_next) = own.B() * u_true;
    move.block(1, 1, n_next, n_) += own.A();
    enters.middleRows(1, n_next) = noise.state;
    if (observes(k)) {
      const Step& step = step_at(loop_.model, k);
      const Matrix u_model = shifted(u, u_nominal - nominal_at(loop_.model, loop_.model.u_nominal, k, r_));
      Matrix e = shifted(y, y_nominal - nominal_at(loop_.model, loop_.model.y_nominal, k, m)) - step.D() * u_model;
      e.middleCols(1 + n_, step.states()) -= step.C();
      auto next = move.middleRows(1 + n_next, observed);
      next = step.B() * u_model - step.G() * e;
      next.middleCols(1 + n_, step.states()) += step.A();
      enters.middleRows(1 + n_next, observed) = -step.G() * noise.output;
    }
    move.bottomRows(r_) = u;
    moments_ = move * moments_ * move.transpose() + enters * enters.transpose();
    n_ = n_next;
  }

 private:
  bool observes(Index k) const { return k >= loop_.model.k_begin; }

  static Matrix shifted(Matrix rows, const Eigen::RowVectorXd& by) {
    rows.col(0) += by.transpose();
    return rows;
  }

  // z gets the first state of the observer.
  void start_observer() {
    const Model& model = loop_.model;
    const std::optional<Vector> known = observer::known_start(model, model.initial_state, true);
    const Vector x = known ? *known : Vector::Zero(model.n(model.k_begin));
    Matrix into = Matrix::Zero(moments_.rows() + x.size(), moments_.rows());
    into.topLeftCorner(1 + n_, 1 + n_).setIdentity();
    into.block(1 + n_, 0, x.size(), 1) = x;
    into.bottomRightCorner(r_, r_).setIdentity();
    moments_ = into * moments_ * into.transpose();
  }

  Matrix law(Index k, Index size) const {
    Matrix u = Matrix::Zero(r_, size);
    if (!loop_.controls(k)) return u;
    const Controller& c = loop_.controller;
    const size_t s = loop_.step(k);
    u.middleCols(1 + n_, c.K[s].cols()) = -c.K[s];
    if (!c.L.empty()) u.rightCols(r_) = -c.L[s];
    if (c.feedforward.size() > 0) u.col(0) += c.feedforward.row(Index(s)).transpose();
    return u;
  }

  void add(Index k, const Matrix& y, const Matrix& u, const NoiseSources& noise, ExpectedCost& cost) const {
    const Controller& c = loop_.controller;
    const Index s = k - c.begin;
    const Matrix output = weights_.output(s);
    cost.outputs += weighted(output, shifted(y, -loop_.wanted(c.y_reference, k, loop_.outputs())), moments_);
    cost.inputs += weighted(weights_.input(s), shifted(u, -loop_.wanted(c.u_reference, k, r_)), moments_);
    cost.measurement_noise += (output * noise.output).cwiseProduct(noise.output).sum();
    Matrix rate = u;
    rate.rightCols(r_) -= Matrix::Identity(r_, r_);
    cost.input_rates += weighted(weights_.rate(s), rate, moments_);
  }

  const Loop& loop_;
  StepWeights weights_;
  Index r_, n_ = 0;  // n_: states of the true system at this step
  Matrix moments_;
};

}  // namespace

ExpectedCost expected_cost(const Controller& controller, const Model& model, const Model& truth) {
  const Loop loop{controller, model, truth};
  check_loop(loop);
  LoopMoments moments(loop);
  ExpectedCost cost;
  cost.presumes_zero_state = !observer::known_start(model, model.initial_state, true) &&
                             loop.begin() < model.k_begin + estimation_window(model);
  for (Index k = loop.begin(); k < loop.end(); ++k) {
    checkpoint();
    moments.advance(k, cost);
  }
  return cost;
}

std::optional<ExpectedCost> predicted_cost(const Controller& controller, const Model& model) {
  controller.check(model);
  const bool separate = model.has(&Step::has_Q) && model.has(&Step::has_R);
  if (!separate && !model.has(&Step::has_innovation_cov)) return std::nullopt;
  return expected_cost(controller, model, model);
}

namespace {

// The closed loop of all experiments as rows.
class LoopSimulation {
 public:
  LoopSimulation(const Loop& loop, const SimulateControlOptions& options)
      : loop_(loop),
        options_(options),
        weights_(loop.controller),
        random_(options.seed),
        N_(options.experiments),
        r_(loop.inputs()),
        start_(observer::known_start(loop.model, loop.model.initial_state, true)),
        observer_(loop.model, N_, observer::first_step(loop.model, start_), start_),
        x_(first_states()),
        held_(Matrix::Zero(N_, r_)) {
    const Model& truth = loop.truth;
    result_.data = Ensemble(N_, loop.end(), r_, loop.outputs(), truth.dt);
    result_.data.names = loop.model.names;
    result_.cost = Vector::Zero(N_);
  }

  ClosedLoopSimulation run() {
    for (Index k = loop_.begin(); k < loop_.end(); ++k) {
      checkpoint();
      advance(k);
    }
    return std::move(result_);
  }

 private:
  Matrix normals(Index columns) {
    Matrix z(N_, columns);
    for (Index n = 0; n < N_; ++n)
      for (Index j = 0; j < columns; ++j) z(n, j) = random_.normal();
    return z;
  }

  Matrix first_states() {
    const InitialMoments initial = initial_moments(loop_.truth);
    const Index n = initial.mean.size();
    if (options_.x0.size() > 0) {
      if (options_.x0.rows() != n || options_.x0.cols() != N_)
        throw std::invalid_argument(fmt::format("x0: {} x {} found, {} states x {} experiments needed",
                                                options_.x0.rows(), options_.x0.cols(), n, N_));
      if (!options_.x0.allFinite())
        throw std::invalid_argument("x0: a value that is not finite found, finite ones needed");
      return options_.x0.transpose();
    }
    Matrix x = initial.mean.transpose().replicate(N_, 1);
    if (options_.noise && initial.root.cols() > 0) x += normals(initial.root.cols()) * initial.root.transpose();
    return x;
  }

  void advance(Index k) {
    const Model &truth = loop_.truth, &model = loop_.model;
    const Step& own = step_at(truth, k);
    const Matrix u = limited(inputs(k), k);
    const Matrix du = u.rowwise() - loop_.u_nominal(k);
    const Matrix u_true = departures(truth, truth.u_nominal, k, u);
    Matrix y, next;
    observer::output(own, x_, u_true, y);
    y.rowwise() += nominal_at(truth, truth.y_nominal, k, loop_.outputs());
    if (loop_.controls(k)) add_cost(k, y, du);
    observer::next_state(own, x_, u_true, next);
    if (options_.noise) {
      const NoiseSources noise = noise_at(truth, k);
      const Matrix z = normals(noise.state.cols());
      y += z * noise.output.transpose();
      next += z * noise.state.transpose();
    }
    result_.data.input(k) = u;
    result_.data.output(k) = y;
    x_.swap(next);
    if (k >= observer_.k()) {
      const Matrix u_model = departures(model, model.u_nominal, k, u);
      const Matrix y_model = departures(model, model.y_nominal, k, y);
      Matrix prediction(N_, loop_.outputs()), innovation(N_, loop_.outputs());
      observer_.advance(observer::Rows::of(u_model), observer::Rows::of(y_model), prediction, innovation);
    }
    held_ = loop_.controls(k) ? du : Matrix(Matrix::Zero(N_, r_));
  }

  // Inputs of experiments whose state is not known are those of the nominal trajectory.
  Matrix inputs(Index k) const {
    Matrix u = Matrix::Zero(N_, r_);
    if (loop_.controls(k) && k >= observer_.k()) {
      const Controller& c = loop_.controller;
      const size_t s = loop_.step(k);
      u = -observer_.state() * c.K[s].transpose();
      if (!c.L.empty()) u -= held_ * c.L[s].transpose();
      if (c.feedforward.size() > 0) u.rowwise() += c.feedforward.row(Index(s));
      for (Index n = 0; n < N_; ++n)
        if (!observer_.knows(n)) u.row(n).setZero();
    }
    return u.rowwise() + loop_.u_nominal(k);
  }

  Matrix limited(Matrix u, Index k) const {
    if (!loop_.controls(k)) return u;
    if (options_.u_max.size() > 0) u = u.cwiseMin(options_.u_max.transpose().replicate(N_, 1));
    if (options_.u_min.size() > 0) u = u.cwiseMax(options_.u_min.transpose().replicate(N_, 1));
    return u;
  }

  void add_cost(Index k, const Matrix& y, const Matrix& du) {
    const Controller& c = loop_.controller;
    const Index s = k - c.begin;
    const auto add = [&](const Matrix& weight, const Matrix& rows) {
      result_.cost += (rows * weight).cwiseProduct(rows).rowwise().sum();
    };
    add(weights_.output(s), y.rowwise() - (loop_.y_nominal(k) + loop_.wanted(c.y_reference, k, loop_.outputs())));
    add(weights_.input(s), du.rowwise() - loop_.wanted(c.u_reference, k, r_));
    add(weights_.rate(s), du - held_);
  }

  const Loop& loop_;
  const SimulateControlOptions& options_;
  StepWeights weights_;
  RandomNumbers random_;
  Index N_, r_;
  std::optional<Vector> start_;
  observer::Rows observer_;
  Matrix x_, held_;  // states of the true system (N × n_k), and δu of the last step
  ClosedLoopSimulation result_;
};

void check_limits(const Vector& u_min, const Vector& u_max, Index inputs) {
  for (const auto& [name, limit] : {std::pair{"u_min", &u_min}, {"u_max", &u_max}}) {
    if (limit->size() == 0) continue;
    if (limit->size() != inputs)
      throw std::invalid_argument(
          fmt::format("{}: {} numbers found, one for each of {} inputs needed", name, limit->size(), inputs));
    if (limit->hasNaN()) throw std::invalid_argument(fmt::format("{}: NaN found, numbers needed", name));
    const double never = (limit == &u_min ? 1 : -1) * std::numeric_limits<double>::infinity();
    if ((limit->array() == never).any())
      throw std::invalid_argument(fmt::format("{}: {} found, which no input satisfies, numbers needed", name, never));
  }
  if (u_min.size() > 0 && u_max.size() > 0 && (u_min.array() > u_max.array()).any())
    throw std::invalid_argument("u_min: a limit above u_max found, limits up to u_max needed");
}

}  // namespace

ClosedLoopSimulation simulate_control(const Controller& controller, const Model& model, const Model& truth,
                                      const SimulateControlOptions& options) {
  const Loop loop{controller, model, truth};
  check_loop(loop);
  if (options.experiments < 1)
    throw std::invalid_argument(fmt::format("experiments: {} found, at least 1 needed", options.experiments));
  check_limits(options.u_min, options.u_max, truth.inputs);
  return LoopSimulation(loop, options).run();
}

}  // namespace tokid
