// tokid simulate: outputs of a model for new inputs, from the zero state.
// SPDX-License-Identifier: BSD-3-Clause
#include "common.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, inputs, output;
  ReadOptions read{{}, {}, false};
};

void run(const Call& call) {
  check_output(call.output, Content::ensemble);
  const Model model = load_model(call.model);
  const Ensemble inputs = load_ensemble(call.inputs, call.read);
  const Ensemble result = about(call.inputs, [&] { return simulate(model, inputs); });
  save_ensemble(result, call.output);

  std::vector<std::string> warnings = differences(model, inputs);
  Page page;
  page.row("Model", describe(model));
  page.row("Simulated",
           fmt::format("{}, {}, from the zero state at step {}", plural(result.experiments(), "experiment"),
                       plural(result.steps(), "step"), model.k_begin));
  page.row("", coverage(result, warnings));
  page.row("Written", call.output.string());
  print(page.text());
  if (!starts_from_zero(model, inputs.initial_state.value_or(model.initial_state)))
    warnings.push_back(
        fmt::format("the initial states are unknown: simulated from the zero state at step {}, where the model begins",
                    model.k_begin));
  warn(warnings);
}

}  // namespace

void add_simulate(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  CLI::App* command = add_command(tool, "simulate", "Outputs of a model for new inputs",
                                  "tokid simulate model.npz inputs.npz -o simulated.npz");
  command->add_option("MODEL", call->model, "Model: .npz, .h5 or .mat")->required()->type_name("");
  command->add_option("INPUTS", call->inputs, "Ensemble with the inputs; its outputs are not used")
      ->required()
      ->type_name("");
  add_output_option(command, call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  add_column_options(command, call->read);
  command->callback([call] { run(*call); });
}

}  // namespace tokid::app
