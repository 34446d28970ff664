// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/example.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <unsupported/Eigen/MatrixFunctions>

#include "base/random.hpp"
#include "model/observer_step.hpp"
#include "tokid/observer.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace {

struct System {
  Matrix a, b, c, d;
};

// A known model with the gains of its deadbeat observer.
Model known(Index steps, double dt, const std::function<System(double)>& at) {
  if (steps < 1) throw std::invalid_argument(fmt::format("steps: {} found, at least 1 needed", steps));
  if (!(dt > 0)) throw std::invalid_argument(fmt::format("dt: {} found, a positive time in seconds needed", dt));
  Model model;
  model.dt = dt;
  model.method = "known";
  model.provenance.version = version;
  for (Index k = 0; k < steps; ++k) {
    const System system = at(double(k) * dt);
    model.step.emplace_back(system.a, system.b, system.c, system.d, Matrix::Zero(system.a.rows(), system.c.rows()));
  }
  model.inputs = model.step[0].B().cols();
  model.outputs = model.step[0].C().rows();
  const DeadbeatGain deadbeat = deadbeat_gain(model);
  for (size_t s = 0; s < model.step.size(); ++s) {
    model.step[s].G() = deadbeat.G[s];
    model.step[s].set_lags(deadbeat.steps);
  }
  return model;
}

Matrix exponential(const Matrix& a) { return a.exp(); }

}  // namespace

Model oscillator(Index steps, double dt) {
  return known(steps, dt, [dt](double t) {
    Matrix stiffness{{4 + 3 * std::sin(10 * t), -1}, {-1, 7 + 3 * std::cos(10 * t)}};
    Matrix ac = Matrix::Zero(4, 4);  // (78)
    ac.topRightCorner(2, 2).setIdentity();
    ac.bottomLeftCorner(2, 2) = -stiffness;
    return System{exponential(ac * dt), Matrix{{1, 0}, {1, -1}, {0, 1}, {-1, 0}},  // (77)
                  Matrix{{1, 0, 1, 0.2}, {1, -1, 0, -0.5}}, 0.1 * Matrix::Identity(2, 2)};
  });
}

Model rotating_tube(Index steps, double dt) {
  return known(steps, dt, [dt](double t) {
    const double rate = 3 * std::sin(t / 2), stiffness = 4 + 2 * std::sin(t);
    Matrix joint = Matrix::Zero(3, 3);  // of [x; x'; u]: one exponential gives A and B
    joint(0, 1) = 1;
    joint(1, 0) = rate * rate - stiffness;
    joint(1, 2) = 1;
    const Matrix held = exponential(joint * dt);
    return System{held.topLeftCorner(2, 2), held.topRightCorner(2, 1), Matrix{{1, 0}}, Matrix::Zero(1, 1)};
  });
}

namespace {

// Draws the same number of random numbers for any options, so that ensembles with different noise have the same inputs.
template <class Input, class Output>
void run(const Model& system, const ExperimentOptions& options, bool from_rest, RandomNumbers& random, Input&& input,
         Output&& output) {
  const Vector start = random.normals(system.n(system.k_begin));
  Vector x = from_rest ? Vector(Vector::Zero(start.size())) : start;
  for (Index k = 0; k < system.steps(); ++k) {
    const size_t s = size_t(k);
    const Vector u = input(k, random.normals(system.inputs));
    const Vector y =
        system.step[s].C() * x + system.step[s].D() * u + options.measurement_noise * random.normals(system.outputs);
    output(k, y);
    x = system.step[s].A() * x + system.step[s].B() * u +
        options.process_noise * random.normals(system.step[s].next_states());
  }
}

void check_noise(const ExperimentOptions& options) {
  if (!(options.process_noise >= 0 && options.measurement_noise >= 0))
    throw std::invalid_argument(fmt::format("noise: standard deviations {} and {} found, 0 or more needed",
                                            options.process_noise, options.measurement_noise));
}

// Simulates N experiments. The input of experiment n and step k is input(n, k, a unit Gaussian vector).
template <class Input>
Ensemble simulated(const Model& system, const ExperimentOptions& options, Index experiments, Input&& input) {
  if (experiments < 1 || options.free_responses < 0)
    throw std::invalid_argument(
        fmt::format("experiments: {} experiments and {} free responses found, at least 1 and 0 needed", experiments,
                    options.free_responses));
  check_noise(options);
  const bool from_rest = options.initial_state == InitialState::zero;
  Ensemble ensemble(experiments, system.steps(), system.inputs, system.outputs, system.dt);
  ensemble.names = system.names;
  ensemble.initial_state = options.initial_state;
  RandomNumbers random(options.seed);
  for (Index n = 0; n < experiments; ++n)
    run(
        system, options, from_rest, random,
        [&](Index k, const Vector& drawn) {
          const Vector u = input(n, k, drawn);
          ensemble.input(k).row(n) = u.transpose();
          return u;
        },
        [&](Index k, const Vector& y) { ensemble.output(k).row(n) = y.transpose(); });

  FreeResponse& free = ensemble.free;
  free.experiments = options.free_responses;
  free.steps = free.experiments > 0 ? system.steps() : 0;
  free.y.resize(free.experiments, free.steps * system.outputs);
  RandomNumbers other(~options.seed);  // free responses do not change the other experiments
  for (Index n = 0; n < free.experiments; ++n)
    run(
        system, options, false, other, [](Index, const Vector& u) { return Vector(Vector::Zero(u.size())); },
        [&](Index k, const Vector& y) { free.y.row(n).segment(k * system.outputs, system.outputs) = y.transpose(); });
  return ensemble;
}

}  // namespace

Ensemble experiments(const Model& system, const ExperimentOptions& options) {
  return simulated(system, options, options.experiments, [](Index, Index, const Vector& drawn) { return drawn; });
}

Ensemble experiments(const Model& system, const Ensemble& inputs, const ExperimentOptions& options) {
  if (inputs.inputs() != system.inputs || inputs.steps() != system.steps())
    throw std::invalid_argument(fmt::format("inputs: {} inputs and {} steps found, {} and {} needed, as the system has",
                                            inputs.inputs(), inputs.steps(), system.inputs, system.steps()));
  return simulated(system, options, inputs.experiments(),
                   [&](Index n, Index k, const Vector&) { return Vector(inputs.input(k).row(n).transpose()); });
}

Model with_noise(Model system, const ExperimentOptions& options) {
  check_noise(options);
  system.check();
  const auto white = [](Index size, double deviation) -> Matrix {
    return deviation * deviation * Matrix::Identity(size, size);
  };
  for (Index k = system.k_begin; k < system.k_end(); ++k) {
    system.at(k).set_Q(white(system.n(k + 1), options.process_noise));
    system.at(k).set_R(white(system.outputs, options.measurement_noise));
  }
  const Index n = system.n(system.k_begin);
  system.x0_mean = Vector::Zero(n);
  system.x0_cov = white(n, options.initial_state == InitialState::zero ? 0.0 : 1.0);
  system.initial_state = options.initial_state;
  return kalman_observer(std::move(system));
}

Ensemble expected_moments(const Model& system) {
  system.check();
  if (system.steps() == 0 || system.k_begin != 0)
    throw std::invalid_argument(fmt::format("system: {} steps from step {} found, at least one from step 0 needed",
                                            system.steps(), system.k_begin));
  if (!system.has(&Step::has_Q) || !system.has(&Step::has_R))
    throw std::invalid_argument("Q and R: not known of this system, both needed at each step");
  const auto factor = [](const Matrix& covariance, const char* name) {
    std::optional<Matrix> f = linalg::covariance_factor(covariance);
    if (!f)
      throw std::invalid_argument(
          fmt::format("{}: no covariance found, a symmetric matrix without negative eigenvalues needed", name));
    return std::move(*f);
  };
  const Index T = system.steps(), n0 = system.n(system.k_begin);
  Index states = 0;
  for (Index k = 0; k <= T; ++k) states += system.n(k);
  const Index sources = states + T * (system.inputs + system.outputs);  // x_0, and u_k, v_k, w_k of every step
  // The mean over the sources replaces the expectation. With this weight each source counts once, instead of 1/sources
  // times.
  const double weight = std::sqrt(double(sources));
  Ensemble ensemble(sources, T, system.inputs, system.outputs, system.dt);
  ensemble.names = system.names;
  ensemble.initial_state = system.initial_state;
  Matrix x = Matrix::Zero(sources, n0), y, next;
  Index row = 0;
  const auto excite = [&](auto&& target, const Matrix& f) {
    target.middleRows(row, f.cols()) += f.transpose();
    row += f.cols();
  };
  excite(x, system.x0_cov.size() > 0 ? factor(system.x0_cov, "x0_cov") : Matrix(Matrix::Zero(n0, n0)));
  for (Index k = 0; k < T; ++k) {
    const size_t s = size_t(k);
    Matrix u = Matrix::Zero(sources, system.inputs);
    excite(u, Matrix::Identity(system.inputs, system.inputs));
    observer::output(system.step[s], x, u, y);
    excite(y, factor(system.step[s].R(), "R"));
    observer::next_state(system.step[s], x, u, next);
    x.swap(next);
    excite(x, factor(system.step[s].Q(), "Q"));
    ensemble.input(k) = weight * u;
    ensemble.output(k) = weight * y;
  }
  return ensemble;
}

}  // namespace tokid
