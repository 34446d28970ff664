// tokid info: what is in a file?
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "command.hpp"
#include "common.hpp"
#include "control_rows.hpp"
#include "data/extents.hpp"
#include "io/formats/provenance_text.hpp"
#include "io/formats/provenance_words.hpp"
#include "picture.hpp"
#include "tokid/controller_file.hpp"

namespace tokid::app {

namespace {

struct InfoCall {
  std::vector<fs::path> paths;
  fs::path file;  // how reports name the paths
  ReadOptions read{{}, {}, false};
  fs::path page;  // of the picture
  bool json = false, verbose = false;
};

// Ensembles

struct Channel {
  const char* kind;
  std::string name, unit, label;
  ChannelSummary samples;
};

Channel channel(const Ensemble& e, Index c) {
  const bool input = c < e.inputs();
  const Index i = input ? c : c - e.inputs();
  const std::vector<std::string>& units = input ? e.names.input_units : e.names.output_units;
  return {input ? "input" : "output", input ? e.names.input(i) : e.names.output(i),
          size_t(i) < units.size() ? units[size_t(i)] : "", input ? input_label(e.names, i) : output_label(e.names, i),
          channel_summary(e, c)};
}

std::vector<Channel> channels(const Ensemble& e) {
  std::vector<Channel> result;
  for (Index c = 0; c < e.channels(); ++c) result.push_back(channel(e, c));
  return result;
}

// Copies and empty experiments do not count.
Index usable_experiments(const Ensemble& e, const Findings& findings) {
  using Kind = Finding::Kind;
  Index count = e.experiments();
  for (const Finding& f : findings)
    if (f.kind == Kind::experiments_copied || f.kind == Kind::experiments_empty)
      count -= Index(f.experiments.size());
  return count;
}

Json json(const InfoCall& call, const Ensemble& e, const Findings& findings) {
  Json j;
  j["file"] = json_of(call.paths);
  j["kind"] = "ensemble";
  j["experiments"] = e.experiments();
  j["experiment_names"] = e.experiment_names.empty() ? Json() : Json(e.experiment_names);
  j["steps"] = e.steps();
  j["inputs"] = e.inputs();
  j["outputs"] = e.outputs();
  j["dt"] = e.dt;
  j["dt_stated"] = e.dt_stated;
  j["missing_samples"] = missing_samples(e);
  j["length"] = e.length.empty() ? Json() : Json(e.length);
  j["initial_state"] = e.initial_state ? Json(to_string(*e.initial_state)) : Json();
  j["free_responses"] = {{"experiments", e.free.experiments}, {"steps", e.free.steps}};
  j["largest_lag_order"] = largest_lag_order(usable_experiments(e, findings), e.inputs(), e.outputs());
  j["channels"] = Json::array();
  for (const auto& [kind, name, unit, label, s] : channels(e))
    j["channels"].push_back({{"kind", kind},
                             {"name", name},
                             {"unit", unit},
                             {"samples", s.samples},
                             {"missing", s.missing},
                             {"mean", s.mean},
                             {"std", s.std},
                             {"min", s.min},
                             {"max", s.max}});
  j["picture"] = call.page.empty() ? Json() : Json(call.page.string());
  add_findings(j, findings);
  return j;
}

// The first names and the last one.
std::string name_list(const std::vector<std::string>& names) {
  constexpr size_t most = 6;
  if (names.size() <= most) return fmt::format("{}", fmt::join(names, ", "));
  return fmt::format("{}, … {}", fmt::join(names.begin(), names.begin() + most - 1, ", "), names.back());
}

std::string report(const InfoCall& call, const Ensemble& e, const Findings& findings) {
  Page page;
  page.row("Ensemble", call.file.string());
  page.row("", describe(e));
  const std::vector<Index> length = lengths(e);
  if (const auto [least, most] = std::minmax_element(length.begin(), length.end()); *least < e.steps())
    page.row("Lengths", fmt::format("{} to {} steps", *least, *most));
  if (!e.experiment_names.empty()) page.row("Named", name_list(e.experiment_names));
  page.row("Initial state", e.initial_state ? to_string(*e.initial_state) : "not stated");
  if (e.free.experiments > 0)
    page.row("Free", fmt::format("{} of {}", plural(e.free.experiments, "response"), plural(e.free.steps, "step")));
  const Index usable = usable_experiments(e, findings), p = largest_lag_order(usable, e.inputs(), e.outputs());
  page.row("Lag orders",
           p > 0 ? fmt::format("{} permit p up to {}", plural(usable, "experiment"), p)
                 : fmt::format("none; p = 1 needs {} experiments", minimum_experiments(e.inputs(), e.outputs(), 1)));
  page.row("Channels", "");
  std::vector<std::vector<std::string>> rows{{"channel", "kind", "missing", "mean", "std", "min", "max"}};
  for (const auto& [kind, name, unit, label, s] : channels(e))
    rows.push_back(
        {label, kind, fmt::format("{}", s.missing), number(s.mean), number(s.std), number(s.min), number(s.max)});
  page.table(rows);
  Page written;
  if (!call.page.empty()) written.row("Written", call.page.string());
  return page.text() + picture(e, shows_blocks()) + written.text();
}

// Models

struct Span {
  Index least = 0, most = 0;
};

Span span(const std::vector<Index>& values) {
  if (values.empty()) return {};
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return {*least, *most};
}

Span state_dimensions(const Model& model) {
  std::vector<Index> values;
  for (Index k = model.k_begin; k <= model.k_end(); ++k) values.push_back(model.n(k));
  return span(values);
}

Span lag_orders(const Model& model) {
  std::vector<Index> values;
  for (const Step& step : model.step)
    if (step.has_lags()) values.push_back(step.lags());
  return span(values);
}

std::vector<double> conditions(const Model& model) {
  std::vector<double> values;
  for (const Step& step : model.step)
    if (step.has_condition()) values.push_back(step.condition());
  return values;
}

std::string text(const Span& s) {
  return s.least == s.most ? fmt::format("{}", s.most) : fmt::format("{} to {}", s.least, s.most);
}

double largest(const std::vector<double>& values) {
  return values.empty() ? std::numeric_limits<double>::quiet_NaN() : *std::max_element(values.begin(), values.end());
}

// Median norm of the product of successive closed-loop matrices: zero for a deadbeat observer, which forgets its
// initial state. Steps without states do not count.
double deadbeat_norm(const Model& model) {
  return model.step.empty() ? std::numeric_limits<double>::quiet_NaN()
                            : median(deadbeat_products(model, model.max_lags()));
}

std::vector<std::string> noise_fields(const Model& model) {
  std::vector<std::string> names;
  const auto add = [&names](bool there, const char* name) {
    if (there) names.emplace_back(name);
  };
  add(model.has(&Step::has_innovation_cov), "innovation_cov");
  add(model.has(&Step::has_Q), "Q");
  add(model.has(&Step::has_R), "R");
  add(model.has(&Step::has_K), "K");
  add(model.x0_mean.size() > 0, "x0_mean");
  add(model.x0_cov.size() > 0, "x0_cov");
  return names;
}

Json json(const InfoCall& call, const Model& model) {
  const Span dims = state_dimensions(model), lags = lag_orders(model);
  const std::vector<double> condition = conditions(model);
  Json j;
  j["file"] = call.file.string();
  j["kind"] = "model";
  j["method"] = model.method;
  j["frame"] = model.frame;
  j["states"] = model.states();
  j["inputs"] = model.inputs;
  j["outputs"] = model.outputs;
  j["steps"] = model.steps();
  j["k_begin"] = model.k_begin;
  j["k_end"] = model.k_end();
  j["dt"] = model.dt;
  j["dt_stated"] = model.provenance.dt_stated;
  j["initial_state"] = to_string(model.initial_state);
  j["nominal"] = model.u_nominal.size() > 0;
  j["state_dim"] = {{"min", dims.least}, {"max", dims.most}};
  j["full_begin"] = model.full_begin();
  j["full_end"] = model.full_end();
  j["lags"] = {{"min", lags.least}, {"max", lags.most}};
  j["condition_median"] = median(condition);
  j["condition_max"] = largest(condition);
  j["rank_deficient_steps"] = rank_deficient_steps(model);
  j["deadbeat_product_norm"] = deadbeat_norm(model);
  j["noise"] = noise_fields(model);
  j["input_names"] = Json::array();
  for (Index i = 0; i < model.inputs; ++i) j["input_names"].push_back(model.names.input(i));
  j["output_names"] = Json::array();
  for (Index i = 0; i < model.outputs; ++i) j["output_names"].push_back(model.names.output(i));
  const std::string text = io::provenance_text(model.provenance);
  const Json options = Json::parse(text, nullptr, false);
  j["options"] = options.is_discarded() ? Json(text) : options;
  j["version"] = model.provenance.version;
  return j;
}

std::string report(const InfoCall& call, const Model& model) {
  const auto labels = [](Index count, const auto& label) {
    std::vector<std::string> names;
    for (Index i = 0; i < count; ++i) names.push_back(label(i));
    return fmt::format("{}", fmt::join(names, ", "));
  };
  Page page;
  page.row("Model", call.file.string());
  page.row("", describe(model));
  if (!model.provenance.dt_stated) page.row("", "dt is assumed: the data of the identification stated no sample time");
  page.row("", fmt::format("method {}, {} frame, tokid {}", model.method, model.frame,
                           model.provenance.version.empty() ? "unknown" : model.provenance.version));
  page.row("Inputs", labels(model.inputs, [&](Index i) { return input_label(model.names, i); }));
  page.row("Outputs", labels(model.outputs, [&](Index j) { return output_label(model.names, j); }));
  page.row("States", fmt::format("dimensions {}, full at steps {} to {}", text(state_dimensions(model)),
                                 model.full_begin(), model.full_end() - 1));
  page.row("Initial state", to_string(model.initial_state));
  page.row("Nominal", model.u_nominal.size() > 0
                          ? fmt::format("trajectory of {}", plural(model.u_nominal.rows(), "step"))
                          : "none");
  if (model.has(&Step::has_lags)) page.row("Lag order", text(lag_orders(model)));
  if (const std::vector<double> condition = conditions(model); call.verbose && !condition.empty())
    page.row("Regressions",
             fmt::format("condition median {}, largest {}; {} of {} rank deficient", number(median(condition)),
                         number(largest(condition)), rank_deficient_steps(model), plural(model.steps(), "step")));
  if (call.verbose)
    page.row("Observer", fmt::format("median norm of {} successive closed-loop matrices {}", model.max_lags(),
                                     number(deadbeat_norm(model))));
  if (!noise_fields(model).empty()) page.row("Noise", fmt::format("{}", fmt::join(noise_fields(model), ", ")));
  if (const Index from = model.provenance.experiments; from > 0)
    page.row("Identified", "from " + plural(from, "experiment"));
  for (const auto& [label, text] : io::provenance_words(model.provenance)) page.row(label, text);
  return page.text();
}

// Controllers

Span state_dimensions(const Controller& c) {
  std::vector<Index> values;
  for (const Matrix& gain : c.K) values.push_back(gain.cols());
  return span(values);
}

Json weights_json(const std::vector<Matrix>& matrices) {
  Json list = Json::array();
  for (const Matrix& matrix : matrices) {
    Json rows = Json::array();
    for (Index i = 0; i < matrix.rows(); ++i) rows.push_back(numbers(matrix.row(i).transpose()));
    list.push_back(std::move(rows));
  }
  return list;
}

Json json(const InfoCall& call, const Controller& c) {
  const Span dims = state_dimensions(c);
  Json j;
  j["file"] = call.file.string();
  j["kind"] = "controller";
  j["model"] = c.model_name.empty() ? Json() : Json(c.model_name);
  j["system"] = fmt::format("{:016x}", c.system);
  j["inputs"] = c.u_nominal.cols();
  j["outputs"] = c.outputs;
  j["state_dim"] = {{"min", dims.least}, {"max", dims.most}};
  j["begin"] = c.begin;
  j["end"] = c.end();
  j["dt"] = c.dt;
  j["output_weight"] = weights_json(c.weights.output);
  j["input_weight"] = weights_json(c.weights.input);
  j["input_rate_weight"] = weights_json(c.weights.input_rate);
  j["terminal_weight"] = c.weights.terminal.size() > 0 ? weights_json({c.weights.terminal})[0] : Json();
  j["output_reference"] = c.y_reference.size() > 0;
  j["input_reference"] = c.u_reference.size() > 0;
  j["nominal"] = !c.u_nominal.isZero(0) || !c.y_nominal.isZero(0);
  j["expected_cost"] = c.predicted ? json_of(*c.predicted) : Json();
  j["presumes_zero_state"] = c.predicted ? Json(c.predicted->presumes_zero_state) : Json();
  return j;
}

std::string report(const InfoCall& call, const Controller& c) {
  Page page;
  page.row("Controller", call.file.string());
  page.row("", fmt::format("{}, {}, steps {} to {}, dt = {} s", plural(c.u_nominal.cols(), "input"),
                           plural(c.outputs, "output"), c.begin, c.end() - 1, number(c.dt)));
  page.row("Model", fmt::format("{}, state dimensions {}", c.model_name.empty() ? "without a name" : c.model_name,
                                text(state_dimensions(c))));
  add_weights_rows(page, c.weights);
  std::vector<std::string> references;
  if (c.y_reference.size() > 0) references.emplace_back("outputs");
  if (c.u_reference.size() > 0) references.emplace_back("inputs");
  page.row("Reference",
           references.empty() ? "none: the nominal trajectory" : fmt::format("{}", fmt::join(references, " and ")));
  if (c.predicted)
    add_cost_rows(page, *c.predicted, !c.weights.input_rate.empty(), std::nullopt);
  else
    page.row("Cost", "not stored");
  return page.text();
}

template <class Contained>
void show(const InfoCall& call, const Contained& contained) {
  if (call.json)
    print(json(call, contained));
  else
    print(report(call, contained));
}

// The options of ensembles have no effect on other files.
void refuse_options_of_ensembles(const InfoCall& call, const char* found) {
  const std::string given =
      words_of(call.read) + (call.page.empty() ? std::string() : " --picture " + word(call.page.string()));
  if (!given.empty())
    throw std::invalid_argument(
        fmt::format("{}: {} found, an ensemble needed with the options{}", call.file.string(), found, given));
}

void run_info(const InfoCall& call) {
  if (call.paths.size() == 1) {
    const FileKind kind = file_kind(call.file);
    if (kind != FileKind::ensemble)
      refuse_options_of_ensembles(call, kind == FileKind::model ? "a model" : "a controller");
    if (kind == FileKind::model) return show(call, load_model(call.file));
    if (kind == FileKind::controller) return show(call, load_controller(call.file));
  }
  if (!call.page.empty()) check_output(call.page, Content::page, call.paths);
  const Ensemble data = load_ensemble(call.paths, call.read);
  if (!call.page.empty()) save_text(picture_page(data, call.file.string()), call.page);
  Findings findings = remarks(data);
  append(findings, sample_remarks(data));
  if (call.json)
    print(json(call, data, findings));
  else
    print(report(call, data, findings));
  warn(findings);
}

}  // namespace

void add_info(CLI::App& tool) {
  const auto call = std::make_shared<InfoCall>();
  Command command(tool, "info", "What is in an ensemble, a model or a controller", "tokid info data.h5");
  command.data("FILE", call->paths, call->file,
               "Ensemble, model or controller; or many .csv: files, a folder, a pattern");
  command.columns(call->read);
  command.verbose(call->verbose);
  command.file("--picture", call->page, "Page to write with drawings of all channels of an ensemble: .html");
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_info(*call); });
}

}  // namespace tokid::app
