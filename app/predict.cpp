// tokid predict: outputs that the observer predicts from earlier outputs.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct PredictCall {
  fs::path model, data, output;
  ReadOptions read;
  PredictOptions options;
};

void run_predict(const PredictCall& call) {
  check_output(call.output, Content::ensemble, {call.model, call.data});
  const Model model = load_model(call.model);
  const Ensemble data = load_data(model, call.data, call.read);
  const Ensemble result = about(call.data, [&] { return predict(model, data, call.options).y; });
  save_ensemble(result, call.output);

  Page page;
  page.row("Model", describe(model));
  page.row("Predicted", fmt::format("{}, {}, {} ahead", plural(result.experiments(), "experiment"),
                                    plural(result.steps(), "step"), plural(call.options.horizon, "step")));
  page.row("", coverage(result));
  page.row("Written", call.output.string());
  print(page.text());
  warn(remarks(model, data));
  warn(prediction_remarks(model, data, result));
}

}  // namespace

void add_predict(CLI::App& tool) {
  const auto call = std::make_shared<PredictCall>();
  Command command(tool, "predict", "Predictions of a model with its observer in the loop",
                  "tokid predict model.npz data.npz -o predicted.npz --horizon 5");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.argument("DATA", call->data, "Ensemble: .npz, .h5, .mat or .csv");
  command.output(call->output, "Ensemble to write: .npz, .h5, .mat or .csv");
  command.columns(call->read);
  command.horizon(call->options.horizon);
  command.runs([call] { run_predict(*call); });
}

}  // namespace tokid::app
