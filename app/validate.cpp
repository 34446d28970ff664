// tokid validate: how good is a model on data?
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "common.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, data;
  ReadOptions read;
  ValidateOptions options;
  bool json = false;
};

// One row per output; the horizon has a column of its own where it is not one step.
void add_table(const Call& call, const Model& model, const Validation& v, Vector Fit::*figure,
               std::string (*format)(double), Page& page) {
  std::vector<std::vector<std::string>> rows{{"output", "simulation", "one step"}};
  const Index horizon = call.options.horizon;
  if (horizon > 1) rows.front().push_back(plural(horizon, "step"));
  for (Index j = 0; j < model.outputs; ++j) {
    rows.push_back({output_label(model.names, j), format((v.simulation.*figure)(j)), format((v.one_step.*figure)(j))});
    if (horizon > 1) rows.back().push_back(format((v.horizon.*figure)(j)));
  }
  page.table(rows);
}

std::string report(const Call& call, const Model& model, const Ensemble& data, const Validation& v) {
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Data", call.data.string());
  page.row("", describe(data));
  page.row("Fit", fmt::format("predictions from step {} on", v.first_predicted));
  add_table(call, model, v, &Fit::fit, percent, page);
  page.row("RMS error", "");
  add_table(call, model, v, &Fit::rmse, number, page);
  page.row("Whiteness", std::isnan(v.whiteness_p)
                            ? "innovations at rounding level, or too few experiments to test them"
                            : fmt::format("p = {:.3g}: {}", v.whiteness_p,
                                          v.whiteness_p < 0.01 ? "the innovations are correlated in time"
                                                               : "no sign of correlation between innovations"));
  return page.text();
}

Json json(const Call& call, const Model& model, const Ensemble& data, const Validation& v) {
  Json j;
  j["model"] = call.model.string();
  j["data"] = call.data.string();
  j["experiments"] = data.experiments();
  j["steps"] = data.steps();
  j["output_names"] = Json::array();
  for (Index i = 0; i < model.outputs; ++i) j["output_names"].push_back(model.names.output(i));
  j["simulation_fit"] = numbers(v.simulation.fit);
  j["one_step_fit"] = numbers(v.one_step.fit);
  j["horizon"] = call.options.horizon;
  j["horizon_fit"] = numbers(v.horizon.fit);
  j["simulation_rmse"] = numbers(v.simulation.rmse);
  j["one_step_rmse"] = numbers(v.one_step.rmse);
  j["horizon_rmse"] = numbers(v.horizon.rmse);
  j["samples"] = {
      {"simulation", v.simulation.samples}, {"one_step", v.one_step.samples}, {"horizon", v.horizon.samples}};
  j["first_predicted"] = v.first_predicted;
  j["whiteness_p"] = v.whiteness_p;
  j["warnings"] = v.warnings;
  return j;
}

void run(const Call& call) {
  const Model model = load_model(call.model);
  const Ensemble data = load_ensemble(call.data, call.read);
  Validation result = about(call.data, [&] { return validate(model, data, call.options); });
  const std::vector<std::string> remarks = differences(model, data);
  result.warnings.insert(result.warnings.end(), remarks.begin(), remarks.end());
  if (call.json)
    print(json(call, model, data, result));
  else
    print(report(call, model, data, result));
  warn(result.warnings);
}

}  // namespace

void add_validate(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  CLI::App* command = add_command(tool, "validate", "Fit and whiteness of a model on data",
                                  "tokid validate model.npz fresh.npz --horizon 10");
  command->add_option("MODEL", call->model, "Model: .npz, .h5 or .mat")->required()->type_name("");
  command->add_option("DATA", call->data, "Ensemble: .npz, .h5, .mat or .csv")->required()->type_name("");
  add_column_options(command, call->read);
  add_horizon_option(command, call->options.horizon);
  command->add_flag("--json", call->json, "Print one JSON object");
  command->callback([call] { run(*call); });
}

}  // namespace tokid::app
