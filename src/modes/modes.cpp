// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/nan.hpp"
#include "modes/frozen.hpp"
#include "modes/spectra.hpp"
#include "modes/tracks.hpp"
#include "tokid/linalg.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

using modes_of::Frozen;
using modes_of::Spectra;
using modes_of::StepModes;

// Samples show no mode that is faster than half of their rate: z is a negative real number, which belongs to no
// continuous system, or the mode decays to less than e^-π within a step. Rounding errors must not decide about z = -1.
bool resolved(std::complex<double> s, double dt) { return std::abs(s) * dt < std::numbers::pi * (1 - 1e-12); }

// Half of a window has several times the noise of a whole one: good poles of noisy models change by up to twice `slow`.
constexpr double window_limit = 3.0;

// The change of pole i and its shape between two steps, relative to |s|.
double change(const StepModes& from, const StepModes& to, std::complex<double> s, Index i) {
  const double size = std::abs(s);
  const double change =
      std::hypot(std::abs(to.poles(i) - from.poles(i)), size * modes_of::sine(from.shapes.col(i), to.shapes.col(i)));
  return change == 0 ? 0.0 : change / size;
}

// The distances of the steps that are compared: all up to 16, and farther ones at growing intervals, so that the time
// does not grow with the square of the steps. No period divides all of them: a fast oscillation is not missed.
size_t next(size_t distance) { return distance + 1 + distance / 16; }

// The largest change between step k and the steps up to 1/(2|s|) away, over that time, during 1/|s|. Neighbours alone
// are as random as the noise, and the outermost steps alone miss an oscillation.
double variation(const std::vector<StepModes>& spectra, size_t k, Index i, double dt) {
  const std::complex<double> s = spectra[k].poles(i);
  const size_t room = std::max(k, spectra.size() - 1 - k);
  const double steps = std::ceil(0.5 / (std::abs(s) * dt));
  const size_t reach = steps < double(room) ? std::max<size_t>(1, size_t(steps)) : room;
  double largest = nan, farthest = 0.0;
  const auto compare = [&](size_t at, size_t distance) {
    const double found = change(spectra[k], spectra[at], s, i);
    if (std::isnan(found)) return;
    largest = std::fmax(largest, found);
    farthest = double(distance);
  };
  for (size_t distance = 1; distance <= reach;
       distance = distance < reach ? std::min(reach, next(distance)) : reach + 1) {
    if (distance <= k) compare(k - distance, distance);
    if (k + distance < spectra.size()) compare(k + distance, distance);
  }
  return largest == 0 ? 0.0 : largest / (std::abs(s) * farthest * dt);
}

// (S × n) relative change of the poles with another window, the largest one over a window: at some phases of an
// oscillation, both poles are equal. NaN where there is none.
Matrix window_change(const Model& model, const Eigen::MatrixXcd& poles, Index begin, Index window,
                     const Execution& execution) {
  const Index other = modes_of::other_window(model, window);
  if (other == 0) return Matrix::Constant(poles.rows(), poles.cols(), nan);
  const Eigen::MatrixXcd found = modes_of::poles_in_order(poles, begin, modes_of::spectra(model, other, execution));
  Matrix change = (found - poles).cwiseAbs().cwiseQuotient(poles.cwiseAbs());
  // Gives both poles of each conjugate pair one of their two values.
  const auto join_pairs = [&](Matrix& values, auto&& choose) {
    for (Index k = 0; k < poles.rows(); ++k)
      for (Index i = 0; i < poles.cols(); ++i)
        for (Index j = i + 1; j < poles.cols(); ++j)
          if (poles(k, i).imag() != 0 && poles(k, j) == std::conj(poles(k, i)))
            values(k, i) = values(k, j) = choose(values(k, i), values(k, j));
  };
  // Both poles of a conjugate pair are one mode. If only one of them was matched with its own pole of the other window,
  // that one tells the change.
  join_pairs(change, [](double a, double b) { return std::fmin(a, b); });
  Matrix result = Matrix::Constant(poles.rows(), poles.cols(), nan);
  const Index steps = poles.rows();
  for (Index k = 0; k < steps; ++k)
    for (Index j = k - window / 2; j <= k + window / 2; ++j) {
      if (model.period == 0 && (j < 0 || j >= steps)) continue;
      const Index at = ((j % steps) + steps) % steps;  // a periodic model repeats
      for (Index i = 0; i < poles.cols(); ++i) result(k, i) = std::fmax(result(k, i), change(at, i));
    }
  // Where the columns of a pair have been two real poles within the window, the larger change counts for both.
  join_pairs(result, [](double a, double b) { return std::fmax(a, b); });
  return result;
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

Modes modes(const Model& given, const ModesOptions& options) {
  check(options);
  const Model model = modes_of::lasting(given);
  Spectra found = modes_of::spectra(model, options.window, options.execution);
  std::vector<StepModes>& spectra = found.step;
  const size_t steps = spectra.size();
  // A periodic model goes on before its first step and after its last step.
  const size_t first = model.period > 0 ? steps : 0;
  if (model.period > 0)
    for (size_t i = 0; i < 2 * steps; ++i) spectra.push_back(StepModes(spectra[i]));
  modes_of::follow(spectra);
  modes_of::sort_columns(spectra);

  const Index n = model.states();
  Modes result;
  result.begin = found.begin;
  result.dt = model.dt;
  result.window = found.window;
  result.slow = options.slow;
  result.poles.resize(Index(steps), n);
  for (size_t k = 0; k < steps; ++k) {
    result.poles.row(Index(k)) = spectra[first + k].poles.transpose();
    result.shapes.push_back(spectra[first + k].shapes);
  }
  result.window_change = window_change(model, result.poles, result.begin, result.window, options.execution);
  result.variation.resize(Index(steps), n);
  parallel_for(0, Index(steps), options.execution, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index i = 0; i < n; ++i) result.variation(k, i) = variation(spectra, first + size_t(k), i, model.dt);
  });
  result.valid.resize(Index(steps), n);
  for (Index k = 0; k < Index(steps); ++k)
    for (Index i = 0; i < n; ++i)
      result.valid(k, i) = result.variation(k, i) <= options.slow &&
                           !(result.window_change(k, i) > window_limit * options.slow) &&
                           resolved(result.poles(k, i), model.dt);
  return result;
}

Matrix natural_frequencies(const Modes& modes) {
  return each_pole(modes, [](std::complex<double> s) { return std::abs(s); });
}

Matrix damping_ratios(const Modes& modes) {
  return each_pole(modes, [](std::complex<double> s) { return s == 0.0 ? nan : -s.real() / std::abs(s); });
}

std::vector<Model> frozen_systems(const Model& model, const std::vector<Index>& steps, const ModesOptions& options) {
  const Frozen frozen(model, options.window);
  std::vector<Model> result;
  for (const Index k : steps) {
    if (k < frozen.begin() || k >= frozen.begin() + frozen.count())
      throw std::invalid_argument(fmt::format("step: {} found, {} to {} needed with a window of {} steps", k,
                                              frozen.begin(), frozen.begin() + frozen.count() - 1, frozen.window()));
    Step system = frozen.whole(k);
    if (system.states() == 0)
      throw std::invalid_argument(fmt::format(
          "window: the outputs of the {} steps around step {} don't determine the state; a longer window needed",
          frozen.window(), k));
    Model& one = result.emplace_back();
    one.inputs = model.inputs;
    one.outputs = model.outputs;
    one.dt = model.dt;
    one.names = model.names;
    one.method = "known";
    one.period = 1;
    one.step.push_back(std::move(system));
  }
  return result;
}

Model frozen_system(const Model& model, Index k, const ModesOptions& options) {
  return std::move(frozen_systems(model, {k}, options).front());
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
