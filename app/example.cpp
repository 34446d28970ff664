// tokid example: simulated experiments on systems with known answers.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct ExampleCall {
  std::string name;
  fs::path output;
  fs::path inputs;
  Index steps = 100;
  ExperimentOptions options;
};

void run_example(const ExampleCall& call) {
  check_output(call.output, Content::ensemble);
  std::optional<Ensemble> planned;
  if (!call.inputs.empty()) planned = load_ensemble(call.inputs, {.outputs_required = false});
  const Index steps = planned ? planned->steps() : call.steps;
  const Model system = call.name == "oscillator" ? oscillator(steps) : rotating_tube(steps);
  const Ensemble data = planned ? about(call.inputs, [&] { return experiments(system, *planned, call.options); })
                                : experiments(system, call.options);
  save_ensemble(data, call.output);

  Page page;
  page.row("System", fmt::format("{}, n = {} states", call.name, system.states()));
  page.row("Experiments", describe(data));
  page.row("", fmt::format("initial states {}, {}", to_string(call.options.initial_state),
                           plural(data.free.experiments, "free response")));
  page.row("Written", call.output.string());
  print(page.text());
}

}  // namespace

void add_example(CLI::App& tool) {
  const auto call = std::make_shared<ExampleCall>();
  ExperimentOptions& o = call->options;
  Command command(tool, "example", "Simulate experiments on a system whose model is known",
                  "tokid example oscillator -o data.npz --experiments 200 --measurement-noise 0.1");
  command.choice("SYSTEM", call->name,
                 Choices<std::string>{{"oscillator", "oscillator"}, {"rotating-tube", "rotating-tube"}},
                 "oscillator: the example of the paper, with 4 states; rotating-tube: 2 states");
  command.output(call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  command.number<Index>("--experiments", o.experiments, "N", "Number of experiments (default 50)", 1, 1'000'000);
  command.file("--inputs", call->inputs, "Inputs of the experiments, as plan writes them (default unit Gaussian)");
  command.number<Index>("--steps", call->steps, "T", "Number of time steps (default 100)", 1, 1'000'000);
  command.number<std::uint64_t>("--seed", o.seed, "S", "Seed of the random numbers (default 1)", 0);
  command.number("--process-noise", o.process_noise, "SD", "Standard deviation of the noise on each state (default 0)",
                 0.0);
  command.number("--measurement-noise", o.measurement_noise, "SD",
                 "Standard deviation of the noise on each output (default 0)", 0.0);
  command.number<Index>("--free-responses", o.free_responses, "NF", "Number of experiments without input (default 0)",
                        0, 1'000'000);
  command.choice("--initial-state", o.initial_state,
                 Choices<InitialState>{{"zero", InitialState::zero}, {"unknown", InitialState::unknown}},
                 "States at step 0 (default zero; unknown: random)");
  command.excludes("--inputs", "--experiments");
  command.excludes("--inputs", "--steps");
  command.runs([call] { run_example(*call); });
}

}  // namespace tokid::app
