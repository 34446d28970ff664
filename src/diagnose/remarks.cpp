// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/remarks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "base/words.hpp"
#include "data/axes.hpp"
#include "tokid/provenance.hpp"

namespace tokid {

namespace {

std::vector<std::string> remarks_on_reading(const Ensemble& data, std::string_view sample_time) {
  std::vector<std::string> result = data.remarks;
  if (!data.dt_stated && !sample_time.empty())
    result.push_back(fmt::format("the data state no sample time: {}", sample_time));
  if (auto text = swapped_axes(data)) result.push_back(*std::move(text));
  return result;
}

InitialState initial_state(const Model& model, const Ensemble& inputs) {
  return inputs.initial_state.value_or(model.initial_state);
}

void remark_no_outputs(const Ensemble& computed, std::vector<std::string>& result) {
  for (Index k = 0; k < computed.steps(); ++k)
    if (!computed.output(k).array().isNaN().all()) return;
  result.emplace_back("no step of the data has outputs of the model: all of them are missing (NaN)");
}

std::vector<std::string> remarks_on_data(const Model& model, const Ensemble& data) {
  std::vector<std::string> result = differences(model, data);
  if (auto beyond = steps_beyond(model, data)) result.push_back(*std::move(beyond));
  return result;
}

}  // namespace

std::vector<std::string> remarks(const Ensemble& data) {
  return remarks_on_reading(data, "dt = 1 s was taken; state dt where it is another");
}

std::vector<std::string> remarks(const Model& model, const Ensemble& data) {
  // What the model does not know either was told when it was identified.
  return remarks_on_reading(data, states_dt(model) ? fmt::format("the model's dt = {} s was taken", model.dt) : "");
}

std::string simulation_start(const Model& model, const Ensemble& inputs, bool estimate) {
  const InitialState initial = initial_state(model, inputs);
  if (estimate && !starts_from_zero(model, initial)) return "state that the first samples tell";
  return has_initial_estimate(model, initial) ? "mean initial state" : "zero state";
}

std::vector<std::string> simulation_remarks(const Model& model, const Ensemble& inputs, const Ensemble& simulated,
                                            bool estimate) {
  std::vector<std::string> result = remarks_on_data(model, inputs);
  remark_no_outputs(simulated, result);
  if (!estimate && !starts_from_zero(model, initial_state(model, inputs)))
    result.push_back(
        fmt::format("the initial states are unknown: simulated from the {} at step {}, where the model begins",
                    simulation_start(model, inputs, estimate), model.k_begin));
  return result;
}

std::vector<std::string> prediction_remarks(const Model& model, const Ensemble& data, const Ensemble& predicted) {
  std::vector<std::string> result = remarks_on_data(model, data);
  remark_no_outputs(predicted, result);
  return result;
}

std::string nominal_remark(const NominalTest& test, const Channels& names, Index inputs, Index period) {
  constexpr size_t most_channels = 8;
  const std::string mean = fmt::format("mean t2 = {:.4g}, threshold {:.4g}", test.statistic, test.threshold);
  const std::string step =
      fmt::format("largest t2 of a step = {:.4g}, threshold {:.4g}", test.step_statistic, test.step_threshold);
  if (!test.significant) return fmt::format("none, no significant mean motion: {}; {}", mean, step);
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
    // One model for all steps has one mean motion.
    if (period != 1) text += fmt::format(" at {}", words::step_list(departure.steps));
    channels.push_back(std::move(text));
  }
  return fmt::format("the mean motion was removed, it is significant: {} ({}; {})", fmt::join(channels, ", "), mean,
                     step);
}

}  // namespace tokid
