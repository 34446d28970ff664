// tokid validate: tests how good a model is on data.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <map>

#include "base/words.hpp"
#include "command.hpp"
#include "common.hpp"
#include "report/validated.hpp"
#include "report/verdict_json.hpp"
#include "verdict.hpp"

namespace tokid::app {

namespace {

struct ValidateCall {
  std::vector<fs::path> paths;
  fs::path model, data;  // `data`: how reports name the paths
  ReadOptions read;
  ValidateOptions options;
  Index folds = 0;  // 0: no cross-validation
  bool json = false, verbose = false;
};

// One row for each output. The H-step fit has a column if the horizon H is more than one step.
void add_table(const ValidateCall& call, const Model& model, const Validation& v, Vector Fit::*figure,
               std::string (*format)(double), const std::string& heading, Page& page) {
  std::vector<std::vector<std::string>> rows{{"output", "simulation", "one step"}};
  const Index horizon = call.options.horizon;
  if (horizon > 1) rows.front().push_back(plural(horizon, "step"));
  for (Index j = 0; j < model.outputs; ++j) {
    rows.push_back({output_label(model.names, j), format((v.simulation.*figure)(j)), format((v.one_step.*figure)(j))});
    if (horizon > 1) rows.back().push_back(format((v.horizon.*figure)(j)));
  }
  page.table(heading, rows);
}

// Fits of models with different nominal values are not comparable, so the reference is stated.
void add_reference_of_fit(const Model& model, Page& page) {
  if (model.y_nominal.rows() == 0) return;
  const bool constant = (model.y_nominal.rowwise() - model.y_nominal.row(0)).isZero(0);
  page.row("", constant ? "0 % is as good as the constant nominal outputs of the model"
                        : "0 % is as good as the nominal trajectory of the model");
}

// "4 in all folds", "4 in 3 folds, 5 in 2"
std::string counts(const CrossValidation& cross, Index Fold::*number) {
  std::map<Index, int> folds;
  for (const Fold& fold : cross.folds) ++folds[fold.*number];
  if (folds.size() == 1) return fmt::format("{} in all folds", folds.begin()->first);
  std::string text;
  for (const auto& [value, count] : folds)
    text += fmt::format("{}{} in {}", text.empty() ? "" : ", ", value,
                        text.empty() ? plural(count, "fold") : std::to_string(count));
  return text;
}

std::string with_spread(double fit, double spread) {
  if (std::isnan(fit)) return "-";
  std::string text = percent(fit);
  return std::isnan(spread) ? text : text.insert(text.rfind(" %"), " ± " + words::figure(spread, 2));
}

void add_cross_validation(const ValidateCall& call, const Model& model, const CrossValidation& cross, Page& page) {
  page.row("Folds", fmt::format("K = {}, n = {}; p = {}", cross.folds.size(), counts(cross, &Fold::states),
                                counts(cross, &Fold::lags)));
  if (call.verbose) page.row("", "each tested with a model of the other experiments, identified with the same options");
  std::vector<std::vector<std::string>> rows{{"output", "simulation", "one step"}};
  const Index horizon = call.options.horizon;
  if (horizon > 1) rows.front().push_back(plural(horizon, "step"));
  for (Index j = 0; j < model.outputs; ++j) {
    rows.push_back({output_label(model.names, j), with_spread(cross.simulation.fit(j), cross.simulation_spread(j)),
                    with_spread(cross.one_step.fit(j), cross.one_step_spread(j))});
    if (horizon > 1) rows.back().push_back(with_spread(cross.horizon.fit(j), cross.horizon_spread(j)));
  }
  page.table(rows);
}

constexpr Index listed_experiments = 5;

// The worst experiments, with the output that has the largest part of the error.
void add_experiments(const Model& model, const Ensemble& data, const report::Validated& found, Page& page) {
  const ExperimentFits& fits = found.fits;
  if (fits.experiments() < 2) return;
  std::vector<std::vector<std::string>> rows{{"experiment", "output", "simulation", "one step", "error / limit"}};
  for (const Index n : fits.worst_first) {
    if (Index(rows.size()) > listed_experiments) break;
    if (!fits.worst_output[size_t(n)]) continue;
    const Index j = *fits.worst_output[size_t(n)];
    rows.push_back({data.experiment_label(found.rows[size_t(n)]), output_label(model.names, j),
                    percent(fits.simulation_fit(n, j)), percent(fits.one_step_fit(n, j)),
                    fmt::format("{:.2f}{}", fits.excess(n), fits.outlying(n) ? ", outlying" : "")});
  }
  if (rows.size() > 1) page.table("Worst", rows);
}

bool any_outlying(const ExperimentFits& fits) { return (fits.excess.array() > 1).any(); }

// The first steps of the fits and the RMS errors.
void add_errors(const ValidateCall& call, const Model& model, const Validation& v, Page& page) {
  page.row("Compared", v.first_simulated == v.first_predicted
                           ? fmt::format("from step {} on", v.first_predicted)
                           : fmt::format("simulations from step {} on, predictions from step {} on", v.first_simulated,
                                         v.first_predicted));
  add_table(call, model, v, &Fit::rmse, number, "RMS error", page);
}

// The tests of the innovations.
void add_tests(const Model& model, const Validation& v, Page& page) {
  const Conclusions found = conclusions(v, model.names);
  page.row("Innovations", in_words(found.nis));
  page.row("Whiteness", in_words(found.whiteness));
  page.row("Inputs", in_words(found.independence));
  page.row("Gains", in_words(found.gains));
  page.row("Feedback", in_words(found.feedback));
}

std::string report(const ValidateCall& call, const Model& model, const Ensemble& data, const report::Validated& found,
                   const std::optional<CrossValidation>& cross) {
  const Validation& v = found.validation;
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Data", call.data.string());
  page.row("", describe(data));
  add_table(call, model, v, &Fit::fit, percent, "Fit", page);
  add_reference_of_fit(model, page);
  if (call.verbose) add_errors(call, model, v, page);
  if (any_outlying(found.fits) || (call.verbose && v.noisy)) add_experiments(model, data, found, page);
  if (call.verbose) add_tests(model, v, page);
  if (cross) add_cross_validation(call, model, *cross, page);
  add_verdict(found.verdict, call.verbose, page);
  const NextStep next = next_step(found.verdict, v.findings, {call.model, call.paths, call.read, found.seen});
  page.command("Next", next.purpose, next.command);
  return page.text();
}

const char* name(Pooling over) {
  return over == Pooling::experiments ? "experiments" : over == Pooling::time ? "time" : "nothing";
}

Json json(const Fold& fold) {
  return {{"experiments", fold.experiments},
          {"experiment_names", fold.experiment_names.empty() ? Json() : Json(fold.experiment_names)},
          {"states", fold.states},
          {"lags", fold.lags},
          {"simulation_fit", numbers(fold.simulation.fit)},
          {"one_step_fit", numbers(fold.one_step.fit)},
          {"horizon_fit", numbers(fold.horizon.fit)},
          {"findings", json_of(fold.findings)},
          {"warnings", in_words(fold.findings)}};
}

Json json(const CrossValidation& cross) {
  Json j;
  j["folds"] = cross.folds.size();
  j["simulation_fit"] = numbers(cross.simulation.fit);
  j["one_step_fit"] = numbers(cross.one_step.fit);
  j["horizon_fit"] = numbers(cross.horizon.fit);
  j["simulation_fit_spread"] = numbers(cross.simulation_spread);
  j["one_step_fit_spread"] = numbers(cross.one_step_spread);
  j["horizon_fit_spread"] = numbers(cross.horizon_spread);
  j["simulation_rmse"] = numbers(cross.simulation.rmse);
  j["one_step_rmse"] = numbers(cross.one_step.rmse);
  j["horizon_rmse"] = numbers(cross.horizon.rmse);
  j["per_fold"] = Json::array();
  for (const Fold& fold : cross.folds) j["per_fold"].push_back(json(fold));
  return j;
}

Json counts(const ExperimentFits::Counts& samples, Index n) {
  Json list = Json::array();
  for (const Index count : samples.row(n)) list.push_back(count);
  return list;
}

Json json(const Ensemble& data, const report::Validated& found) {
  const ExperimentFits& fits = found.fits;
  Json list = Json::array();
  for (const Index n : fits.worst_first) {
    const Index row = found.rows[size_t(n)];
    list.push_back({{"experiment", row},
                    {"name", data.experiment_names.empty() ? Json() : Json(data.experiment_label(row))},
                    {"simulation_fit", numbers(fits.simulation_fit.row(n))},
                    {"one_step_fit", numbers(fits.one_step_fit.row(n))},
                    {"simulation_rmse", numbers(fits.simulation_rmse.row(n))},
                    {"one_step_rmse", numbers(fits.one_step_rmse.row(n))},
                    {"simulation_samples", counts(fits.simulation_samples, n)},
                    {"one_step_samples", counts(fits.one_step_samples, n)},
                    {"over_median", numbers(fits.over_median.row(n))},
                    {"simulation_error", fits.simulation_error(n)},
                    {"one_step_error", fits.one_step_error(n)},
                    {"excess", fits.excess(n)},
                    {"worst_output", fits.worst_output[size_t(n)] ? Json(*fits.worst_output[size_t(n)]) : Json()},
                    {"outlying", fits.outlying(n)}});
  }
  return list;
}

Json json(const ValidateCall& call, const Model& model, const Ensemble& data, const report::Validated& validated,
          const std::optional<CrossValidation>& cross) {
  const Validation& v = validated.validation;
  Json j;
  j["model"] = call.model.string();
  j["data"] = json_of(call.paths);
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
  j["first_simulated"] = v.first_simulated;
  j["experiment_limits"] = {{"simulation", validated.fits.simulation_limit},
                            {"one_step", validated.fits.one_step_limit}};
  j["worst_experiments_first"] = json(data, validated);
  j["nis"] = v.squares.ratio;
  j["nis_p"] = v.squares.p;
  j["nis_presumes_normal"] = std::isnan(v.squares.p) ? Json() : Json(v.squares.normal);
  j["whiteness_p"] = v.whiteness_p;
  j["independence_p"] = v.independence.p;
  j["feedback_p"] = v.feedback.p;
  j["tested_over"] = name(v.whiteness.over);
  j["gain_errors"] = numbers(v.gains.error);
  j["gain_deviations"] = numbers(v.gains.deviation);
  j["outlying_samples"] = json_of(v.outlying);
  const Conclusions found = conclusions(v, model.names);
  j["conclusions"] = json_of(found);
  j["verdict"] = with_checks(validated.verdict);
  j["cross_validation"] = cross ? json(*cross) : Json();
  add_findings(j, v.findings);
  return j;
}

CrossValidation cross_validation(const ValidateCall& call, const Model& model, const Ensemble& data) {
  IdentifyOptions identify = about(call.model, [&] { return identify_options(model.provenance); });
  CrossValidateOptions options;
  options.folds = call.folds;
  options.horizon = call.options.horizon;
  options.first_step = call.options.first_step;
  ProgressBar bar(true);
  identify.execution.progress = bar.callback();
  return about(call.data, [&] { return cross_validate(data, identify, options); });
}

void run_validate(const ValidateCall& call) {
  const Model model = load_model(call.model);
  const Ensemble data = load_data(model, call.paths, call.read);
  ReportOptions options;
  options.horizon = std::max(options.horizon, call.options.horizon);
  options.first_step = call.options.first_step;
  report::Validated result =
      about(call.data, [&] { return report::validated(model, data, call.options.horizon, options); });
  Findings findings = remarks(model, data);
  append(findings, std::move(result.validation.findings));
  append(findings, differences(model, data));
  std::optional<CrossValidation> cross;
  if (call.folds > 0) {
    cross = cross_validation(call, model, data);
    append(findings, tokid::remarks(*cross));
  }
  result.validation.findings = std::move(findings);
  if (call.json)
    print(json(call, model, data, result, cross));
  else
    print(report(call, model, data, result, cross));
  warn(result.validation.findings);
}

}  // namespace

void add_validate(CLI::App& tool) {
  const auto call = std::make_shared<ValidateCall>();
  Command command(tool, "validate", "Test a model on data: fits, and tests of its innovations",
                  "tokid validate model.npz fresh.npz --horizon 10");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.data("DATA", call->paths, call->data,
               "Ensemble: .npz, .h5, .mat or .csv; or many .csv: files, a folder, a pattern");
  command.columns(call->read);
  command.horizon(call->options.horizon);
  command.number<Index>("--from", call->options.first_step, "STEP",
                        "First step of the fits, to compare models that begin at different steps", 0, 1'000'000'000);
  command.number<Index>(
      "--cross-validate", call->folds, "K",
      "Also cross-validate with the options of the model: identify from all but one of K parts of DATA at a time, "
      "and test on the held-out part",
      2, 1'000'000);
  command.verbose(call->verbose);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_validate(*call); });
}

}  // namespace tokid::app
