// SPDX-License-Identifier: BSD-3-Clause
#include "report/responses.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/nan.hpp"
#include "model/continuation.hpp"
#include "modes/frozen.hpp"
#include "tokid/modes.hpp"

namespace tokid {

namespace report {

namespace {

constexpr Index longest = 60, most_starts = 7, most_frequencies = 60;
constexpr Index most_numbers = 40'000;  // of the pulse and step responses together

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
  return model.period > 0 ? longest : std::clamp<Index>((model.steps() + 1) / 2, 1, longest);
}

std::vector<Index> response_starts(const Model& model) {
  const Index length = response_length(model), channels = std::max<Index>(1, model.inputs * model.outputs);
  const Index most = std::clamp<Index>(most_numbers / (2 * length * channels), 1, most_starts);
  const Index count = model.period > 0 ? std::min(model.period, model.steps()) : model.steps() - length + 1;
  std::vector<Index> all;
  for (Index k = model.k_begin; k < model.k_begin + count; ++k) all.push_back(k);
  return spread(all, most);
}

std::optional<Modes> modes_of_page(const Model& model) {
  const ModesOptions options;
  if (model.states() == 0 || !modes_of::has_window(model, options.window)) return std::nullopt;
  return modes(model, options);
}

FrozenResponses frozen_responses(const Model& model, const Modes& found) {
  FrozenResponses result;
  result.limit = found.slow;
  result.all = found.steps();
  std::vector<Index> slow;
  double slowest = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < found.steps(); ++k)
    if (found.valid.row(k).all()) {
      slow.push_back(found.begin + k);
      slowest = std::min(slowest, found.poles.row(k).cwiseAbs().minCoeff());
    }
  result.slow = Index(slow.size());
  if (slow.empty()) return result;
  const Index channels = std::max<Index>(1, model.inputs * model.outputs);
  const Index most = std::clamp<Index>(most_numbers / (2 * most_frequencies * channels), 1, most_starts);
  // From below the slowest mode to the Nyquist frequency.
  const double highest = std::numbers::pi / model.dt, lowest = std::clamp(slowest / 10, highest / 1e4, highest / 10);
  result.frequencies.resize(most_frequencies);
  for (Index i = 0; i < most_frequencies; ++i)
    result.frequencies(i) = lowest * std::pow(highest / lowest, double(i) / double(most_frequencies - 1));
  const modes_of::Frozen frozen(model, found.window);
  for (const Index k : spread(slow, most)) {
    const Step system = frozen.whole(k);
    if (system.states() == 0) continue;  // the window does not determine the state
    result.steps.push_back(k);
    result.response.push_back(frequency_response(system, model.dt, result.frequencies));
  }
  return result;
}

}  // namespace report

ResponseBands response_bands(const Model& model, const Ensemble& identified, const ConfidenceOptions& options) {
  const std::vector<Index> starts = report::response_starts(model);
  const Index length = report::response_length(model), size = length * model.outputs * model.inputs;
  const Functional all = [&](const Model& other) {
    const report::Responses found = report::responses(other, starts, length);
    Vector values(2 * Index(starts.size()) * size);
    Index at = 0;
    for (const auto* kind : {&found.pulse, &found.step})
      for (const Matrix& values_of_start : *kind) {
        values.segment(at, size) = values_of_start.reshaped();
        at += size;
      }
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
  result.findings = std::move(found.findings);
  Index at = 0;
  const auto next = [&](std::vector<Matrix>& lower, std::vector<Matrix>& upper) {
    lower.emplace_back(found.interval.lower.reshaped().segment(at, size).reshaped(length, size / length));
    upper.emplace_back(found.interval.upper.reshaped().segment(at, size).reshaped(length, size / length));
    at += size;
  };
  for (size_t s = 0; s < starts.size(); ++s) next(result.pulse_lower, result.pulse_upper);
  for (size_t s = 0; s < starts.size(); ++s) next(result.step_lower, result.step_upper);
  return result;
}

}  // namespace tokid
