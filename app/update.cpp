// tokid update: adds later experiments to the state of an identification.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <numeric>

#include "command.hpp"
#include "common.hpp"
#include "tool.hpp"

namespace tokid::app {

namespace {

struct UpdateCall {
  fs::path state, model;
  std::vector<fs::path> data;
  UpdateOptions options;
  double wait = LockOptions().limit;
  bool json = false, quiet = false;
};

struct Result {
  Additions added;
  Index steps = 0, new_experiments = 0;
  double dt = 1.0;
  Updated now;
};

std::string report(const UpdateCall& call, const Result& result) {
  const Model& model = result.now.model;
  Page page;
  for (size_t i = 0; i < call.data.size(); ++i) {
    const std::string file = call.data[i].string();
    page.row(
        i == 0 ? "New data" : "",
        call.data.size() == 1 ? file : fmt::format("{}: {}", file, plural(result.added.experiments[i], "experiment")));
  }
  page.row("", describe(result.new_experiments, result.steps, model.inputs, model.outputs, result.dt));
  page.row("Experiments", fmt::format("{}, {} of them new", result.now.experiments, result.new_experiments));
  if (result.new_experiments > 0) {
    page.row("Fit", "of the previous model on the new experiments, which it was not identified from");
    std::vector<std::vector<std::string>> rows{{"output", "simulation", "one step"}};
    for (Index j = 0; j < model.outputs; ++j)
      rows.push_back({output_label(model.names, j), percent(result.added.simulation.fit(j)),
                      percent(result.added.one_step.fit(j))});
    page.table(rows);
  }
  page.row("Model", describe(model));
  page.row("Written", call.state.string());
  if (!call.model.empty()) page.row("", call.model.string());
  return page.text();
}

Json json(const UpdateCall& call, const Result& result) {
  const Updated& now = result.now;
  Json j;
  j["state"] = call.state.string();
  j["data"] = call.data.front().string();
  if (call.data.size() > 1) {
    j["data"] = Json::array();
    for (const fs::path& file : call.data) j["data"].push_back(file.string());
  }
  j["model"] = call.model.empty() ? Json() : Json(call.model.string());
  j["experiments"] = now.experiments;
  j["new_experiments"] = result.new_experiments;
  j["known_experiments"] = result.added.known;
  j["steps"] = result.steps;
  j["inputs"] = now.model.inputs;
  j["outputs"] = now.model.outputs;
  j["method"] = now.model.method;
  j["states"] = now.model.states();
  j["initial_state"] = to_string(now.model.initial_state);
  j["k_begin"] = now.model.k_begin;
  j["condition_max"] = now.condition_max > 0 ? Json(now.condition_max) : Json();
  j["rank_deficient_steps"] = now.condition_max > 0 ? Json(now.rank_deficient_steps) : Json();
  j["evaluated_on"] = "new";
  j["one_step_fit"] = numbers(result.added.one_step.fit);
  j["simulation_fit"] = numbers(result.added.simulation.fit);
  add_findings(j, now.findings);
  j["version"] = version;
  return j;
}

void run_first(const UpdateCall& call) {
  check_output(call.state, Content::state, call.data);
  if (!call.model.empty()) {
    std::vector<fs::path> kept = call.data;
    kept.push_back(call.state);
    check_output(call.model, Content::model, kept);
  }
  for (const fs::path& file : call.data) file_kind(file);  // throws before the work if the file does not exist
  // The lock lasts until the end. Otherwise another process could update the state meanwhile, and this update would be
  // lost.
  HeldFile held(call.state, call.wait);
  UpdateState state = load_update_state(call.state);
  const Execution& execution = call.options.execution;
  const Updated then = about(call.state, [&] { return identify(state, execution); });
  Result result;
  result.added = update(state, then.model, call.data, call.options);
  result.new_experiments = std::accumulate(result.added.experiments.begin(), result.added.experiments.end(), Index{0});
  result.steps = state.factors.steps();
  result.dt = state.factors.dt;
  result.now = identify(state, execution);
  result.now.findings.insert(result.now.findings.begin(), result.added.findings.begin(), result.added.findings.end());
  // The state is saved last. If this fails, the old state remains, and the same command can be repeated.
  FilesTogether files;
  if (!call.model.empty()) save_model(result.now.model, call.model);
  save_update_state(state, held);
  files.commit();
  if (call.json)
    print(json(call, result));
  else if (!call.quiet)
    print(report(call, result));
  warn(result.now.findings);
}

void run_update(UpdateCall call) {
  call.options.team = team();
  if (team().rank == 0) return run_first(call);
  UpdateState none;
  update(none, {}, call.data, call.options);
}

}  // namespace

void add_update(CLI::App& tool) {
  const auto call = std::make_shared<UpdateCall>();
  Command command(tool, "update", "Add later experiments to a state file, and identify the model of all experiments",
                  "tokid update state.h5 tuesday.npz wednesday.npz -o model.npz");
  command.argument("STATE", call->state, "State file of identify --state, to which the new experiments are added");
  command.argument("NEWDATA", call->data, "Ensembles of the new experiments: .npz, .h5, .mat or .csv");
  command.file("-o,--output", call->model, "Model of all experiments to write: .npz, .h5 or .mat");
  command.columns(call->options.read);
  command.number("--wait", call->wait, "SECONDS", "Longest wait while another update uses the state file (default 60)",
                 0.0);
  command.threads(call->options.execution.threads);
  command.flag("--json", call->json, "Print one JSON object");
  command.flag("--quiet", call->quiet, "Print warnings and errors only");
  command.runs([call] { run_update(*call); });
}

}  // namespace tokid::app
