// tokid refine: a model and data → the maximum-likelihood model.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "command.hpp"
#include "common.hpp"
#include "verdict.hpp"

namespace tokid::app {

namespace {

struct RefineCall {
  fs::path model, data, output;
  ReadOptions read;
  RefineModelOptions options;
  Index period = 0;  // 0: period of the model
  bool json = false, verbose = false;
};

void add_choice_table(const LikelihoodChoice& choice, Page& page) {
  if (choice.smoothing.empty()) return;
  std::vector<std::vector<std::string>> rows{{"smoothing", "log-likelihood", "error"}};
  for (size_t i = 0; i < choice.smoothing.size(); ++i)
    rows.push_back({penalty(choice.smoothing[i]), number(choice.log_likelihood[i]), number(choice.error[i]),
                    choice.smoothing[i] == choice.best ? "chosen" : ""});
  rows.front().emplace_back("");
  page.table(rows);
}

NextStep command_after(const RefineCall& call, const Refinement& result) {
  if (result.converged) return test_on_other_data(call.output, {call.data}, call.read);
  const std::string output = word(call.output.string());
  return {"continue from here",
          fmt::format("tokid refine {} {} -o {}{} --iterations {}", output, word(call.data.string()), output,
                      words_of(call.read), 2 * result.iterations)};
}

std::string report(const RefineCall& call, const Model& model, const Ensemble& data, const RefinedModel& outcome) {
  const Refinement& result = outcome.refinement;
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Data", call.data.string());
  page.row("", describe(data));
  if (call.verbose) page.row("Initial state", to_string(result.model.initial_state));
  if (call.verbose) page.row("Feedthrough", in_words(feedthrough_choice(result.model.provenance)));
  page.row("Smoothing", fmt::format("lambda = {}, {}", penalty(outcome.smoothing), outcome.reason));
  if (call.verbose) add_choice_table(outcome.choice, page);
  page.row("Likelihood", fmt::format("log-likelihood {} at the start, {} after {}{}",
                                     number(result.start_log_likelihood), number(result.log_likelihood.back()),
                                     plural(result.iterations, "iteration"), result.converged ? ", converged" : ""));
  if (result.noise_segments > 1)
    page.row("Noise", fmt::format("its size varies over time: {}, each with its own size",
                                  plural(result.noise_segments, "segment")));
  std::vector<std::vector<std::string>> rows{{"on the same data", "simulation", "refined", "one step", "refined"}};
  for (Index j = 0; j < model.outputs; ++j)
    rows.push_back({output_label(model.names, j), percent(outcome.before.simulation.fit(j)),
                    percent(outcome.after.simulation.fit(j)), percent(outcome.before.one_step.fit(j)),
                    percent(outcome.after.one_step.fit(j))});
  page.table("Fit", rows);
  page.row("Written", call.output.string());
  const NextStep next = command_after(call, result);
  page.command("Next", next.purpose, next.command);
  return page.text();
}

Json fit_json(const RefinementFigures& f) {
  return {{"simulation_fit", numbers(f.simulation.fit)},
          {"one_step_fit", numbers(f.one_step.fit)},
          {"whiteness_p", f.whiteness_p}};
}

Json json(const RefineCall& call, const Ensemble& data, const RefinedModel& outcome) {
  const Refinement& result = outcome.refinement;
  Json j;
  j["model"] = call.model.string();
  j["data"] = call.data.string();
  j["refined"] = call.output.string();
  j["experiments"] = data.experiments();
  j["steps"] = data.steps();
  j["states"] = result.model.states();
  j["initial_state"] = to_string(result.model.initial_state);
  j["feedthrough"] = has_feedthrough(result.model.provenance);
  j["smoothing"] = json_penalty(outcome.smoothing);
  j["smoothing_choice"] = nullptr;
  if (!outcome.choice.smoothing.empty()) {
    Json candidates = Json::array();
    for (const double value : outcome.choice.smoothing) candidates.push_back(json_penalty(value));
    j["smoothing_choice"] = {
        {"candidates", candidates}, {"log_likelihood", outcome.choice.log_likelihood}, {"error", outcome.choice.error}};
  }
  j["start_log_likelihood"] = result.start_log_likelihood;
  j["log_likelihood"] = result.log_likelihood;
  j["penalised_log_likelihood"] = result.penalised;
  j["iterations"] = result.iterations;
  j["converged"] = result.converged;
  j["noise_segments"] = result.noise_segments;
  j["before"] = fit_json(outcome.before);
  j["after"] = fit_json(outcome.after);
  add_findings(j, outcome.findings);
  j["version"] = version;
  return j;
}

void run_refine(const RefineCall& call) {
  check_output(call.output, Content::model, {call.data});
  std::optional<HeldFile> held;  // needed if the output replaces the model
  if (same_file(call.model, call.output)) held.emplace(call.output);
  const Model model = load_model(call.model);
  const Ensemble data = load_data(model, call.data, call.read);
  RefinedModel outcome = about(call.data, [&] {
    ProgressBar bar(true);
    RefineModelOptions options = call.options;
    options.refine.execution.progress = bar.callback();
    return refine_model(model, data, options);
  });
  Findings findings = remarks(model, data);
  append(findings, std::move(outcome.findings));
  outcome.findings = std::move(findings);
  if (held) held->check();
  save_model(outcome.refinement.model, call.output);
  if (call.json)
    print(json(call, data, outcome));
  else
    print(report(call, model, data, outcome));
  warn(outcome.findings);
}

// False: the text is no penalty. "auto" empties the target.
bool set_smoothing(std::optional<double>& target, const std::string& text) {
  target = text == "infinity" ? std::numeric_limits<double>::infinity() : parse_number(text, 0.0, 1e12);
  return target || text == "auto";
}

}  // namespace

void add_refine(CLI::App& tool) {
  const auto call = std::make_shared<RefineCall>();
  RefineOptions& o = call->options.refine;
  Command command(tool, "refine", "Refine a model by EM (maximum likelihood)",
                  "tokid refine model.npz data.npz -o refined.npz");
  command.argument("MODEL", call->model, "Model to start from: .npz, .h5 or .mat");
  command.argument("DATA", call->data, "Ensemble: .npz, .h5, .mat or .csv");
  command.output(call->output, "Model to write: .npz, .h5 or .mat");
  command.columns(call->read);
  command.text(
      "--smoothing", "LAMBDA|auto",
      "Penalty lambda on variation over time (auto: that of the identification of the model, else by cross-validation)",
      [call](const std::string& text) { return set_smoothing(call->options.smoothing, text); },
      "a number from 0 to 1e12, infinity or auto needed");
  command.number<Index>("--period", call->period, "P", "Steps k and k+P share their matrices (1: all steps share them)",
                        1, 1'000'000'000);
  command.flag(
      "--feedthrough", [call] { call->options.feedthrough = true; },
      "Estimate D, also if the model was identified without it");
  command.flag(
      "--no-feedthrough", [call] { call->options.feedthrough = false; },
      "D is 0: outputs do not respond to the inputs of the same step");
  command.excludes("--no-feedthrough", "--feedthrough");
  command.number<Index>("--iterations", o.iterations, "N", "Largest number of iterations (default 60)", 1, 1'000'000);
  command.choice("--initial-state", o.initial_state,
                 Choices<std::optional<InitialState>>{
                     {"auto", std::nullopt}, {"zero", InitialState::zero}, {"unknown", InitialState::unknown}},
                 "States at step 0 (auto: as the data state, else as in the identification of the model)");
  command.threads(o.execution.threads);
  command.verbose(call->verbose);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] {
    if (call->period > 0) call->options.refine.period = call->period;
    run_refine(*call);
  });
}

}  // namespace tokid::app
