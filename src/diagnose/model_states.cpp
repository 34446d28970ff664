// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/model_states.hpp"

#include <algorithm>

#include "base/integers.hpp"
#include "base/statistics.hpp"
#include "data/subjects.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

Findings findings_of_absent_states(const Model& model) {
  if (model.states() > 0) return {};
  return {{.kind = Finding::Kind::no_states}};
}

Findings findings_of_begin(const Model& model) {
  if (model.initial_state != InitialState::unknown || model.states() == 0 || model.k_begin == 0) return {};
  return {{.kind = Finding::Kind::late_begin, .numbers = {{"step", double(model.k_begin)}}}};
}

Findings findings_of_hidden_states(const Model& model) {
  const Index states = model.states();
  if (states == 0) return {};
  std::vector<Index> fewer;
  for (Index k = model.full_begin(), waiting = 0; k < model.k_end(); ++k) {
    if (model.n(k) < states) {
      ++waiting;
      continue;
    }
    for (Index i = k - waiting; i < k; ++i) fewer.push_back(i);
    waiting = 0;
  }
  if (fewer.empty()) return {};
  return {{.kind = Finding::Kind::states_hidden, .steps = fewer, .numbers = {{"states", double(states)}}}};
}

Findings findings_of_gains(const Model& model) {
  // Gains of observable states are closer to their median. The reference is at least the gain that takes the outputs
  // for exact, because gains decay to small values if there is no process noise.
  constexpr double many_times = 100.0;
  if (!model.has(&Step::has_K) || model.states() == 0) return {};
  // Gains are large until the outputs have determined unknown initial states.
  const Index first = model.full_begin() + 2 * ceil_div(model.states(), model.outputs);
  std::vector<double> sizes;
  for (Index k = first; k < model.k_end(); ++k) sizes.push_back(model.at(k).K().norm());
  if (sizes.empty()) return {};
  const double median = statistics::median(sizes);
  Finding found{.kind = Finding::Kind::gains_grow};
  double largest = 0.0;
  for (size_t i = 0; i < sizes.size(); ++i) {
    const Index k = first + Index(i);
    const double exact = linalg::pseudo_inverse(model.at(k).C()).norm();
    const double ratio = sizes[i] / std::max(median, exact);
    if (!(ratio > many_times)) continue;
    found.steps.push_back(k);
    largest = std::max(largest, ratio);
  }
  if (found.steps.empty()) return {};
  found.numbers = {{"ratio", largest}};
  return {std::move(found)};
}

Findings findings_of_fit(const Vector& one_step_fit, const Channels& names) {
  // Even pure noise has a small positive fit on the training data.
  constexpr double next_to_nothing = 5.0;
  Findings result;
  for (Index j = 0; j < one_step_fit.size(); ++j)
    if (one_step_fit(j) < next_to_nothing)
      result.push_back({.kind = Finding::Kind::output_unpredicted,
                        .channels = {output_channel(names, j)},
                        .numbers = {{"fit", one_step_fit(j)}}});
  return result;
}

std::vector<double> singular_value_gaps(const Model& model) {
  std::vector<double> gaps;
  const Index n = model.states(), end = std::min(model.full_end(), model.k_end());
  for (Index k = model.full_begin(); n > 0 && k < end; ++k)
    if (const Vector s = model.at(k).singular_values(); s.size() > n) gaps.push_back(s(n - 1) / s(n));
  return gaps;
}

}  // namespace tokid
