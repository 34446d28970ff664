// tokid simulate: outputs of a model for new inputs, from the zero state, the mean initial one or an estimate.
// SPDX-License-Identifier: BSD-3-Clause
#include "common.hpp"
#include "tokid/validate.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, inputs, output;
  bool estimate = false;
  ReadOptions read{{}, {}, false};
};

void run(const Call& call) {
  check_output(call.output, Content::ensemble, {call.model, call.inputs});
  const Model model = load_model(call.model);
  const Ensemble inputs = load_ensemble(call.inputs, call.read);
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
  warn(simulation_remarks(model, inputs, result, call.estimate));
}

}  // namespace

void add_simulate(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  CLI::App* command = add_command(tool, "simulate", "Outputs of a model for new inputs",
                                  "tokid simulate model.npz inputs.npz -o simulated.npz");
  command->add_option("MODEL", call->model, "Model: .npz, .h5 or .mat")->required()->type_name("");
  command
      ->add_option("INPUTS", call->inputs, "Ensemble with the inputs; its outputs are used by --estimate-state alone")
      ->required()
      ->type_name("");
  add_output_option(command, call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  command->add_flag("--estimate-state", call->estimate, "Unknown initial states by the outputs of the first steps");
  add_column_options(command, call->read);
  command->callback([call] { run(*call); });
}

}  // namespace tokid::app
