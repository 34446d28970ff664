// tokid export: a model → C99 source of its observer, and of a controller.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"
#include "tokid/controller_file.hpp"
#include "tokid/deploy.hpp"

namespace tokid::app {

namespace {

struct ExportCall {
  fs::path model, output, controller;
  DeployOptions options;
  bool json = false;
};

std::string report(const ExportCall& call, const Model& model, const DeployedCode& code) {
  Page page;
  page.row("Model", describe(model));
  page.row("Precision", call.options.single_precision ? "float" : "double");
  page.row("Tables", fmt::format("{} bytes, {}", code.table_bytes, plural(code.stored_steps, "different step")));
  page.row("State", fmt::format("{} bytes", code.state_bytes));
  page.row("Each step", in_words(code.step));
  if (code.step_missing.divisions > 0)
    page.row("", fmt::format("{} if outputs are missing", in_words(code.step_missing)));
  if (!call.controller.empty()) page.row("Controller", in_words(code.control));
  page.row("Functions", fmt::format("{0}_init, {0}_step{1}", code.name,
                                    call.controller.empty() ? "" : fmt::format(", {}_control", code.name)));
  page.row("Written", fmt::format("{}, {}", call.output.string(), deployed_header(call.output).string()));
  return page.text();
}

Json counts(const Operations& count) {
  return {{"multiplications", count.multiplications}, {"additions", count.additions}, {"divisions", count.divisions}};
}

Json json(const ExportCall& call, const DeployedCode& code) {
  Json j;
  j["model"] = call.model.string();
  j["controller"] = call.controller.empty() ? Json() : Json(call.controller.string());
  j["source"] = call.output.string();
  j["header"] = deployed_header(call.output).string();
  j["name"] = code.name;
  j["precision"] = call.options.single_precision ? "float" : "double";
  j["table_bytes"] = code.table_bytes;
  j["state_bytes"] = code.state_bytes;
  j["stored_steps"] = code.stored_steps;
  j["operations"] = counts(code.step);
  j["operations_missing"] = counts(code.step_missing);
  j["operations_control"] = call.controller.empty() ? Json() : counts(code.control);
  j["version"] = version;
  return j;
}

void run_export(const ExportCall& call) {
  for (const fs::path& file : {call.output, deployed_header(call.output)})
    check_output(file, Content::code, {call.model, call.controller});
  const Model model = load_model(call.model);
  std::optional<Controller> controller;
  if (!call.controller.empty()) controller = load_controller(call.controller);
  const DeployedCode code = save_deployed(model, call.output, call.options, controller ? &*controller : nullptr);
  if (call.json)
    print(json(call, code));
  else
    print(report(call, model, code));
}

}  // namespace

void add_export(CLI::App& tool) {
  const auto call = std::make_shared<ExportCall>();
  Command command(tool, "export", "The observer of a model, and a controller, as C99 source",
                  "tokid export model.npz --controller controller.h5 --float -o observer.c");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.output(call->output, "Source to write: .c. Its header, .h, is written beside it");
  command.file("--controller", call->controller, "Controller of the model, written by tokid lqr");
  command.flag("--float", call->options.single_precision, "Numbers of type float (default double)");
  command.name("--name", call->options.name, "NAME", "Beginning of all names in C (default that of the file)");
  command.flag("--start-from-zero", call->options.start_from_zero,
               "Start from the zero state if the initial state is unknown");
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_export(*call); });
}

}  // namespace tokid::app
