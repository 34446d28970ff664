// SPDX-License-Identifier: BSD-3-Clause
#include "large/decide.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "choose/realisation.hpp"
#include "data/channel_sizes.hpp"
#include "model/options.hpp"
#include "tokid/remarks.hpp"
#include "tokid/subspace.hpp"

namespace tokid::stream {

namespace {

// The size of the first steps in memory [bytes], and their number.
constexpr double most_bytes = 16e6;
constexpr Index fewest_steps = 160, most_steps = 512;
// λ if the first steps show no variation over time. It is finite, because the system may still vary slowly over the
// whole record.
constexpr double stiff = 1e3;

void check(const IdentifyOptions& o) {
  const auto refuse = [](const char* what, const std::string& found, const char* remedy) {
    throw std::invalid_argument(
        fmt::format("{}: {} found, which needs all steps at once. To identify in blocks, {}", what, found, remedy));
  };
  if (o.period > 0) refuse("period", std::to_string(o.period), "state no period");
  if (o.smoothing && std::isinf(*o.smoothing)) refuse("smoothing", "infinity", "state a finite smoothing");
  if (o.jumps && !o.jumps->empty()) refuse("jumps", std::to_string(o.jumps->front()), "state no jumps");
  if (o.delays && !o.delays->empty()) refuse("delays", find_option("delays")->write(o).dump(), "state no delays");
  if (o.outliers != OutlierChoice::keep)
    refuse("outliers", find_option("outliers")->write(o).get<std::string>(),
           "use outliers keep: tokid then names the outliers and keeps them");
  if (o.frame == Frame::reference) refuse("frame", "reference", "use the frame raw or smooth");
}

Ensemble first_steps(const EnsembleFile& file, const IdentifyOptions& o) {
  const double bytes_of_step = double(file.experiments() * file.channels()) * sizeof(double);
  const Index fit = Index(std::clamp(most_bytes / bytes_of_step, double(fewest_steps), double(most_steps)));
  Ensemble data = file.read(0, std::min(file.steps(), std::max(fit, 8 * o.lags.value_or(0))));
  data.free = {};
  return data;
}

// Do the first steps show no variation over time?
bool is_constant(const Plan& plan) {
  const TimeVariation& variation = plan.choices.variation;
  return plan.coupled && (variation.period > 0 || std::isinf(variation.smoothing));
}

Plan of_blocks(const Identification& found, const Ensemble& data, const IdentifyOptions& options) {
  Plan plan = found.plan;
  if (is_constant(plan)) plan.choices = NoisyChoices{{stiff, 0}, SubspaceOptions::state_share * stiff};
  plan.method = options.method.value_or(automatic_method(plan));
  plan.initial_state = found.model.initial_state;
  plan.frame = options.frame;
  plan.states = options.states.value_or(plan.noisy ? found.model.states() : 0);
  Ensemble sized = options.hold_out > 0 ? split(data, options.hold_out).training : data;
  if (plan.nominal) sized = departures(std::move(sized), nominal_trajectory(sized));
  plan.output_size = channel_sizes(sized, sized.inputs(), sized.outputs());
  plan.input_size = channel_sizes(sized, 0, sized.inputs());
  return plan;
}

}  // namespace

Decision decide(const EnsembleFile& file, const IdentifyOptions& options) {
  check(options);
  const Ensemble data = first_steps(file, options);
  IdentifyOptions o = options;
  o.frame = Frame::raw;
  o.jumps = std::vector<Index>{};
  o.delays = std::vector<Index>{};
  o.execution.progress = {};
  Decision result;
  result.evidence = identify(data, o);
  result.plan = of_blocks(result.evidence, data, options);
  Findings& findings = result.evidence.findings;
  // The blocks vary if the first steps do not, and the steps after them may have what these lack.
  std::erase_if(findings, [&](const Finding& f) {
    return f.kind == Finding::Kind::no_variation || f.kind == Finding::Kind::experiments_empty ||
           (f.kind == Finding::Kind::experiments_end_early && data.steps() < file.steps());
  });
  const Findings of_file = remarks(data);
  for (Finding& finding : findings)
    if (std::none_of(of_file.begin(), of_file.end(), [&](const Finding& f) { return same_words(f, finding); }))
      finding.scope = Finding::Scope::first_steps;
  if (is_constant(result.evidence.plan)) {
    result.evidence.refinement = {};
    findings.push_back({.kind = Finding::Kind::constant_first_steps, .numbers = {{"smoothing", stiff}}});
  }
  result.evidence.plan = result.plan;
  return result;
}

}  // namespace tokid::stream
