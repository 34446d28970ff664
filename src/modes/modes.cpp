// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/nan.hpp"
#include "modes/frozen.hpp"
#include "modes/tracks.hpp"
#include "tokid/linalg.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

using modes_of::Frozen;
using modes_of::StepModes;

constexpr double smallest = 1e-12;  // |z| of a pole that decays within a step
constexpr std::complex<double> none(nan, nan);

std::complex<double> continuous(std::complex<double> z, double dt) {
  return std::complex<double>(std::log(std::max(std::abs(z), smallest)), std::arg(z)) / dt;
}

// Samples show no mode that is faster than half of their rate: z is a negative real number, which belongs to no
// continuous system, or the mode decays to less than e^-π within a step. Rounding errors must not decide about z = -1.
bool resolved(std::complex<double> s, double dt) { return std::abs(s) * dt < std::numbers::pi * (1 - 1e-12); }

StepModes spectrum_of(const Step& frozen, Index states, double dt) {
  const Index m = frozen.outputs();
  StepModes result{Eigen::VectorXcd::Constant(states, none), Eigen::MatrixXcd::Constant(m, states, none)};
  if (frozen.states() == 0) return result;
  const linalg::Eigensystem eigen = linalg::eigensystem(frozen.A());
  if (!eigen.values.allFinite()) return result;
  for (Index i = 0; i < states; ++i) result.poles(i) = continuous(eigen.values(i), dt);
  result.shapes = frozen.C().cast<std::complex<double>>() * eigen.right;
  for (Index i = 0; i < states; ++i) {
    Index largest = 0;
    const double size = result.shapes.col(i).cwiseAbs().maxCoeff(&largest);
    if (size > 0) result.shapes.col(i) /= std::complex<double>(result.shapes(largest, i));
  }
  return result;
}

std::vector<StepModes> spectra_of(const Frozen& frozen, const Model& model, const Execution& execution) {
  std::vector<StepModes> result(size_t(frozen.count()));
  parallel_for(0, frozen.count(), execution, [&](Index begin, Index end) {
    const std::vector<Step> systems = frozen.systems(frozen.begin() + begin, end - begin);
    for (Index i = begin; i < end; ++i)
      result[size_t(i)] = spectrum_of(systems[size_t(i - begin)], model.states(), model.dt);
  });
  return result;
}

// The change of pole i and its shape from one step to another `time` [s] later, over the time 1/|s|.
double change(const StepModes& before, const StepModes& after, std::complex<double> s, Index i, double time) {
  const double size = std::abs(s);
  const double change = std::hypot(std::abs(after.poles(i) - before.poles(i)),
                                   size * modes_of::sine(before.shapes.col(i), after.shapes.col(i)));
  return change == 0 ? 0.0 : change / (size * size * time);
}

// Differences over the time 1/|s|, but over two steps at least: shorter ones are as random as the noise.
double variation(const std::vector<StepModes>& spectra, size_t k, Index i, double dt) {
  const std::complex<double> s = spectra[k].poles(i);
  const double steps = std::ceil(0.5 / (std::abs(s) * dt));
  const size_t reach = steps < double(spectra.size()) ? std::max<size_t>(1, size_t(steps)) : spectra.size();
  const size_t first = k > reach ? k - reach : 0, last = std::min(spectra.size() - 1, k + reach);
  if (first == last) return nan;
  return change(spectra[first], spectra[last], s, i, double(last - first) * dt);
}

void check(const ModesOptions& options) {
  if (!(options.slow >= 0)) throw std::invalid_argument(fmt::format("slow: {} found, 0 or more needed", options.slow));
}

Matrix each_pole(const Modes& modes, double (*value)(std::complex<double>)) {
  Matrix result(modes.steps(), modes.count());
  for (Index k = 0; k < modes.steps(); ++k)
    for (Index i = 0; i < modes.count(); ++i) result(k, i) = value(modes.poles(k, i));
  return result;
}

}  // namespace

Modes modes(const Model& model, const ModesOptions& options) {
  check(options);
  const Frozen frozen(model, options.window);
  std::vector<StepModes> spectra = spectra_of(frozen, model, options.execution);
  const size_t steps = spectra.size();
  // A periodic model goes on before its first step and after its last step.
  const size_t first = model.period > 0 ? steps : 0;
  if (model.period > 0)
    for (size_t i = 0; i < 2 * steps; ++i) spectra.push_back(StepModes(spectra[i]));
  modes_of::follow(spectra);
  modes_of::sort_columns(spectra);

  const Index n = model.states();
  Modes result;
  result.begin = frozen.begin();
  result.dt = model.dt;
  result.window = frozen.window();
  result.slow = options.slow;
  result.poles.resize(Index(steps), n);
  result.variation.resize(Index(steps), n);
  result.valid.resize(Index(steps), n);
  for (size_t k = 0; k < steps; ++k) {
    result.shapes.push_back(spectra[first + k].shapes);
    for (Index i = 0; i < n; ++i) {
      const std::complex<double> s = spectra[first + k].poles(i);
      const double size = variation(spectra, first + k, i, model.dt);
      result.poles(Index(k), i) = s;
      result.variation(Index(k), i) = size;
      result.valid(Index(k), i) = size <= options.slow && resolved(s, model.dt);
    }
  }
  return result;
}

Matrix natural_frequencies(const Modes& modes) {
  return each_pole(modes, [](std::complex<double> s) { return std::abs(s); });
}

Matrix damping_ratios(const Modes& modes) {
  return each_pole(modes, [](std::complex<double> s) { return s == 0.0 ? nan : -s.real() / std::abs(s); });
}

Model frozen_system(const Model& model, Index k, const ModesOptions& options) {
  const Frozen frozen(model, options.window);
  if (k < frozen.begin() || k >= frozen.begin() + frozen.count())
    throw std::invalid_argument(fmt::format("step: {} found, {} to {} needed with a window of {} steps", k,
                                            frozen.begin(), frozen.begin() + frozen.count() - 1, frozen.window()));
  Step system = frozen.whole(k);
  if (system.states() == 0)
    throw std::invalid_argument(fmt::format(
        "window: the outputs of the {} steps around step {} don't determine the state; a longer window needed",
        frozen.window(), k));
  Model result;
  result.inputs = model.inputs;
  result.outputs = model.outputs;
  result.dt = model.dt;
  result.names = model.names;
  result.method = "known";
  result.period = 1;
  result.step.push_back(std::move(system));
  return result;
}

// (zI - A)(X + iY) = B in real numbers, with z = c + is.
std::vector<Eigen::MatrixXcd> frequency_response(const Step& system, double dt, const Vector& frequencies) {
  const Index n = system.states(), r = system.inputs();
  if (system.next_states() != n)
    throw std::invalid_argument(
        fmt::format("A: {} x {} found, a square matrix needed", system.next_states(), system.states()));
  Matrix whole(2 * n, 2 * n), inputs = Matrix::Zero(2 * n, r);
  inputs.topRows(n) = system.B();
  std::vector<Eigen::MatrixXcd> result;
  for (const double frequency : frequencies) {
    const double c = std::cos(frequency * dt), s = std::sin(frequency * dt);
    const Matrix identity = Matrix::Identity(n, n);
    whole << c * identity - system.A(), -s * identity, s * identity, c * identity - system.A();
    const Matrix states = linalg::solve(whole, inputs);
    Eigen::MatrixXcd response(system.outputs(), r);
    response.real() = system.C() * states.topRows(n) + system.D();
    response.imag() = system.C() * states.bottomRows(n);
    result.push_back(std::move(response));
  }
  return result;
}

}  // namespace tokid
