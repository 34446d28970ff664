// tokid predict: outputs with the observer in the loop.
// SPDX-License-Identifier: BSD-3-Clause
#include "common.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, data, output;
  ReadOptions read;
  PredictOptions options;
};

void run(const Call& call) {
  check_output(call.output, Content::ensemble, {call.model, call.data});
  const Model model = load_model(call.model);
  const Ensemble data = load_ensemble(call.data, call.read);
  const Ensemble result = about(call.data, [&] { return predict(model, data, call.options).y; });
  save_ensemble(result, call.output);

  Page page;
  page.row("Model", describe(model));
  page.row("Predicted", fmt::format("{}, {}, {} ahead", plural(result.experiments(), "experiment"),
                                    plural(result.steps(), "step"), plural(call.options.horizon, "step")));
  page.row("", coverage(result));
  page.row("Written", call.output.string());
  print(page.text());
  warn(prediction_remarks(model, data, result));
}

}  // namespace

void add_predict(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  CLI::App* command = add_command(tool, "predict", "Predictions of a model with its observer in the loop",
                                  "tokid predict model.npz data.npz -o predicted.npz --horizon 5");
  command->add_option("MODEL", call->model, "Model: .npz, .h5 or .mat")->required()->type_name("");
  command->add_option("DATA", call->data, "Ensemble: .npz, .h5, .mat or .csv")->required()->type_name("");
  add_output_option(command, call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  add_column_options(command, call->read);
  add_horizon_option(command, call->options.horizon);
  command->callback([call] { run(*call); });
}

}  // namespace tokid::app
