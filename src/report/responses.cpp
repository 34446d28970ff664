// SPDX-License-Identifier: BSD-3-Clause
#include "report/responses.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/continuation.hpp"
#include "modes/frozen.hpp"
#include "tokid/modes.hpp"

namespace tokid {

namespace report {

namespace {

constexpr Index longest = 60, most_starts = 7, most_frequencies = 60;
constexpr double turn = 2 * std::numbers::pi;
constexpr Index most_numbers = 40'000;  // of the pulse and step responses together
// The same for chosen steps, with their bands three times as many.
constexpr Index most_chosen = 24, most_chosen_numbers = 120'000;

// At most `most` evenly spaced entries, with the first and the last.
std::vector<Index> spread(const std::vector<Index>& all, Index most) {
  const Index last = Index(all.size()) - 1, count = std::min<Index>(most, last + 1);
  std::vector<Index> result;
  for (Index i = 0; i < count; ++i) result.push_back(all[size_t(count > 1 ? i * last / (count - 1) : 0)]);
  return result;
}

// The output of the model at step k after an input of 1 from step `start` on, or at this step alone, for all inputs.
Matrix response(const Model& model, Index start, Index length, bool pulse) {
  const Index m = model.outputs, r = model.inputs;
  Matrix result = Matrix::Constant(length, m * r, nan);
  Matrix x, y;
  for (Index k = start; k < start + length && has_step(model, start) && has_step(model, k); ++k) {
    const Step& step = step_at(model, k);
    const bool acts = k == start || !pulse;
    if (k == start) x = Matrix::Zero(step.states(), r);
    y = step.C() * x;
    if (acts) y += step.D();
    result.row(k - start) = y.reshaped().transpose();
    x = step.A() * x;
    if (acts) x += step.B();
  }
  return result;
}

}  // namespace

Responses responses(const Model& model, const std::vector<Index>& starts, Index length) {
  Responses result{starts, length, {}, {}};
  for (const Index start : starts) {
    result.pulse.push_back(response(model, start, length, true));
    result.step.push_back(response(model, start, length, false));
  }
  return result;
}

Index response_length(const Model& model) {
  return goes_on(model) ? longest : std::clamp<Index>((model.steps() + 1) / 2, 1, longest);
}

namespace {

// The steps of `at` in order, each once.
std::vector<Index> chosen_steps(const Model& model, std::vector<Index> at) {
  std::sort(at.begin(), at.end());
  at.erase(std::unique(at.begin(), at.end()), at.end());
  for (const Index k : at)
    if (!has_step(model, k))
      throw std::invalid_argument(fmt::format("at: step {} found, {} needed", k,
                                              goes_on(model)
                                                  ? fmt::format("{} or later", model.k_begin)
                                                  : fmt::format("{} to {}", model.k_begin, model.k_end() - 1)));
  const Index numbers =
      2 * std::max(response_length(model), most_frequencies) * std::max<Index>(1, model.inputs * model.outputs);
  const Index most = std::clamp<Index>(most_chosen_numbers / numbers, 1, most_chosen);
  if (Index(at.size()) > most)
    throw std::invalid_argument(fmt::format("at: {} steps found, {} or fewer needed for {} inputs and {} outputs",
                                            at.size(), most, model.inputs, model.outputs));
  return at;
}

}  // namespace

std::vector<Index> response_starts(const Model& model, const std::vector<Index>& at) {
  if (!at.empty()) return chosen_steps(model, at);
  const Index length = response_length(model), channels = std::max<Index>(1, model.inputs * model.outputs);
  const Index most = std::clamp<Index>(most_numbers / (2 * length * channels), 1, most_starts);
  const Index count = goes_on(model) ? model.period : model.steps() - length + 1;
  std::vector<Index> all;
  for (Index k = model.k_begin; k < model.k_begin + count; ++k) all.push_back(k);
  return spread(all, most);
}

std::optional<Modes> modes_of_page(const Model& model) {
  const ModesOptions options;
  if (!modes_of::has_window(model, options.window)) return std::nullopt;
  return modes(model, options);
}

Index row_of(const Model& model, const Modes& modes, Index k) {
  const Index row = k - modes.begin;
  if (row >= 0 && goes_on(model)) return row % modes.steps();
  return row >= 0 && row < modes.steps() ? row : -1;
}

namespace {

bool all_valid(const Modes& found, Index row) { return row >= 0 && found.valid.row(row).all(); }

}  // namespace

FrozenResponses frozen_responses(const Model& model, const Modes& found, const std::vector<Index>& at) {
  FrozenResponses result;
  result.limit = found.slow;
  result.all = found.steps();
  std::vector<Index> slow;
  double slowest = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < found.steps(); ++k)
    if (all_valid(found, k)) {
      slow.push_back(found.begin + k);
      slowest = std::min(slowest, found.poles.row(k).cwiseAbs().minCoeff());
    }
  result.slow = Index(slow.size());
  const std::vector<Index> asked = chosen_steps(model, at);
  for (const Index k : asked)
    if (!all_valid(found, row_of(model, found, k))) result.left_out.push_back(k);
  if (slow.empty()) return result;
  const Index channels = std::max<Index>(1, model.inputs * model.outputs);
  const Index most = std::clamp<Index>(most_numbers / (2 * most_frequencies * channels), 1, most_starts);
  // From below the slowest mode to the Nyquist frequency.
  const double highest = std::numbers::pi / model.dt, lowest = std::clamp(slowest / 10, highest / 1e4, highest / 10);
  result.frequencies.resize(most_frequencies);
  for (Index i = 0; i < most_frequencies; ++i)
    result.frequencies(i) = lowest * std::pow(highest / lowest, double(i) / double(most_frequencies - 1));
  const modes_of::Frozen frozen(model, found.window);
  for (const Index k : at.empty() ? spread(slow, most) : asked) {
    const Index row = row_of(model, found, k);
    if (!all_valid(found, row)) continue;
    const Step system = frozen.whole(found.begin + row);
    if (system.states() == 0) continue;  // the window does not determine the state
    result.steps.push_back(k);
    result.response.push_back(frequency_response(system, model.dt, result.frequencies));
  }
  return result;
}

std::vector<std::vector<Eigen::MatrixXcd>> frozen_responses_of(const Model& other, const std::optional<Modes>& modes,
                                                               const FrozenResponses& own, double dt) {
  std::vector<std::vector<Eigen::MatrixXcd>> result(own.steps.size());
  if (own.steps.empty() || !modes) return result;
  const modes_of::Frozen frozen(other, modes->window);
  for (size_t s = 0; s < own.steps.size(); ++s) {
    const Index row = row_of(other, *modes, own.steps[s]);
    if (!all_valid(*modes, row)) continue;
    if (const Step system = frozen.whole(modes->begin + row); system.states() > 0)
      result[s] = frequency_response(system, dt, own.frequencies);
  }
  return result;
}

FrozenCurves frozen_curves(const std::vector<std::vector<Eigen::MatrixXcd>>& response) {
  FrozenCurves result;
  for (const std::vector<Eigen::MatrixXcd>& at : response) {
    const Index columns = at.empty() ? 0 : at.front().size();
    Matrix magnitude(Index(at.size()), columns), phase = magnitude;
    for (Index c = 0; c < columns; ++c) {
      double before = 0.0;
      for (Index i = 0; i < magnitude.rows(); ++i) {
        const std::complex<double> value = at[size_t(i)].reshaped()(c);
        magnitude(i, c) = std::abs(value);
        phase(i, c) = std::arg(value);
        if (i > 0) phase(i, c) -= turn * std::round((phase(i, c) - before) / turn);
        if (std::isfinite(phase(i, c))) before = phase(i, c);
      }
    }
    result.magnitude.push_back(std::move(magnitude));
    result.phase.push_back(std::move(phase));
  }
  return result;
}

namespace {

// Logarithms of the magnitudes, and phases that differ by less than half a turn from those of `own`: for each step the
// magnitudes, then the phases. NaN where `model` has no frozen system, or a magnitude is zero.
Vector frozen_values(const Model& model, const FrozenResponses& own, const FrozenCurves& curves, Index window) {
  const Index size = own.frequencies.size() * model.outputs * model.inputs;
  Vector result = Vector::Constant(2 * size * Index(own.steps.size()), nan);
  if (own.steps.empty() || model.states() == 0) return result;
  const modes_of::Frozen frozen(model, window);
  for (size_t s = 0; s < own.steps.size(); ++s) {
    const Index row = goes_on(model) ? (own.steps[s] - frozen.begin()) % frozen.count() : own.steps[s] - frozen.begin();
    if (row < 0 || row >= frozen.count()) continue;
    const Step system = frozen.whole(frozen.begin() + row);
    if (system.states() == 0) continue;
    const FrozenCurves found = frozen_curves({frequency_response(system, model.dt, own.frequencies)});
    for (Index i = 0; i < size; ++i) {
      const double magnitude = found.magnitude.front().reshaped()(i), phase = found.phase.front().reshaped()(i);
      const double own_phase = curves.phase[s].reshaped()(i);
      if (!(magnitude > 0) || !std::isfinite(magnitude)) continue;
      result(2 * size * Index(s) + i) = std::log(magnitude);
      result(2 * size * Index(s) + size + i) = own_phase + std::remainder(phase - own_phase, turn);
    }
  }
  return result;
}

}  // namespace

}  // namespace report

ResponseBands response_bands(const Model& model, const Ensemble& identified, const ConfidenceOptions& options,
                             const std::vector<Index>& at) {
  if (model.inputs == 0) throw std::invalid_argument("bands: a model without inputs found, one with inputs needed");
  const std::vector<Index> starts = report::response_starts(model, at);
  const Index length = report::response_length(model), size = length * model.outputs * model.inputs;
  const std::optional<Modes> modes = report::modes_of_page(model);
  const report::FrozenResponses frozen =
      modes ? report::frozen_responses(model, *modes, at) : report::FrozenResponses{};
  report::FrozenCurves curves = report::frozen_curves(frozen.response);
  const Functional all = [&](const Model& other) {
    const report::Responses found = report::responses(other, starts, length);
    const Vector of_frozen = report::frozen_values(other, frozen, curves, modes ? modes->window : 0);
    Vector values(2 * Index(starts.size()) * size + of_frozen.size());
    Index next = 0;
    for (const auto* kind : {&found.pulse, &found.step})
      for (const Matrix& values_of_start : *kind) {
        values.segment(next, size) = values_of_start.reshaped();
        next += size;
      }
    values.tail(of_frozen.size()) = of_frozen;
    return values;
  };
  FunctionBounds found = function_bounds(model, identified, all, options);
  ResponseBands result;
  result.level = options.level;
  result.replicates = found.replicates;
  result.starts = starts;
  result.length = length;
  report::Responses own = report::responses(model, starts, length);
  result.pulse = std::move(own.pulse);
  result.step = std::move(own.step);
  result.frozen_steps = frozen.steps;
  result.frequencies = frozen.frequencies;
  result.magnitude = std::move(curves.magnitude);
  result.phase = std::move(curves.phase);
  result.findings = std::move(found.findings);
  Index next = 0;
  const auto take = [&](Index rows, std::vector<Matrix>& lower, std::vector<Matrix>& upper) {
    const Index columns = model.outputs * model.inputs;
    lower.emplace_back(found.interval.lower.reshaped().segment(next, rows * columns).reshaped(rows, columns));
    upper.emplace_back(found.interval.upper.reshaped().segment(next, rows * columns).reshaped(rows, columns));
    next += rows * columns;
  };
  for (size_t s = 0; s < starts.size(); ++s) take(length, result.pulse_lower, result.pulse_upper);
  for (size_t s = 0; s < starts.size(); ++s) take(length, result.step_lower, result.step_upper);
  for (size_t s = 0; s < frozen.steps.size(); ++s) {
    take(frozen.frequencies.size(), result.magnitude_lower, result.magnitude_upper);
    take(frozen.frequencies.size(), result.phase_lower, result.phase_upper);
  }
  for (auto* logarithms : {&result.magnitude_lower, &result.magnitude_upper})
    for (Matrix& values : *logarithms) values = values.array().exp();
  return result;
}

}  // namespace tokid
