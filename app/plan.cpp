// tokid plan: the number of experiments, and inputs for them.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "command.hpp"
#include "common.hpp"
#include "verdict.hpp"

namespace tokid::app {

namespace {

struct PlanCall {
  fs::path model, output;
  PlanOptions options;
  bool json = false, verbose = false;
};

// The largest and the median number, and the first step that has the largest number up to rounding errors. NaN is
// ignored.
struct Extreme {
  double value = std::numeric_limits<double>::quiet_NaN(), median = std::numeric_limits<double>::quiet_NaN();
  Index step = 0;
};
Extreme extreme(const std::vector<double>& values) {
  Extreme result;
  for (const double value : values)
    if (!std::isnan(value) && !(value <= result.value)) result.value = value;
  // The relative rounding error of a condition number is a few eps times the number. It is limited to a half, because
  // the largest condition numbers are known only in size.
  const double rounding =
      std::min(0.5, 100 * std::numeric_limits<double>::epsilon() * std::max(1.0, std::abs(result.value)));
  const auto first = std::find_if(values.begin(), values.end(), [&](double value) {
    return value == result.value || value >= result.value - rounding * std::abs(result.value);
  });
  if (first != values.end()) result.step = static_cast<Index>(first - values.begin());
  result.median = median(values);
  return result;
}

std::string text_of(const Extreme& e) {
  return fmt::format("median {}, largest {} at step {}", number(e.median), number(e.value), e.step);
}

std::string report(const PlanCall& call, const PlanOptions& sizes, const ExperimentPlan& plan) {
  const Ensemble& u = plan.inputs;
  Page page;
  page.row("System", fmt::format("n = {} states, r = {} inputs, m = {} outputs; lag order p = {}", sizes.states,
                                 sizes.inputs, sizes.outputs, plan.lags));
  page.row("Experiments", fmt::format("N = {} of {}; minimum {}, recommended {}", u.experiments(),
                                      plural(u.steps(), "step"), plan.minimum, plan.recommended));
  if (call.verbose)
    for (const std::string& reason : plan.reasons) page.row("", reason);
  page.row("Inputs", fmt::format("{}, seed {}", to_string(plan.kind), sizes.seed));
  std::vector<std::vector<std::string>> rows{{"input", "limit", "peak", "RMS"}};
  for (Index i = 0; i < u.inputs(); ++i) {
    const double limit = sizes.amplitude[sizes.amplitude.size() == 1 ? 0 : size_t(i)];
    rows.push_back({input_label(u.names, i), number(limit), number(plan.peak(i)), number(plan.rms(i))});
  }
  page.table(rows);
  page.row("Condition", fmt::format("of the inputs in a window: {}", text_of(extreme(plan.input_condition))));
  if (plan.condition.empty()) {
    if (call.verbose) page.row("", "of the whole windows: not known without a model of the system (option --model)");
  } else {
    page.row("", fmt::format("of the windows W_k on the model: {}", text_of(extreme(plan.condition))));
    if (!std::isnan(plan.start_condition))
      page.row("", fmt::format("before the optimisation: largest {}", number(plan.start_condition)));
    std::string peaks;
    for (Index j = 0; j < plan.output_peak.size(); ++j)
      peaks += fmt::format("{}{} {}", j > 0 ? ", " : "", output_label(sizes.names, j), number(plan.output_peak(j)));
    page.row("Outputs", fmt::format("largest on the model: {}", peaks));
  }
  if (sizes.noise && sizes.noise->input == 0 && sizes.noise->output == 0)
    page.row("Noise", "none: every number of experiments from the minimum on gives the same coefficients");
  else if (std::isfinite(plan.excess))
    page.row("Noise", fmt::format("estimated coefficients add {} to the mean square of the best one-step error",
                                  share(plan.excess)));
  else
    page.row("Noise", "no degree of freedom is left to average the noise");
  if (!std::isnan(plan.noise_floor))
    page.row("", fmt::format("best one-step error: {} of the outputs; error of the Markov parameters: {}",
                             share(plan.noise_floor), share(plan.markov_error)));
  page.row("Written", call.output.string());
  page.command("Next", "apply these inputs, measure the outputs, and identify the model",
               fmt::format("tokid identify measured{} -o model.npz", extension_of(call.output)));
  return page.text();
}

Json json(const PlanOptions& sizes, const ExperimentPlan& plan) {
  const auto summary = [](const std::vector<double>& values) {
    const Extreme e = extreme(values);
    return Json{{"median", e.median}, {"largest", e.value}, {"step", e.step}, {"per_step", values}};
  };
  Json j;
  j["states"] = sizes.states;
  j["inputs"] = sizes.inputs;
  j["outputs"] = sizes.outputs;
  j["steps"] = plan.inputs.steps();
  j["lags"] = plan.lags;
  j["unknowns"] = plan.unknowns;
  j["experiments"] = plan.inputs.experiments();
  j["minimum"] = plan.minimum;
  j["recommended"] = plan.recommended;
  j["reasons"] = plan.reasons;
  j["kind"] = to_string(plan.kind);
  j["seed"] = sizes.seed;
  j["initial_state"] = to_string(*plan.inputs.initial_state);
  j["first_step"] = plan.first_step;
  j["peak"] = numbers(plan.peak);
  j["rms"] = numbers(plan.rms);
  j["excess"] = plan.excess;
  j["input_condition"] = summary(plan.input_condition);
  if (!plan.condition.empty()) {
    j["first_forecast"] = plan.first_forecast;
    j["condition"] = summary(plan.condition);
    j["start_condition"] = plan.start_condition;
    j["rank"] = plan.rank;
    j["output_peak"] = numbers(plan.output_peak);
    j["noise_floor"] = plan.noise_floor;
    j["markov_error"] = plan.markov_error;
  }
  add_findings(j, plan.findings);
  return j;
}

void run_plan(const PlanCall& call) {
  check_output(call.output, Content::ensemble, {call.model});
  PlanOptions options = call.options;
  std::optional<Model> model;
  if (call.model.empty()) {
    for (const auto& [name, value] : {std::pair{"--states", options.states}, std::pair{"--inputs", options.inputs},
                                      std::pair{"--outputs", options.outputs}, std::pair{"--steps", options.steps}})
      if (value == 0)
        throw std::invalid_argument(fmt::format(
            "{}: missing, but needed without --model. State this option, or a preliminary model by --model", name));
  } else {
    model = load_model(call.model);
  }
  const ExperimentPlan result = [&] {
    ProgressBar bar(true);
    options.execution.progress = bar.callback();
    return model ? plan(*model, options) : plan(options);
  }();
  if (model) {
    options.states = model->states();
    options.inputs = model->inputs;
    options.outputs = model->outputs;
    options.names = model->names;
  }
  save_ensemble(result.inputs, call.output);
  if (call.json)
    print(json(options, result));
  else
    print(report(call, options, result));
  warn(result.findings);
}

// "0.5" or "0.5,2,1"
std::optional<std::vector<double>> amplitudes(const std::string& text) {
  std::vector<double> values;
  for (const std::string& part : split_at_commas(text)) {
    const auto value = parse_number(part, std::numeric_limits<double>::min(), std::numeric_limits<double>::max());
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

// "0.01:0.1"
std::optional<NoiseLevel> noise_level(const std::string& text) {
  const size_t colon = text.find(':');
  const auto part = [](const std::string& level) {
    return parse_number(level, 0.0, std::numeric_limits<double>::max());
  };
  const auto input = part(text.substr(0, colon)),
             output = part(colon == std::string::npos ? "" : text.substr(colon + 1));
  return input && output ? std::optional<NoiseLevel>({*input, *output}) : std::nullopt;
}

}  // namespace

void add_plan(CLI::App& tool) {
  const auto call = std::make_shared<PlanCall>();
  PlanOptions& o = call->options;
  constexpr Index most = 1'000'000;
  Command command(tool, "plan", "Plan the number of experiments and their inputs",
                  "tokid plan --states 4 --inputs 2 --outputs 2 --steps 80 --amplitude 0.5 -o inputs.npz");
  command.number<Index>("--states", o.states, "n", "Number of states (default with --model: that of the model)", 1,
                        most);
  command.number<Index>("--inputs", o.inputs, "r", "Number of inputs (default with --model: that of the model)", 1,
                        most);
  command.number<Index>("--outputs", o.outputs, "m", "Number of outputs (default with --model: that of the model)", 1,
                        most);
  command.number<Index>("--steps", o.steps, "T", "Number of time steps (default with --model: that of the model)", 1,
                        most);
  command.count_or_auto("--lags", o.lags, "Lag order p (auto: the smallest, n/m rounded up)");
  command.count_or_auto("--experiments", o.experiments, "Number of experiments N (auto: the recommended number)");
  command.choice("--kind", o.kind,
                 Choices<std::optional<InputKind>>{{"orthogonal", InputKind::orthogonal},
                                                   {"gaussian", InputKind::gaussian},
                                                   {"binary", InputKind::binary},
                                                   {"multisine", InputKind::multisine},
                                                   {"optimised", InputKind::optimised}},
                 "Kind of the inputs (default optimised with --model, else orthogonal)");
  command.value("--amplitude", o.amplitude, "A,...", "Limit of |u|, one for all inputs, or one for each (default 1)",
                amplitudes, "positive numbers needed, such as 2 or 0.5,2");
  command.value("--noise", o.noise, "SD:SD",
                "Standard deviations of the noise on inputs and outputs (default: not known)", noise_level,
                "two standard deviations needed, such as 0.01:0.1");
  command.file("--model", call->model, "Preliminary model: .npz, .h5 or .mat");
  command.choice("--initial-state", o.initial_state,
                 Choices<std::optional<InitialState>>{{"zero", InitialState::zero}, {"unknown", InitialState::unknown}},
                 "States at step 0 (default zero; with --model: as in the model)");
  command.flag("--nominal", o.nominal, "The experiments depart from a mean motion, which is removed from the data");
  command.number("--dt", o.dt, "SECONDS", "Sample time (default 1; with --model: that of the model)",
                 std::numeric_limits<double>::min());
  command.number<std::uint64_t>("--seed", o.seed, "S", "Seed of the random numbers (default 1)", 0);
  command.threads(o.execution.threads);
  command.output(call->output, "Ensemble to write, inputs only: .npz, .h5, .mat or .csv");
  command.verbose(call->verbose);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_plan(*call); });
}

}  // namespace tokid::app
