// tokid refine: a model and data → the maximum-likelihood model.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "common.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, data, output;
  ReadOptions read;
  RefineOptions options;
  std::optional<double> smoothing;  // empty: auto
  Index period = 0;                 // 0: that of the model
  bool json = false;
};

// Of the folds that choose the smoothing, where the model does not tell it.
constexpr Index folds = 3;

// Of one model.
struct Figures {
  Fit simulation, one_step;
  double whiteness_p = 0.0;
};

struct Outcome {
  double smoothing = 0.0;
  std::string reason;
  LikelihoodChoice choice;  // filled where λ was chosen
  Refinement refinement;
  Figures before, after;
};

// The one model starts all folds: it has seen the experiments that are left out, but the climb from it has not.
void choose(const Call& call, const Model& model, const Ensemble& data, Outcome& outcome) {
  if (!call.smoothing && call.options.period.value_or(model.period) == 1) {
    outcome.reason = "one model serving all steps";
  } else if (call.smoothing) {
    outcome.smoothing = *call.smoothing;
    outcome.reason = "as asked";
  } else if (const std::optional<double> known = refinement_smoothing(model)) {
    outcome.smoothing = *known;
    outcome.reason = "as the model was identified";
  } else if (data.experiments() < 2 * folds) {
    outcome.smoothing = 1.0;
    outcome.reason = "too few experiments to choose it by";
  } else {
    RefineOptions options = call.options;
    options.iterations = std::min<Index>(options.iterations, 20);
    outcome.choice = choose_smoothing(std::vector<Model>(size_t(folds), model), data, options);
    outcome.smoothing = outcome.choice.best;
    outcome.reason = fmt::format("by the likelihood of experiments left out, {} folds", folds);
  }
}

// Both models on the samples that both can compute.
void compare(const Model& model, const Ensemble& data, std::optional<InitialState> initial, Outcome& outcome) {
  const Model& refined = outcome.refinement.model;
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const auto fits = [&](Ensemble own, Ensemble other, Fit Figures::*target) {
    for (Index k = 0; k < data.steps(); ++k) {
      const auto neither = (own.output(k).array().isNaN() || other.output(k).array().isNaN()).eval();
      own.output(k) = neither.select(nan, own.output(k)).eval();
      other.output(k) = neither.select(nan, other.output(k)).eval();
    }
    outcome.before.*target = fit(data, own, model.y_nominal);
    outcome.after.*target = fit(data, other, refined.y_nominal);
  };
  const PredictOptions one_step{1, initial};
  fits(predict(model, data, one_step).y, predict(refined, data, one_step).y, &Figures::one_step);
  fits(simulate_data(model, data, initial), simulate_data(refined, data, initial), &Figures::simulation);
  ValidateOptions validation;
  validation.initial_state = initial;
  outcome.before.whiteness_p = validate(model, data, validation).whiteness_p;
  outcome.after.whiteness_p = validate(refined, data, validation).whiteness_p;
}

Outcome outcome_of(const Call& call, const Model& model, const Ensemble& data) {
  Outcome outcome;
  ProgressBar bar(true);
  const auto share = [progress = bar.callback()](double from, double to) {
    return progress ? Progress([=](double done) { progress(from + (to - from) * done); }) : Progress();
  };
  Call part = call;
  part.options.execution.progress = share(0.0, 0.5);
  choose(part, model, data, outcome);
  part.options.execution.progress = share(0.5, 1.0);
  part.options.smoothing = outcome.smoothing;
  outcome.refinement = refine(model, data, part.options);
  Model& refined = outcome.refinement.model;
  note_data(refined, fingerprint(data));
  note_refinement(refined, outcome.smoothing, outcome.refinement.iterations);
  refined.version = version;
  compare(model, data, call.options.initial_state, outcome);
  return outcome;
}

void add_choice_table(const LikelihoodChoice& choice, Page& page) {
  if (choice.smoothing.empty()) return;
  std::vector<std::vector<std::string>> rows{{"smoothing", "log-likelihood", "error"}};
  for (size_t i = 0; i < choice.smoothing.size(); ++i)
    rows.push_back({penalty(choice.smoothing[i]), number(choice.log_likelihood[i]), number(choice.error[i]),
                    choice.smoothing[i] == choice.best ? "chosen" : ""});
  rows.front().emplace_back("");
  page.table(rows);
}

std::string report(const Call& call, const Model& model, const Ensemble& data, const Outcome& outcome) {
  const Refinement& result = outcome.refinement;
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Data", call.data.string());
  page.row("", describe(data));
  page.row("Initial state", to_string(result.model.initial_state));
  page.row("Smoothing", fmt::format("{}, {}", penalty(outcome.smoothing), outcome.reason));
  add_choice_table(outcome.choice, page);
  page.row("Likelihood", fmt::format("log-likelihood {} at the start, {} after {}{}",
                                     number(result.start_log_likelihood), number(result.log_likelihood.back()),
                                     plural(result.iterations, "iteration"), result.converged ? ", converged" : ""));
  if (result.noise_segments > 1)
    page.row("Noise", fmt::format("its size varies: {} have one each", plural(result.noise_segments, "segment")));
  page.row("Fit", "on the same data, before and after, where both models have outputs");
  std::vector<std::vector<std::string>> rows{{"output", "simulation", "refined", "one step", "refined"}};
  for (Index j = 0; j < model.outputs; ++j)
    rows.push_back({output_label(model.names, j), percent(outcome.before.simulation.fit(j)),
                    percent(outcome.after.simulation.fit(j)), percent(outcome.before.one_step.fit(j)),
                    percent(outcome.after.one_step.fit(j))});
  page.table(rows);
  page.row("Written", call.output.string());
  return page.text();
}

Json fit_json(const Figures& f) {
  return {{"simulation_fit", numbers(f.simulation.fit)},
          {"one_step_fit", numbers(f.one_step.fit)},
          {"whiteness_p", f.whiteness_p}};
}

Json json(const Call& call, const Ensemble& data, const Outcome& outcome, const std::vector<std::string>& warnings) {
  const Refinement& result = outcome.refinement;
  Json j;
  j["model"] = call.model.string();
  j["data"] = call.data.string();
  j["refined"] = call.output.string();
  j["experiments"] = data.experiments();
  j["steps"] = data.steps();
  j["states"] = result.model.states();
  j["initial_state"] = to_string(result.model.initial_state);
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
  j["warnings"] = warnings;
  j["version"] = version;
  return j;
}

void run(const Call& call) {
  check_output(call.output, Content::model, {call.data});
  const Model model = load_model(call.model);
  const Ensemble data = load_ensemble(call.data, call.read);
  const Outcome outcome = about(call.data, [&] { return outcome_of(call, model, data); });
  save_model(outcome.refinement.model, call.output);
  std::vector<std::string> warnings = differences(model, data);
  warnings.insert(warnings.end(), outcome.refinement.warnings.begin(), outcome.refinement.warnings.end());
  if (call.json)
    print(json(call, data, outcome, warnings));
  else
    print(report(call, model, data, outcome));
  warn(warnings);
}

void add_smoothing_option(CLI::App* command, std::optional<double>& target) {
  const auto set = [&target](const std::string& text) {
    target.reset();
    if (text == "auto") return;
    target = text == "infinity" ? std::numeric_limits<double>::infinity() : parse_number(text, 0.0, 1e12);
    if (!target)
      throw CLI::ValidationError("--smoothing",
                                 fmt::format("'{}' found, a number from 0 on, infinity or auto needed", text));
  };
  command
      ->add_option_function<std::string>("--smoothing", set,
                                         "Penalty on variation over time (auto: as the model was identified, else by "
                                         "cross-validation)")
      ->type_name("LAMBDA|auto");
}

}  // namespace

void add_refine(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  RefineOptions& o = call->options;
  CLI::App* command = add_command(tool, "refine", "Maximum likelihood by EM, from a model on",
                                  "tokid refine model.npz data.npz -o refined.npz");
  command->add_option("MODEL", call->model, "Model to start from: .npz, .h5 or .mat")->required()->type_name("");
  command->add_option("DATA", call->data, "Ensemble: .npz, .h5, .mat or .csv")->required()->type_name("");
  add_output_option(command, call->output, "Model to write: .npz, .h5 or .mat");
  add_column_options(command, call->read);
  add_smoothing_option(command, call->smoothing);
  add_number<Index>(command, "--period", call->period, "P", "Steps k and k+P share their matrices, 1: all steps", 1,
                    1'000'000'000);
  add_number<Index>(command, "--iterations", o.iterations, "N", "At most so many iterations (default 60)", 1,
                    1'000'000);
  add_choice(command, "--initial-state", o.initial_state,
             Choices<std::optional<InitialState>>{
                 {"auto", std::nullopt}, {"zero", InitialState::zero}, {"unknown", InitialState::unknown}},
             "States at step 0 (auto: as the data say, else as the model was identified)");
  add_number(command, "--threads", o.execution.threads, "N", "Threads, 0 for all of the machine (default 1)", 0, 1024);
  command->add_flag("--json", call->json, "Print one JSON object");
  command->callback([call] {
    if (call->period > 0) call->options.period = call->period;
    run(*call);
  });
}

}  // namespace tokid::app
