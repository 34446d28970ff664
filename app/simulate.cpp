// tokid simulate: outputs of a model for new inputs, from the zero state, the mean initial state or an estimate.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"
#include "tokid/validate.hpp"

namespace tokid::app {

namespace {

struct SimulateCall {
  fs::path model, inputs, output;
  bool estimate = false;
  ReadOptions read{{}, {}, false};
};

void run_simulate(const SimulateCall& call) {
  check_output(call.output, Content::ensemble, {call.model, call.inputs});
  const Model model = load_model(call.model);
  const Ensemble inputs = load_data(model, call.inputs, call.read);
  const Ensemble result =
      about(call.inputs, [&] { return call.estimate ? simulate_data(model, inputs) : simulate(model, inputs); });
  save_ensemble(result, call.output);

  Page page;
  page.row("Model", describe(model));
  page.row("Simulated",
           fmt::format("{}, {}, from the {} at step {}", plural(result.experiments(), "experiment"),
                       plural(result.steps(), "step"), simulation_start(model, inputs, call.estimate), model.k_begin));
  page.row("", coverage(result));
  page.row("Written", call.output.string());
  print(page.text());
  warn(remarks(model, inputs));
  warn(simulation_remarks(model, inputs, result, call.estimate));
}

}  // namespace

void add_simulate(CLI::App& tool) {
  const auto call = std::make_shared<SimulateCall>();
  Command command(tool, "simulate", "Simulate the outputs of a model for new inputs",
                  "tokid simulate model.npz inputs.npz -o simulated.npz");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.argument("INPUTS", call->inputs, "Ensemble with the inputs; only --estimate-state uses its outputs");
  command.output(call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  command.flag("--estimate-state", call->estimate,
               "Estimate unknown initial states from the outputs of the first steps");
  command.columns(call->read);
  command.runs([call] { run_simulate(*call); });
}

}  // namespace tokid::app
