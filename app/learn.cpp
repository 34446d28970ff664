// tokid learn: a model, a reference and the last run → the inputs of the next run.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"
#include "tokid/learning.hpp"
#include "weights.hpp"

namespace tokid::app {

namespace {

struct LearnCall {
  fs::path model, run, reference, output;
  ReadOptions read;
  Index experiment = -1;  // row of the last run; -1: the last row
  Weights errors = {1.0}, inputs, changes, rates;
  bool json = false;
};

LearningWeights weights_of(const LearnCall& call, const Model& model) {
  if (call.inputs.empty() && call.changes.empty() && call.rates.empty())
    throw std::invalid_argument(
        "no weight on inputs found; --input-weight, --input-change-weight or --input-rate-weight needed");
  LearningWeights result;
  const auto set = [](std::vector<Matrix>& target, const char* option, const Weights& weights, Index channels) {
    if (!weights.empty()) target = {diagonal(option, weights, channels)};
  };
  set(result.error, "--error-weight", call.errors, model.outputs);
  set(result.input, "--input-weight", call.inputs, model.inputs);
  set(result.input_change, "--input-change-weight", call.changes, model.inputs);
  set(result.input_rate, "--input-rate-weight", call.rates, model.inputs);
  return result;
}

Ensemble reference_of(const Model& model, const LearnCall& call, const Ensemble& last) {
  Ensemble wanted = load_reference(model, call.reference, call.read);
  if (wanted.steps() != last.steps())
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed as in {}", call.reference.string(),
                                            plural(wanted.steps(), "step"), last.steps(), call.run.string()));
  return wanted;
}

Index row_of(const LearnCall& call, const Ensemble& runs) {
  if (call.experiment >= runs.experiments())
    throw std::invalid_argument(fmt::format("{}: --experiment {} found, 0 to {} needed", call.run.string(),
                                            call.experiment, runs.experiments() - 1));
  return call.experiment < 0 ? runs.experiments() - 1 : call.experiment;
}

// The next run with its predicted outputs, as long as the last one.
Ensemble next_run(const Ensemble& last, const LearnedRun& learned) {
  Ensemble next(1, learned.u.rows(), last.inputs(), last.outputs(), last.dt);
  next.dt_stated = last.dt_stated;
  next.names = last.names;
  next.initial_state = last.initial_state;
  for (Index k = 0; k < next.steps(); ++k) {
    next.input(k) = learned.u.row(k);
    next.output(k) = learned.predicted.row(k);
  }
  return next;
}

std::string report(const LearnCall& call, const Model& model, const Ensemble& last, const LearnedRun& learned) {
  Page page;
  page.row("Model", describe(model));
  page.row("Last run", fmt::format("{}, experiment {}", call.run.string(), last.experiment_label(0)));
  std::vector<std::vector<std::string>> rows{{"RMS error", "last run", "next run, predicted"}};
  for (Index j = 0; j < model.outputs; ++j)
    rows.push_back({output_label(model.names, j), number(learned.error(j)), number(learned.predicted_error(j))});
  page.table(rows);
  page.row("Written", call.output.string());
  return page.text();
}

Json json(const LearnCall& call, Index row, const LearnedRun& learned, const Findings& findings) {
  Json j;
  j["model"] = call.model.string();
  j["run"] = call.run.string();
  j["experiment"] = row;
  j["reference"] = call.reference.string();
  j["next"] = call.output.string();
  j["error"] = numbers(learned.error);
  j["predicted_error"] = numbers(learned.predicted_error);
  add_findings(j, findings);
  j["version"] = version;
  return j;
}

void run_learn(const LearnCall& call) {
  check_output(call.output, Content::ensemble, {call.model, call.run, call.reference});
  const Model model = load_model(call.model);
  const LearningWeights weights = weights_of(call, model);
  const Ensemble runs = load_data(model, call.run, call.read);
  const Index row = row_of(call, runs);
  const Ensemble last = runs.subset({row});
  const Ensemble wanted = reference_of(model, call, last);
  const Index steps = last.length.empty() ? last.steps() : last.length[0];  // a run may have stopped early
  const LearnedRun learned =
      about({{"model", call.model}, {"reference", call.reference}, {"u", call.run}, {"y", call.run}}, [&] {
        return learn(model, wanted.outputs_of(0).topRows(steps), last.inputs_of(0).topRows(steps),
                     last.outputs_of(0).topRows(steps), weights);
      });
  save_ensemble(next_run(last, learned), call.output);
  Findings findings = differences(model, runs);
  append(findings, differences(model, wanted));
  append(findings, findings_of_end(model, last));
  if (call.json)
    print(json(call, row, learned, findings));
  else
    print(report(call, model, last, learned));
  warn(findings);
}

}  // namespace

void add_learn(CLI::App& tool) {
  const auto call = std::make_shared<LearnCall>();
  Command command(tool, "learn", "Compute the inputs of the next run from a reference and the last run",
                  "tokid learn model.npz run.csv wanted.csv --input-change-weight 0.01 -o next.csv");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.argument("RUN", call->run, "The last run, an ensemble: .npz, .h5, .mat or .csv");
  command.argument(
      "REFERENCE", call->reference,
      "Ensemble of one experiment with the wanted outputs; missing samples are free, and its inputs do not matter");
  command.output(call->output, "Ensemble to write: the next run with its predicted outputs");
  command.number<Index>("--experiment", call->experiment, "ROW",
                        "Row of the last run in RUN, if RUN has several experiments (default the last row)", 0);
  add_weights(command, "--error-weight", call->errors,
              "Weights of squared errors, one for all outputs, or one for each (default 1)");
  add_weights(command, "--input-weight", call->inputs,
              "Weights of squared inputs, as departures from the nominal trajectory (default none)");
  add_weights(command, "--input-change-weight", call->changes,
              "Weights of squared changes of the inputs from the last run (default none)");
  add_weights(command, "--input-rate-weight", call->rates,
              "Weights of squared changes of the inputs from step to step (default none)");
  command.columns(call->read);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_learn(*call); });
}

}  // namespace tokid::app
