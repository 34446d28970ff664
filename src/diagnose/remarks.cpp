// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/remarks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "base/words.hpp"
#include "data/axes.hpp"

namespace tokid {

namespace {

void remark_on_axes(const Ensemble& data, Findings& result) {
  if (auto found = swapped_axes(data)) result.push_back(*std::move(found));
}

Findings of_reader(const Ensemble& data) {
  Findings result;
  for (const std::string& text : data.remarks) result.push_back({.kind = Finding::Kind::reader_remark, .detail = text});
  return result;
}

InitialState initial_state(const Model& model, const Ensemble& inputs) {
  return inputs.initial_state.value_or(model.initial_state);
}

void remark_no_outputs(const Ensemble& computed, Findings& result) {
  for (Index k = 0; k < computed.steps(); ++k)
    if (!computed.output(k).array().isNaN().all()) return;
  result.push_back({.kind = Finding::Kind::outputs_absent});
}

Findings remarks_on_data(const Model& model, const Ensemble& data) {
  Findings result = differences(model, data);
  append(result, findings_of_end(model, data));
  return result;
}

}  // namespace

Findings remarks(const Ensemble& data) {
  Findings result = of_reader(data);
  if (!data.dt_stated) result.push_back({.kind = Finding::Kind::sample_time_missing, .numbers = {{"dt", 1.0}}});
  remark_on_axes(data, result);
  return result;
}

Findings remarks(const Model& model, const Ensemble& data) {
  Findings result = of_reader(data);
  // If the model has no sample time either, this was reported when it was identified.
  if (!data.dt_stated && model.provenance.dt_stated)
    result.push_back({.kind = Finding::Kind::sample_time_of_model, .numbers = {{"dt", model.dt}}});
  remark_on_axes(data, result);
  return result;
}

std::string simulation_start(const Model& model, const Ensemble& inputs, bool estimate) {
  const InitialState initial = initial_state(model, inputs);
  if (estimate && !starts_from_zero(model, initial)) return "state that the first samples determine";
  return has_initial_estimate(model, initial) ? "mean initial state" : "zero state";
}

Findings simulation_remarks(const Model& model, const Ensemble& inputs, const Ensemble& simulated, bool estimate) {
  Findings result = remarks_on_data(model, inputs);
  remark_no_outputs(simulated, result);
  if (!estimate && !starts_from_zero(model, initial_state(model, inputs)))
    result.push_back({.kind = Finding::Kind::simulated_from,
                      .numbers = {{"step", double(model.k_begin)}},
                      .detail = simulation_start(model, inputs, estimate)});
  return result;
}

Findings prediction_remarks(const Model& model, const Ensemble& data, const Ensemble& predicted) {
  Findings result = remarks_on_data(model, data);
  remark_no_outputs(predicted, result);
  return result;
}

std::string nominal_remark(const NominalTest& test, const Channels& names, Index inputs, Index period) {
  constexpr size_t most_channels = 8;
  const std::string mean =
      fmt::format("mean t2 = {}, threshold {}", words::figure(test.statistic), words::figure(test.threshold));
  const std::string step = fmt::format("largest t2 of a step = {}, threshold {}", words::figure(test.step_statistic),
                                       words::figure(test.step_threshold));
  if (!test.significant) return fmt::format("none, no significant mean motion: {}; {}", mean, step);
  if (test.departures.empty() && test.statistic <= test.threshold)
    return fmt::format("the mean was removed, because the outputs have a significant constant: F = {}, threshold {}",
                       words::figure(test.constant_statistic), words::figure(test.constant_threshold));
  if (test.departures.empty())
    return fmt::format("the mean motion was removed, it is significant over all steps together: {}", mean);
  std::vector<std::string> channels;
  for (const NominalTest::Departure& departure : test.departures) {
    if (channels.size() == most_channels) {
      channels.push_back(fmt::format("and more ({} channels in all)", test.departures.size()));
      break;
    }
    const Index c = departure.channel;
    std::string text = c < inputs ? names.input(c) : names.output(c - inputs);
    // One model for all steps has one mean motion, so no steps are listed.
    if (period != 1) text += fmt::format(" at {}", words::step_list(departure.steps));
    channels.push_back(std::move(text));
  }
  return fmt::format("the mean motion was removed, it is significant: {} ({}; {})", fmt::join(channels, ", "), mean,
                     step);
}

}  // namespace tokid
