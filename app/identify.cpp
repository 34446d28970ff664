// tokid identify: ensemble → model, with the evidence for every choice.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "command.hpp"
#include "common.hpp"
#include "model/options.hpp"
#include "report/verdict_json.hpp"
#include "tool.hpp"
#include "verdict.hpp"

namespace tokid::app {

namespace {

constexpr Index automatic = 0, all_at_once = -1;  // for `block`

struct IdentifyCall {
  std::vector<fs::path> paths;
  fs::path data, model, page;  // `data`: how reports name the paths
  ReadOptions read;
  IdentifyOptions options;
  Index block = automatic;
  fs::path state;
  bool json = false, quiet = false, verbose = false;
};

// Facts about the data, from any source.
struct Data {
  Index experiments = 0, steps = 0, inputs = 0, outputs = 0, missing = 0, free_responses = 0;
  double dt = 1.0;
  bool says_initial_state = false;
  Index block = 0, blocks = 0, overlap = 0;  // steps of a block, number of blocks, extra steps; 0 without blocks
};

Data about_data(const Ensemble& e) {
  return {e.experiments(),    e.steps(),          e.inputs(), e.outputs(),
          missing_samples(e), e.free.experiments, e.dt,       e.initial_state.has_value()};
}

Data about_data(const EnsembleFile& file, const Streamed& streamed) {
  return {file.experiments(), file.steps(),          file.inputs(),   file.outputs(),
          streamed.missing,   file.free_responses(), file.dt(),       file.initial_state().has_value(),
          streamed.block,     streamed.blocks,       streamed.overlap};
}

// RMS errors relative to their reference, from the means of their logarithms.
std::vector<double> relative(const Vector& mean_log_square) {
  const Vector error = (mean_log_square.array() / 2).exp();
  return {error.begin(), error.end()};
}

// With an error of 200 % or more, a model is useless, and the exact number does not matter.
std::string relative_error(double error) { return error < 1.999 ? number(100 * error) + " %" : "> 200 %"; }

// Candidates with the errors that decided between them.
struct Trial {
  std::string symbol;
  std::vector<Index> candidates;
  std::vector<std::pair<std::string, std::vector<double>>> errors;
  Index best = 0;
};

Trial lag_trial(const Identification& result) {
  const LagOrderErrors& found = result.lag_order_errors;
  Trial trial{"p", {}, {{"leave-one-out error", relative(found.mean)}}, found.best};
  for (Index p = 1; p <= found.mean.size(); ++p) trial.candidates.push_back(p);
  return trial;
}

bool decided_after_em(const Identification& result) {
  return result.refinement.iterations > 0 && result.refinement.states != result.order_scores.best;
}

Trial state_trial(const Identification& result) {
  const OrderScores& found = result.order_scores;
  Trial trial{"n", found.states, {}, found.best};
  if (found.states.empty()) return trial;
  for (size_t h = 0; h < found.horizons.size(); ++h) {
    const std::string steps = h == 0 ? "one" : fmt::format("{}", found.horizons[h]);
    const Vector errors = found.errors.col(Index(h)).array().exp();
    trial.errors.emplace_back(steps + "-step error", std::vector<double>(errors.begin(), errors.end()));
  }
  return trial;
}

void add_trial(const Trial& trial, Page& page) {
  if (trial.candidates.empty()) return;
  std::vector<std::vector<std::string>> rows{{trial.symbol}};
  for (const auto& [name, values] : trial.errors) rows.front().push_back(name);
  for (size_t i = 0; i < trial.candidates.size(); ++i) {
    rows.push_back({fmt::format("{}", trial.candidates[i])});
    for (const auto& [name, values] : trial.errors) rows.back().push_back(relative_error(values[i]));
    rows.back().emplace_back(trial.candidates[i] == trial.best ? "chosen" : "");
  }
  page.table(rows);
}

// null if nothing was tried.
Json json(const Trial& trial) {
  if (trial.candidates.empty()) return {};
  Json j{{"candidates", trial.candidates}, {"best", trial.best}};
  for (const auto& [name, values] : trial.errors) {
    std::string key = name;
    for (char& c : key)
      if (c == ' ' || c == '-') c = '_';
    j[key] = values;
  }
  return j;
}

Json json(const HeldOutErrors& errors) { return {{"error", errors.error}, {"standard_error", errors.standard_error}}; }

Json json(const RegressionComparison& comparison) {
  return {{"horizons", comparison.horizons},
          {"experiments", comparison.experiments},
          {"first_step", comparison.first_step},
          {"model", json(comparison.model)},
          {"regression", json(comparison.regression)},
          {"lags", comparison.lags},
          {"smoothing", json_penalty(comparison.smoothing)}};
}

// null if nothing was tried.
Json json(const RefinementChoice& choice) {
  if (choice.trials.empty() && choice.jumps.empty()) return {};
  Json j{{"states", choice.states},
         {"smoothing", choice.smoothing},
         {"iterations", choice.iterations},
         {"ahead_ratio", choice.ahead.ratio},
         {"ahead_model_share", choice.ahead.model_share},
         {"jumps", Json::array()},
         {"trials", Json::array()}};
  for (const Jump& jump : choice.jumps)
    j["jumps"].push_back({{"step", jump.step}, {"loss", jump.loss ? Json(*jump.loss) : Json()}});
  for (const RefinementTrial& t : choice.trials)
    j["trials"].push_back({{"states", t.states},
                           {"smoothing", t.smoothing},
                           {"iterations", t.iterations},
                           {"error", std::exp(t.error)},
                           {"log_likelihood", t.log_likelihood}});
  return j;
}

// The verdict on the model, or the reason why there is none.
struct Judgement {
  std::optional<Verdict> verdict = {};
  std::string why_none = {};
};

// This command with its options, and more options.
std::string command_with(const IdentifyCall& call, const std::string& more) {
  std::string text =
      fmt::format("tokid identify {} -o {}{}", words_of(call.paths), word(call.model.string()), words_of(call.read));
  for (const Option& option : option_table()) {
    const Json value = option.write(call.options);
    if (value == option.write(IdentifyOptions{})) continue;
    std::string name = option.key;
    std::replace(name.begin(), name.end(), '_', '-');
    std::string given = value.is_string() ? value.get<std::string>() : value.dump();
    std::erase_if(given, [](char c) { return c == '[' || c == ']'; });
    text += option.is_switch() ? fmt::format(" --{}{}", given == "no" ? "no-" : "", name)
                               : fmt::format(" --{} {}", name, given);
  }
  if (!call.page.empty()) text += " --report " + word(call.page.string());
  if (!call.state.empty()) text += " --state " + word(call.state.string());
  return text + ' ' + more;
}

NextStep after(const IdentifyCall& call, const Identification& result, const Judgement& judgement) {
  if (!judgement.verdict) return test_on_other_data(call.model, call.paths, call.read);
  constexpr Index enough = 8;  // fewer experiments make a model that says little about the one of all
  const Index used = result.experiments + result.held_out_experiments, remain = used - (used + 4) / 5;
  const bool can_hold_out = remain >= enough && (result.plan.coupled || remain >= result.min_experiments);
  return next_step(*judgement.verdict, result.findings,
                   {call.model, call.paths, call.read, !result.held_out, can_hold_out,
                    [&call](const std::string& more) { return command_with(call, more); }});
}

std::string missing_text(const Data& data) {
  std::string text = data.missing == 0 ? "no missing samples" : plural(data.missing, "missing sample");
  if (data.free_responses > 0) text += fmt::format(", {}", plural(data.free_responses, "free response"));
  return text;
}

std::string nominal_text(const IdentifyCall& call, const Data& data, const Identification& result) {
  if (call.options.nominal == NominalChoice::none) return "none, as asked";
  if (call.options.nominal == NominalChoice::mean) return "the mean motion was removed, as asked";
  return nominal_remark(result.nominal_test, result.model.names, data.inputs, call.options.period);
}

// The largest lag order that the experiments permit. A removed mean motion uses one degree of freedom, so one
// experiment is subtracted.
Index largest_lags(const Data& data, const Identification& result) {
  const Index spent = result.plan.nominal ? 1 : 0;
  return largest_lag_order(result.experiments - spent, data.inputs, data.outputs, result.plan.feedthrough.present);
}

std::string smoothing_text(const IdentifyCall& call, const Identification& result) {
  const Index period = result.plan.choices.variation.period;
  if (period == 1)
    return call.options.period == 1 ? "one model for all steps, as asked"
                                    : "one model for all steps: models that vary over time do not predict better";
  const char* why = call.options.smoothing ? "as asked" : "by cross-validation error";
  return fmt::format("{}lambda = {} over time, {}",
                     period > 1 ? fmt::format("steps k and k + {} share a model; ", period) : std::string(),
                     penalty(result.plan.choices.variation.smoothing), why);
}

// Each row has the errors of one lag order, and each column those of one lambda.
void add_smoothing_trials(const SmoothingChoice& choice, Page& page) {
  std::map<Index, std::map<double, double>> errors;
  std::set<double> weights;
  for (const SmoothingTrial& t : choice.trials) {
    errors[t.lags][t.smoothing] = t.error;
    weights.insert(t.smoothing);
  }
  std::vector<std::vector<std::string>> rows{{"p \\ lambda"}};
  for (const double w : weights) rows.front().push_back(penalty(w));
  for (const auto& [lags, row] : errors) {
    rows.push_back({fmt::format("{}", lags)});
    for (const double w : weights) rows.back().push_back(row.count(w) ? relative_error(row.at(w)) : std::string("."));
  }
  page.table(rows);
}

void add_lag_order(const IdentifyCall& call, const Data& data, const Identification& result, Page& page) {
  const bool tried = result.lag_order_errors.mean.size() > 0;
  const bool together = !result.smoothing_choice.trials.empty();
  const char* why = call.options.lags ? "as asked"
                    : together        ? "by cross-validation error"
                    : tried           ? "by leave-one-out error"
                                      : "the smallest possible";
  page.row("Lag order", fmt::format("p = {}, {}", result.plan.lags, why));
  if (!call.verbose) return;
  if (together) return add_smoothing_trials(result.smoothing_choice, page);
  page.row("",
           fmt::format("{} permit lag orders up to p = {}, and this lag order needs at least {}",
                       plural(result.experiments, "experiment"), largest_lags(data, result), result.min_experiments));
  add_trial(lag_trial(result), page);
}

void add_states(const IdentifyCall& call, const Identification& result, Page& page) {
  const Model& model = result.model;
  const bool tried = !result.order_scores.states.empty();
  const bool after_em = decided_after_em(result);
  const char* why = call.options.states == model.states()          ? "as asked"
                    : result.plan.method == Method::regression     ? "all those of the regression"
                    : after_em                                     ? "by cross-validation error, after EM"
                    : tried && result.order_scores.cross_validated ? "by cross-validation error"
                    : tried                                        ? "by prediction errors"
                                                                   : "the rank of the Hankel matrices";
  page.row("States", fmt::format("n = {}, {}", model.states(), why));
  if (!call.verbose) return;
  if (const double gap = result.singular_value_gap; std::isfinite(gap))
    page.row("", fmt::format("the next singular value is smaller by a factor of {}", number(gap)));
  Trial trial = state_trial(result);
  if (after_em) trial.best = result.refinement.states;
  add_trial(trial, page);
}

void add_refinement(const Identification& result, Page& page) {
  const RefinementChoice& choice = result.refinement;
  if (choice.trials.empty()) return;
  const double before = std::exp(choice.trials.front().error), after = std::exp(choice.error);
  const bool dropped = std::any_of(result.findings.begin(), result.findings.end(), [](const Finding& finding) {
    return finding.kind == Finding::Kind::em_worse_one_step || finding.kind == Finding::Kind::em_worse_ahead;
  });
  page.row("Refinement", choice.iterations > 0
                             ? fmt::format("EM, {}, lambda = {}: cross-validation error {} instead of {}",
                                           plural(choice.iterations, "iteration"), penalty(choice.smoothing),
                                           relative_error(after), relative_error(before))
                         : dropped ? "none: EM made the model better in cross-validation, but not on the whole data"
                                   : "none: EM did not lower the cross-validation error");
}

void add_delays(const IdentifyCall& call, const Identification& result, Page& page) {
  const std::vector<Index>& delays = result.plan.choices.delays;
  std::vector<std::string> texts;
  for (size_t i = 0; i < delays.size(); ++i)
    if (delays[i] > 0)
      texts.push_back(fmt::format("{} {}", result.model.names.input(Index(i)), plural(delays[i], "step")));
  if (texts.empty()) return;
  page.row("Dead times",
           fmt::format("{}, {}", fmt::join(texts, ", "), call.options.delays ? "as asked" : "by cross-validation"));
}

void add_jumps(const IdentifyCall& call, const Identification& result, Page& page) {
  const std::vector<Jump>& jumps = result.refinement.jumps;
  if (jumps.empty()) return;
  std::vector<std::string> texts;
  for (const Jump& jump : jumps)
    texts.push_back(jump.loss ? fmt::format("{} ({} standard errors)", jump.step, number(*jump.loss))
                              : std::to_string(jump.step));
  page.row("Jumps", fmt::format("at {} {}, {}", jumps.size() > 1 ? "steps" : "step", fmt::join(texts, ", "),
                                call.options.jumps ? "as asked" : "by cross-validation error"));
}

Index dropped_experiments(const Identification& result) {
  return std::count_if(result.outliers.begin(), result.outliers.end(), [](const Outlier& o) { return o.weight == 0; });
}

// What was done about experiments and samples that do not fit.
void add_outliers(const IdentifyCall& call, const Identification& result, Page& page) {
  if (call.options.outliers == OutlierChoice::keep) return;
  const Corrections& made = result.model.provenance.corrections;
  const Index dropped = dropped_experiments(result), samples = Index(made.samples.size());
  std::vector<std::string> parts;
  if (dropped > 0) parts.push_back(plural(dropped, "experiment") + " dropped");
  if (const Index less = Index(made.experiments.size()) - dropped; less > 0)
    parts.push_back(plural(less, "experiment") + " downweighted");
  if (samples > 0)
    parts.push_back(plural(samples, "sample") +
                    (call.options.outliers == OutlierChoice::drop ? " dropped" : " moved towards the prediction"));
  page.row("Outliers", parts.empty() ? "none found" : fmt::format("{}", fmt::join(parts, ", ")));
}

void add_fit(const Data& data, const Identification& result, Page& page) {
  const Model& model = result.model;
  const Index held_out = result.held_out_experiments;
  const std::string where = !result.held_out ? "on the training data"
                            : held_out > 0   ? fmt::format("on {} held out", plural(held_out, "experiment"))
                                             : fmt::format("on the last {}", plural(data.steps - result.steps, "step"));
  std::vector<std::vector<std::string>> rows{{where, "simulation", "one step"}};
  for (Index j = 0; j < model.outputs; ++j)
    rows.push_back({output_label(model.names, j), percent(result.validation.simulation.fit(j)),
                    percent(result.validation.one_step.fit(j))});
  page.table("Fit", rows);
  if (data.blocks > 0)
    page.row("", "each block is simulated separately, from a state that the samples before the block determine");
}

void add_output_weights(const IdentifyCall& call, const Identification& result, Page& page) {
  std::vector<std::string> texts;
  for (size_t j = 0; j < call.options.output_weights.size(); ++j)
    texts.push_back(
        fmt::format("{} for {}", call.options.output_weights[j], output_label(result.model.names, Index(j))));
  if (!texts.empty()) page.row("Weights", fmt::format("{}, as asked", fmt::join(texts, ", ")));
}

// What was decided before the regressions, and how they came out.
void add_assumptions(const IdentifyCall& call, const Data& data, const Identification& result, Page& page) {
  if (call.verbose || !data.says_initial_state)
    page.row("Initial state",
             fmt::format("{}: {}", to_string(result.model.initial_state), result.initial_state_test.reason));
  if (call.verbose || result.plan.nominal) page.row("Nominal", nominal_text(call, data, result));
  if (call.verbose) page.row("Feedthrough", in_words(result.plan.feedthrough));
  add_outliers(call, result, page);
  add_output_weights(call, result, page);
}

void add_result(const IdentifyCall& call, const Identification& result, Page& page) {
  const Model& model = result.model;
  if (call.verbose)
    page.row("Model",
             fmt::format("{}, {} frame, steps {} to {}, all {} from {} to {}", model.method, model.frame, model.k_begin,
                         model.k_end() - 1, plural(model.states(), "state"), model.full_begin(), model.full_end() - 1));
  if (call.verbose && !result.plan.coupled)
    page.row("Regressions", fmt::format("condition up to {}, {} of {} rank deficient", number(result.condition_max),
                                        result.rank_deficient_steps, plural(result.steps, "step")));
}

std::string report(const IdentifyCall& call, const Data& data, const Identification& result,
                   const Judgement& judgement) {
  Page page;
  page.row("Data", fmt::format("{}: {} of {}, {}, {}, dt = {:.6g} s", call.data.string(),
                               plural(data.experiments, "experiment"), plural(data.steps, "step"),
                               plural(data.inputs, "input"), plural(data.outputs, "output"), data.dt));
  if (call.verbose || data.missing > 0 || data.free_responses > 0) page.row("", missing_text(data));
  if (data.blocks > 0)
    page.row("Blocks", fmt::format("{} of up to {}; each block also reads {} steps of its neighbours", data.blocks,
                                   plural(data.block, "step"), data.overlap));
  add_assumptions(call, data, result, page);
  add_lag_order(call, data, result, page);
  add_states(call, result, page);
  if (!result.smoothing_choice.trials.empty()) page.row("Smoothing", smoothing_text(call, result));
  add_refinement(result, page);
  add_delays(call, result, page);
  add_jumps(call, result, page);
  add_result(call, result, page);
  add_fit(data, result, page);
  page.row("Written", fmt::format("{} in {:.2f} s", call.model.string(), result.seconds));
  if (!call.page.empty()) page.row("", call.page.string());
  if (judgement.verdict)
    add_verdict(*judgement.verdict, call.verbose, page);
  else
    page.row("Verdict", judgement.why_none);
  const NextStep next = after(call, result, judgement);
  page.command("Next", next.purpose, next.command);
  return page.text();
}

Json json(const NominalTest& test, const Model& model, Index inputs) {
  Json departures = Json::array();
  for (const NominalTest::Departure& departure : test.departures) {
    Json ranges = Json::array();
    for (const Index k : departure.steps)
      if (!ranges.empty() && ranges.back()[1] == k - 1)
        ranges.back()[1] = k;
      else
        ranges.push_back({k, k});
    departures.push_back({{"channel", departure.channel < inputs ? model.names.input(departure.channel)
                                                                 : model.names.output(departure.channel - inputs)},
                          {"steps", ranges}});
  }
  return {{"statistic", test.statistic},
          {"threshold", test.threshold},
          {"step_statistic", test.step_statistic},
          {"step_threshold", test.step_threshold},
          {"constant_statistic", test.constant_statistic},
          {"constant_threshold", test.constant_threshold},
          {"departures", departures},
          {"significant", test.significant}};
}

Json json(const IdentifyCall& call, const Data& data, const Identification& result, const Judgement& judgement) {
  const Model& model = result.model;
  Json j;
  j["data"] = json_of(call.paths);
  j["model"] = call.model.string();
  j["report"] = call.page.empty() ? Json() : Json(call.page.string());
  j["block"] = data.blocks > 0 ? Json(data.block) : Json();
  j["experiments"] = result.experiments;
  j["held_out_experiments"] = result.held_out_experiments;
  j["steps"] = result.steps;
  j["inputs"] = data.inputs;
  j["outputs"] = data.outputs;
  j["dt"] = data.dt;
  j["missing_samples"] = data.missing;
  j["free_responses"] = data.free_responses;
  j["method"] = model.method;
  j["frame"] = model.frame;
  j["states"] = model.states();
  j["lags"] = result.plan.lags;
  j["delays"] = result.plan.choices.delays;
  j["largest_lag_order"] = largest_lags(data, result);
  j["min_experiments"] = result.min_experiments;
  j["smoothing"] = json_penalty(result.plan.choices.variation.smoothing);
  j["state_smoothing"] = json_penalty(result.plan.choices.state_smoothing);
  j["output_weights"] = call.options.output_weights.empty() ? Json() : Json(call.options.output_weights);
  j["period"] = result.plan.choices.variation.period;
  j["lag_order_errors"] = json(lag_trial(result));
  j["smoothing_trials"] = Json::array();
  for (const SmoothingTrial& t : result.smoothing_choice.trials)
    j["smoothing_trials"].push_back({{"lags", t.lags}, {"smoothing", json_penalty(t.smoothing)}, {"error", t.error}});
  j["refinement"] = json(result.refinement);
  j["comparison"] = result.comparison ? json(*result.comparison) : Json();
  j["order_scores"] = json(state_trial(result));
  j["initial_state"] = to_string(model.initial_state);
  const InitialStateTest& initial = result.initial_state_test;
  const bool tested = !call.options.initial_state && !data.says_initial_state;
  j["initial_state_test"] = {{"statistic", tested ? Json(initial.statistic) : Json()},
                             {"threshold", tested ? Json(initial.threshold) : Json()},
                             {"decision", to_string(initial.decision)},
                             {"reason", initial.reason}};
  const FeedthroughChoice& feedthrough = result.plan.feedthrough;
  j["feedthrough"] = feedthrough.present;
  j["feedthrough_choice"] = {{"reason", to_string(feedthrough.reason)},
                             {"response_p", feedthrough.response_p},
                             {"feedback_p", feedthrough.feedback_p}};
  j["nominal"] = result.plan.nominal;
  j["nominal_test"] = nullptr;
  if (!call.options.nominal) j["nominal_test"] = json(result.nominal_test, model, data.inputs);
  j["k_begin"] = model.k_begin;
  j["k_end"] = model.k_end();
  j["full_begin"] = model.full_begin();
  j["full_end"] = model.full_end();
  j["singular_value_gap"] = result.singular_value_gap;
  j["condition_max"] = result.plan.coupled ? Json() : Json(result.condition_max);
  j["rank_deficient_steps"] = result.plan.coupled ? Json() : Json(result.rank_deficient_steps);
  j["evaluated_on"] = result.held_out ? "held_out" : "training";
  j["output_names"] = Json::array();
  for (Index i = 0; i < model.outputs; ++i) j["output_names"].push_back(model.names.output(i));
  j["one_step_fit"] = numbers(result.validation.one_step.fit);
  j["simulation_fit"] = numbers(result.validation.simulation.fit);
  j["whiteness_p"] = result.validation.whiteness_p;
  j["verdict"] = judgement.verdict ? with_checks(*judgement.verdict) : Json();
  j["no_verdict"] = judgement.verdict ? Json() : Json(judgement.why_none);
  j["outliers"] = Json::array();
  for (const Outlier& o : result.outliers)
    j["outliers"].push_back({{"experiment", o.experiment},
                             {"name", o.name.empty() ? Json() : Json(o.name)},
                             {"ratio", o.ratio},
                             {"outputs", json_of(o.outputs)},
                             {"weight", o.weight},
                             {"held_out", o.held_out}});
  j["outlying_samples"] = json_of(result.validation.outlying);
  j["copies"] = result.copies.groups;
  add_findings(j, result.findings);
  j["seconds"] = result.seconds;
  j["version"] = version;
  return j;
}

// Writes the page if the call asks for one. The verdict is that of the page.
Judgement judged(const IdentifyCall& call, const Ensemble& data, const Identification& result) {
  ReportOptions options;
  options.model_name = call.model.filename().string();
  options.data_name = call.data.filename().string();
  if (!call.page.empty()) {
    ReportPage page = identification_page(result, data, call.options, options);
    save_text(page.html, call.page);
    return {std::move(page.verdict)};
  }
  if (call.quiet && !call.json) return {};
  try {
    return {verdict(result, data, call.options, options)};
  } catch (const std::invalid_argument& error) {
    return {std::nullopt, fmt::format("none: {}", error.what())};
  }
}

void print_result(const IdentifyCall& call, const Data& data, const Identification& result,
                  const Judgement& judgement) {
  if (call.json)
    print(json(call, data, result, judgement));
  else if (!call.quiet)
    print(report(call, data, result, judgement));
  warn(result.findings);
}

bool is_hdf5(const fs::path& path) {
  const std::string extension = extension_of(path);
  return extension == ".h5" || extension == ".hdf5";
}

// Should the identification work in blocks? Yes if --block states a number, if the samples need much memory, or if
// several processes share the work.
bool in_blocks(const IdentifyCall& call) {
  constexpr double much = 512e6;
  if (call.block != automatic) return call.block > 0;
  const IdentifyOptions& o = call.options;
  const bool possible = is_hdf5(call.model) && call.page.empty() && call.state.empty() && o.period == 0 &&
                        o.smoothing != std::numeric_limits<double>::infinity() && o.frame != Frame::reference &&
                        o.outliers == OutlierChoice::keep && (!o.jumps || o.jumps->empty()) &&
                        (!o.delays || o.delays->empty());
  const std::optional<double> bytes = possible && call.paths.size() == 1 ? bytes_in_blocks(call.data) : std::nullopt;
  return bytes && (*bytes > much || team().size > 1);
}

void run_in_blocks(const IdentifyCall& call) {
  if (!call.page.empty())
    throw std::invalid_argument(
        "--report: not possible with --block, because the page shows whole experiments, and --block reads only "
        "parts of them. Leave out --report, and run tokid report later with other experiments");
  if (!call.state.empty())
    throw std::invalid_argument(
        "--state: not possible with --block, because a state file contains the factors of all steps, and --block "
        "never has all steps in memory. Leave out one of the two options");
  if (!call.read.inputs.empty() || !call.read.outputs.empty())
    throw std::invalid_argument(
        "--inputs, --outputs: not possible with --block. They choose columns of a .csv, and a .csv can't be read "
        "in blocks. Leave out --block, or --inputs and --outputs");
  if (!is_hdf5(call.data)) {
    for (const fs::path& path : call.paths) file_kind(path);  // does it exist?
    throw std::invalid_argument(fmt::format(
        "--block: '{}' found, an .h5 needed, because other formats can't be read in blocks. Convert the data "
        "with tokid convert",
        call.data.string()));
  }
  const EnsembleFile file(call.data);
  const Streamed streamed = about(call.data, [&] {
    ProgressBar bar(!call.quiet && team().rank == 0);
    StreamOptions options;
    options.identify = call.options;
    options.identify.execution.progress = bar.callback();
    options.block = call.block;
    options.team = team();
    return identify_stream(file, call.model, options);
  });
  if (team().rank == 0)
    print_result(call, about_data(file, streamed), streamed.identification,
                 {std::nullopt, "none, because the data were read in blocks"});
}

// One line about the model before EM; empty if it can't be validated.
std::string about_first(const Model& model, const Ensemble& data) {
  try {
    const Vector fit = validate(model, data).one_step.fit;
    std::vector<std::string> fits;
    for (Index j = 0; j < fit.size(); ++j)
      fits.push_back(fmt::format("{} {:.1f} %", printable(model.names.output(j)), fit(j)));
    return fmt::format("first model, before EM: n = {} states, one-step fit {}", model.states(), fmt::join(fits, ", "));
  } catch (const std::exception&) {
    return {};
  }
}

void run_at_once(const IdentifyCall& call) {
  // The lock begins before the identification. Otherwise another process could update the old state meanwhile, and this
  // update would be lost.
  std::optional<HeldFile> held;
  if (!call.state.empty()) held.emplace(call.state);
  const Ensemble data = load_ensemble(call.paths, call.read);
  const Identification result = about(call.data, [&call, &data] {
    ProgressBar bar(!call.quiet);
    IdentifyOptions options = call.options;
    if (!call.state.empty() && !options.delays) options.delays.emplace();  // a state file can't contain dead times
    options.execution.progress = bar.callback();
    return identify(data, options, [&](Model first) {
      constexpr std::chrono::seconds worth_it{2};
      bar.note_after(worth_it, [&data, first = std::move(first)] { return about_first(first, data); });
    });
  });
  std::optional<UpdateState> state;
  if (!call.state.empty()) state = about(call.data, [&] { return update_state(data, result, call.options); });
  FilesTogether files;
  const Judgement judgement = judged(call, data, result);
  if (state) save_update_state(*state, *held);
  save_model(result.model, call.model);  // saved last: if the model exists, all files exist
  files.commit();
  print_result(call, about_data(data), result, judgement);
}

void run_identify(const IdentifyCall& call) {
  check_output(call.model, Content::model, call.paths);
  if (!call.page.empty()) check_output(call.page, Content::page);
  std::vector<fs::path> kept = call.paths;
  kept.push_back(call.model);
  if (!call.state.empty()) check_output(call.state, Content::state, kept);
  if (call.options.reference_step && call.options.frame != Frame::reference)
    throw std::invalid_argument("--reference-step: used only in the reference frame. Add --frame reference");
  if (in_blocks(call))
    run_in_blocks(call);
  else if (team().rank == 0)
    run_at_once(call);
}

std::optional<Index> block_steps(const std::string& text) {
  return text == "auto" ? automatic : text == "all" ? all_at_once : parse_number<Index>(text, 1, 1'000'000'000);
}

// Numbers as numbers, any other text as text.
Json value_of(const std::string& text) {
  if (const auto whole =
          parse_number<Index>(text, std::numeric_limits<Index>::min(), std::numeric_limits<Index>::max()))
    return *whole;
  constexpr double largest = std::numeric_limits<double>::max();
  if (const auto number = parse_number<double>(text, -largest, largest)) return *number;
  return text;
}

// Adds the options of option_table().
void add_options(Command& command, IdentifyOptions& target) {
  for (const Option& option : option_table()) {
    std::string name = option.key;
    std::replace(name.begin(), name.end(), '_', '-');
    if (option.is_switch()) {
      command.flag(("--" + name).c_str(), [&] { option.read(target, true); }, option.help.c_str());
      command.flag(("--no-" + name).c_str(), [&] { option.read(target, false); }, option.opposite.c_str());
      command.excludes(("--no-" + name).c_str(), ("--" + name).c_str());
    } else {
      command.text(("--" + name).c_str(), option.value.c_str(), option.help.c_str(),
                   [&](const std::string& text) { return option.read(target, value_of(text)); },
                   option.needed() + " needed");
    }
  }
}

}  // namespace

void add_identify(CLI::App& tool) {
  const auto call = std::make_shared<IdentifyCall>();
  IdentifyOptions& o = call->options;
  Command command(tool, "identify", "Identify a time varying model from an ensemble of experiments",
                  "tokid identify data.npz -o model.npz --hold-out 0.2");
  command.data("DATA", call->paths, call->data,
               "Ensemble: .npz, .h5, .mat or .csv; or many .csv: files, a folder, a pattern");
  command.output(call->model, "Model to write: .npz, .h5 or .mat");
  command.columns(call->read);
  add_options(command, o);
  command.flag(
      "--time-invariant", [&o] { o.period = 1; }, "One model for all steps; a single record is enough");
  command.excludes("--period", "--time-invariant");
  command.threads(o.execution.threads);
  command.value("--block", call->block, "STEPS|auto|all",
                "Steps of an .h5 in memory at a time, or all (auto: all, in blocks beyond 512 MB of samples)",
                block_steps, "a whole number from 1 on, auto or all needed");
  command.file("--report", call->page, "Page to write that shows whether the model can be trusted: .html");
  const auto file_name = [](const std::string& text) {
    return parse_number<double>(text, 0, 1e300) ? std::nullopt : std::optional<fs::path>(text);
  };
  command.value("--state", call->state, "FILE",
                "State file to write, to which tokid update adds later experiments: .h5, .npz or .mat", file_name,
                "the name of a file to write needed; --states takes the number of states");
  command.verbose(call->verbose);
  command.flag("--json", call->json, "Print one JSON object");
  command.flag("--quiet", call->quiet, "Print warnings and errors only");
  command.runs([call] { run_identify(*call); });
}

}  // namespace tokid::app
