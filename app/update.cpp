// tokid update: experiments that come later join those that a state was kept of.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path state, data, model;
  ReadOptions read;
  Execution execution;
  bool json = false, quiet = false;
};

// How well the model so far does on the experiments that it has not seen.
Validation judged(const Model& model, const Ensemble& fresh) {
  ValidateOptions options;
  options.initial_state = model.initial_state;
  return validate(model, fresh, options);
}

std::string report(const Call& call, const Ensemble& data, const Updated& now, const Validation& before) {
  Page page;
  page.row("New data", call.data.string());
  page.row("", describe(data));
  page.row("Experiments", fmt::format("{}, {} of them new", now.experiments, data.experiments()));
  page.row("Fit", "of the model so far on the new experiments, which it had not seen");
  std::vector<std::vector<std::string>> rows{{"output", "simulation", "one step"}};
  for (Index j = 0; j < now.model.outputs; ++j)
    rows.push_back(
        {output_label(now.model.names, j), percent(before.simulation.fit(j)), percent(before.one_step.fit(j))});
  page.table(rows);
  page.row("Model", describe(now.model));
  page.row("Written", call.state.string());
  if (!call.model.empty()) page.row("", call.model.string());
  return page.text();
}

Json json(const Call& call, const Ensemble& data, const Updated& now, const Validation& before) {
  Json j;
  j["state"] = call.state.string();
  j["data"] = call.data.string();
  j["model"] = call.model.empty() ? Json() : Json(call.model.string());
  j["experiments"] = now.experiments;
  j["new_experiments"] = data.experiments();
  j["steps"] = data.steps();
  j["inputs"] = now.model.inputs;
  j["outputs"] = now.model.outputs;
  j["method"] = now.model.method;
  j["states"] = now.model.states();
  j["initial_state"] = to_string(now.model.initial_state);
  j["k_begin"] = now.model.k_begin;
  j["condition_max"] = now.condition_max > 0 ? Json(now.condition_max) : Json();
  j["rank_deficient_steps"] = now.condition_max > 0 ? Json(now.rank_deficient_steps) : Json();
  j["evaluated_on"] = "new";
  j["one_step_fit"] = numbers(before.one_step.fit);
  j["simulation_fit"] = numbers(before.simulation.fit);
  j["warnings"] = now.warnings;
  j["version"] = version;
  return j;
}

void run(const Call& call) {
  check_output(call.state, Content::state, {call.data});
  if (!call.model.empty()) check_output(call.model, Content::model, {call.state, call.data});
  UpdateState state = load_update_state(call.state);
  const Ensemble data = load_ensemble(call.data, call.read);
  about(call.data, [&] { check_update(state, data); });
  const Updated then = about(call.state, [&] { return identify(state, call.execution); });
  const Validation before = about(call.data, [&] { return judged(then.model, data); });
  about(call.data, [&] { update(state, data, call.execution); });
  const Updated now = identify(state, call.execution);
  // The state comes last: where the model can't be written, the experiments can be added once more.
  if (!call.model.empty()) save_model(now.model, call.model);
  save_update_state(state, call.state);
  if (call.json)
    print(json(call, data, now, before));
  else if (!call.quiet)
    print(report(call, data, now, before));
  warn(now.warnings);
}

}  // namespace

void add_update(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  CLI::App* command = add_command(tool, "update", "Add experiments to those that identify --state has kept",
                                  "tokid update state.h5 later.npz -o model.npz");
  command->add_option("STATE", call->state, "State that identify --state has written; gets the new experiments")
      ->required()
      ->type_name("");
  command->add_option("NEWDATA", call->data, "Ensemble of the new experiments: .npz, .h5, .mat or .csv")
      ->required()
      ->type_name("");
  command->add_option("-o,--output", call->model, "Model of all experiments to write: .npz, .h5 or .mat")
      ->type_name("FILE");
  add_column_options(command, call->read);
  add_number(command, "--threads", call->execution.threads, "N", "Threads, 0 for all of the machine (default 1)", 0,
             1024);
  command->add_flag("--json", call->json, "Print one JSON object");
  command->add_flag("--quiet", call->quiet, "Print warnings and errors only");
  command->callback([call] { run(*call); });
}

}  // namespace tokid::app
