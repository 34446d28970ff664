// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/json.hpp"
#include "base/statistics.hpp"
#include "io/formats/provenance_words.hpp"
#include "model/comparison.hpp"
#include "report/assets.hpp"
#include "report/evidence.hpp"
#include "report/origin.hpp"
#include "report/page.hpp"
#include "report/report_data.hpp"
#include "report/selection.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace report {

namespace {

using Align = Table::Align;

std::string with_unit(const std::string& name, const std::vector<std::string>& units, Index i) {
  const size_t at = static_cast<size_t>(i);
  return at < units.size() && !units[at].empty() ? fmt::format("{} [{}]", name, units[at]) : name;
}

// Prevents line breaks within a range, and between a number and %.
std::string keep_together(std::string html) {
  const auto replace = [&html](std::string_view from, std::string_view to) {
    for (size_t i = 0; (i = html.find(from, i)) != std::string::npos; i += to.size()) html.replace(i, from.size(), to);
  };
  replace("–", "&#8288;–&#8288;");
  replace(" %", "&nbsp;%");
  return html;
}

// The same between a number and % in a text that is not HTML.
std::string unbroken(std::string text) {
  for (size_t i = 0; (i = text.find(" %", i)) != std::string::npos;) text.replace(i, 1, "\u00a0");
  return text;
}

std::string paragraph(std::string_view text, std::string_view css_class = "note") {
  return keep_together(element("p", text, css_class));
}

std::string list(const std::vector<std::string>& texts, std::string_view css_class) {
  std::string items;
  for (const std::string& text : texts) items += keep_together(element("li", text));
  return fmt::format("<ul class=\"{}\">\n{}</ul>\n", css_class, items);
}

// The status has a symbol (a tick, a lens or a cross), because some readers do not see its colour.
std::string status(Trust trust) {
  static constexpr const char* css_class[] = {"good", "look", "bad"};
  static constexpr const char* text[] = {"Good", "Look closer", "Don’t trust"};
  static constexpr const char* shape[] = {R"(<circle cx="12" cy="12" r="9"/><path d="m8 12.5 2.8 2.8L16.2 9.5"/>)",
                                          R"(<circle cx="10.5" cy="10.5" r="6.5"/><path d="m15.5 15.5 5 5"/>)",
                                          R"(<path d="M8 3h8l5 5v8l-5 5H8l-5-5V8z"/><path d="m9 9 6 6m0-6-6 6"/>)"};
  const size_t i = static_cast<size_t>(trust);
  return fmt::format("<p class=\"status {}\"><svg viewBox=\"0 0 24 24\" aria-hidden=\"true\">{}</svg>{}</p>\n",
                     css_class[i], shape[i], text[i]);
}

// "The table shows 12 of 30 outputs." for a table that is cut; empty for a whole one.
std::string cut_note(Index shown, Index all, std::string_view noun) {
  return shown < all ? paragraph(fmt::format("The table shows {} of {}.", shown, plural(all, noun))) : "";
}

std::string tile(std::string_view value, std::string_view label) {
  return fmt::format("<div class=\"tile\"><b>{}</b><span>{}</span></div>\n", keep_together(escape(value)),
                     escape(label));
}

std::string controls(std::string_view inner) { return fmt::format("<div class=\"controls\">{}</div>\n", inner); }
std::string choice(std::string_view id, std::string_view label) {
  return fmt::format("<label>{}<select id=\"{}\"></select></label>", escape(label), id);
}

// Makes the sections of the page from the evidence and the verdict.
class Report {
 public:
  // `identified`: the identification that has just made the model; null for a model from a file.
  Report(const Model& model, const Tested& tested, ModelComparison comparison, const Identification* identified)
      : model_(model),
        data_(tested.data),
        options_(tested.options),
        identified_(identified),
        found_(evidence(model, tested)),
        verdict_(verdict_of(model, found_, options_)),
        comparison_(std::move(comparison)),
        plots_(plot_data(model, data_, found_, verdict_, comparison_, options_)) {}

  const Verdict& verdict() const { return verdict_; }
  const Findings& findings() const { return found_.findings; }

  std::string html() const {
    Document page;
    page.title = options_.model_name.empty() ? "Identified model" : options_.model_name;
    page.kind =
        options_.data_name.empty() ? "Identification report" : "Identification report, tested on " + options_.data_name;
    page.links = {{"verdict", "Verdict"},
                  {"checks", "Checks"},
                  {"setup", "Setup"},
                  {"fit", "Fit"},
                  {"models", "Models"},
                  {"experiments", "Experiments"},
                  {"outputs", "Outputs"},
                  {"order", "Order"},
                  {"regressions", "Regressions"},
                  {"poles", "Eigenvalues"},
                  {"responses", "Responses"},
                  {"matrices", "Matrices"},
                  {"whiteness", "Whiteness"},
                  {"inputs", "Inputs"},
                  {"notes", "Notes"}};
    if (comparison_.models.empty()) std::erase_if(page.links, [](const Link& link) { return link.id == "models"; });
    page.body = verdict_section() + checks_section() + setup_section() + fit_section() + comparison_section() +
                experiments_section() + outputs_section() + order_section() + regression_section() + pole_section() +
                modes_section() + responses_section() + matrix_section() + whiteness_section() +
                input_correlation_section() + notes_section();
    page.data = plots_.json;
    page.script = assets::report_js();
    return document(page);
  }

 private:
  std::string evaluated_on() const {
    const std::string count = plural(found_.experiments, "experiment");
    switch (options_.evaluation) {
      case Evaluation::held_out:
        return count + " held out from the identification";
      case Evaluation::training:
        return count + ", the same that the model was identified from";
      default:
        return count + ", not recognised as those of the identification";
    }
  }

  std::string verdict_section() const {
    static constexpr const char* css_class[] = {"good", "look", "bad"};
    const Validation& v = found_.validation;
    std::string tiles = tile(percent_range(v.simulation.fit), "simulation fit") +
                        tile(percent_range(v.one_step.fit), "one-step prediction fit");
    if (verdict_.horizon > 0)
      tiles += tile(percent_range(found_.deciding.fit.fit),
                    fmt::format("fit {} ahead, which decides the verdict", plural(verdict_.horizon, "step")));
    static constexpr const char* whiteness[] = {"", "innovations without correlation",
                                                "innovations correlated in time, but only a little",
                                                "innovations correlated in time"};
    const TestResult white = found_.conclusions.whiteness.result;
    if (white != TestResult::untested)
      tiles += tile(probability(v.whiteness_p), whiteness[static_cast<size_t>(white)]);
    else
      tiles += tile("–", found_.noisy ? "whiteness: too few samples" : "innovations at rounding level");
    if (!std::isnan(v.squares.ratio))
      tiles += tile(figure(v.squares.ratio, 3), "squared innovations over their stated covariance; 1 is ideal");
    if (model_.has(&Step::has_condition))
      tiles += tile(figure(found_.condition_max, 3),
                    "largest condition number; median " + figure(found_.condition_median, 3));
    tiles += tile(fmt::format("{}", model_.states()), model_.states() == 1 ? "state" : "states");

    return fmt::format(
        "<section id=\"verdict\" class=\"verdict {}\" aria-label=\"Verdict\">\n{}{}{}<div "
        "class=\"tiles\">\n{}</div>\n{}</section>\n",
        css_class[static_cast<size_t>(verdict_.trust)], status(verdict_.trust), paragraph(verdict_.summary, "summary"),
        verdict_.reasons.empty() ? paragraph(no_reasons()) : list(verdict_.reasons, "reasons"), tiles, thresholds());
  }

  // The text for a model that no check speaks against.
  std::string no_reasons() const {
    const Conclusions& c = found_.conclusions;
    std::vector<std::string> small;
    for (const auto& [test, conclusion] :
         {std::pair{"their correlation in time", &c.whiteness},
          std::pair{"their correlation with the inputs", &c.independence},
          std::pair{"the effects of the inputs", &c.gains}, std::pair{"their size", &c.nis}})
      if (conclusion->result == TestResult::negligible) small.emplace_back(test);
    if (small.empty()) return "No check of this page speaks against the model.";
    return fmt::format(
        "No check speaks against the model. The innovations differ from those of an exact model by more than chance "
        "explains, but too little to matter: {}.",
        fmt::join(small, ", "));
  }

  // The rules behind the status. The checks have the bounds.
  std::string thresholds() const {
    std::vector<std::string> fits;  // the checks whose small figures lead to distrust
    for (const VerdictCheck& check : verdict_.checks)
      if (check.kind == VerdictCheck::Kind::one_step_fit || check.kind == VerdictCheck::Kind::simulation_fit ||
          check.kind == VerdictCheck::Kind::prediction_fit)
        fits.push_back(fmt::format("“{}”", in_words(check).subject));
    const std::string ahead =
        verdict_.horizon > 0
            ? ""
            : fmt::format(
                  " A simulation fit of 0 % or more is no reason for distrust if predictions {} ahead have a fit of "
                  "{:.0f} % or more. This exception does not apply if the inputs of the identification never vary.",
                  plural(found_.horizon, "step"), bounds::good_fit);
    const std::vector<std::string> rules = {
        fmt::format(
            "The fit of the simulation decides the status. There is one exception: with the noise that the model states, "
            "even the simulation of an exact model may be bad (fit below {:.0f} %, and errors above {:.2f} times those of "
            "one-step predictions). Then the fit of predictions decides, over as many steps as an exact model would "
            "predict well, up to 100.",
            bounds::expected_fit, bounds::like_one_step),
        "Good: the model passed every check that can be made. The table of the checks below shows each figure and its "
        "bound. A small fit passes if the noise that the model states explains it and cross-validation finds no better "
        "regression.",
        "Look closer: the model did not pass a check. The reasons above say why.",
        fits.empty()
            ? "Don’t trust: nothing was tested."
            : fmt::format(
                  "Don’t trust: {} is below {:.0f} %, or the model overflows, or the inputs never vary and the "
                  "fit is not good, or the effect of an input differs by more than {:.0f} % from that of the model. A "
                  "fit of {:.0f} % or more is no reason for distrust if its errors are at most {:.2f} times those of an "
                  "exact model with the noise that the model states.{}",
                  fmt::join(fits, " or "), bounds::poor_fit, 100 * bounds::false_effect, bounds::useless_fit,
                  bounds::as_expected, ahead)};
    return "<details class=\"note\"><summary>How the status is decided</summary>" + list(rules, "plain") +
           "<p><a href=\"#checks\">All checks with their figures and bounds</a></p></details>\n";
  }

  // The checks of the verdict as it decided them, with those that did not pass first.
  std::string checks_section() const {
    static constexpr const char* text[] = {"✓\u00a0passed", "!\u00a0look closer", "✗\u00a0don’t trust"};
    std::vector<const VerdictCheck*> order;
    for (const VerdictCheck& check : verdict_.checks) order.push_back(&check);
    const auto rank = [](const VerdictCheck* check) { return check->result ? -int(*check->result) : 1; };
    std::stable_sort(order.begin(), order.end(), [&](const auto* a, const auto* b) { return rank(a) < rank(b); });
    constexpr size_t longest = 240;
    Table table({{"Check", Align::text},
                 {"Result", Align::text},
                 {"Found", Align::text, longest},
                 {"Needed", Align::text, longest}},
                "Checks of the verdict", false);
    Index passed = 0, tested = 0;
    for (const VerdictCheck* check : order) {
      tested += check->result.has_value(), passed += check->result == Trust::good;
      const CheckWords words = in_words(*check);
      table.row({words.subject, check->result ? text[static_cast<size_t>(*check->result)] : "–\u00a0not tested",
                 unbroken(words.found), unbroken(words.needed)},
                check->result.value_or(Trust::good) == Trust::good ? "" : "mark");
    }
    const Index left_out = Index(order.size()) - tested;
    std::string summary = fmt::format("{} of {} passed", passed, plural(tested, "check"));
    if (left_out > 0)
      summary += fmt::format(". {} could not be made; {} why.", plural(left_out, "check"),
                             left_out == 1 ? "its row says" : "their rows say");
    else
      summary += ".";
    return section("checks", "Checks of the verdict", paragraph(summary) + table.html());
  }

  std::string setup_section() const {
    Facts data, model;
    if (!options_.data_name.empty()) data.row("File", options_.data_name);
    data.row("Evaluated on", evaluated_on());
    data.row("Steps", fmt::format("T = {}, {}", data_.steps(),
                                  data_.dt_stated ? fmt::format("dt = {:.6g} s", data_.dt) : "no sample time stated"));
    data.row("Inputs", channel_list(model_.inputs, true));
    data.row("Outputs", channel_list(model_.outputs, false));
    data.row("Missing samples", found_.missing == 0 ? "none" : fmt::format("{}", found_.missing));
    if (data_.free.experiments > 0) data.row("Free responses", fmt::format("{}", data_.free.experiments));
    data.row("Initial states", data_.initial_state ? to_string(*data_.initial_state) : "not stated with the data");

    if (!options_.model_name.empty()) model.row("File", options_.model_name);
    model.row("Method",
              fmt::format("{}, {} frame", model_.method.empty() ? "not stated" : model_.method, model_.frame));
    if (found_.identified_from > 0)
      model.row("Identified from",
                plural(found_.identified_from, "experiment") +
                    (found_.unknowns > 0 ? fmt::format(", for {} unknowns per output and step", found_.unknowns) : ""));
    model.row("Steps", fmt::format("{} to {}, all {} from {} to {}", model_.k_begin, model_.k_end() - 1,
                                   plural(model_.states(), "state"), model_.full_begin(), model_.full_end() - 1));
    model.row("Sample time", timed() ? fmt::format("{:.6g} s", model_.dt) : "not stated");
    if (found_.lags > 0) model.row("Lag order", fmt::format("p = {}", found_.lags));
    model.row("Initial states", to_string(model_.initial_state));
    if (const auto& feedthrough = model_.provenance.feedthrough) model.row("Feedthrough", in_words(*feedthrough));
    if (const auto& choices = model_.provenance.choices; choices)
      if (const std::vector<Index>& jumps = choices->variation.jumps; !jumps.empty())
        model.row("Jumps", fmt::format("the matrices jump at {} {}", jumps.size() > 1 ? "the steps" : "step",
                                       fmt::join(jumps, ", ")));
    model.row("Nominal trajectory", model_.y_nominal.rows() > 0 ? "removed before, added back after" : "none");
    for (const auto& [label, text] : io::provenance_words(model_.provenance)) model.row(label, text);
    if (const std::string& by = model_.provenance.version; !by.empty()) model.row("Made by", "tokid " + by);
    return section("setup", "Data and options",
                   fmt::format("<div class=\"two\"><div><h3>Data</h3>\n{}</div><div><h3>Model</h3>\n{}</div></div>\n",
                               data.html(), model.html()));
  }

  // Do times of the model mean seconds? The data of its identification may have stated no sample time.
  bool timed() const { return model_.provenance.dt_stated; }

  std::string channel_list(Index count, bool inputs) const {
    constexpr Index most = 40;
    std::vector<std::string> names;
    for (Index i = 0; i < std::min(count, most); ++i)
      names.push_back(inputs ? with_unit(found_.names.input(i), found_.names.input_units, i)
                             : with_unit(found_.names.output(i), found_.names.output_units, i));
    if (count > most) names.push_back(fmt::format("… ({} in all)", count));
    return fmt::format("{}", fmt::join(names, ", "));
  }

  std::string fit_section() const {
    const Validation& v = found_.validation;
    const DecidingHorizon& deciding = found_.deciding;
    std::vector<Table::Column> columns{{"Output", Align::text},
                                       {"Simulation"},
                                       {"One step"},
                                       {fmt::format("{} ahead", plural(found_.horizon, "step"))},
                                       {"RMS error, simulation"},
                                       {"RMS error, one step"}};
    if (verdict_.horizon > 0) {
      columns.push_back({fmt::format("Deciding: {} ahead", plural(verdict_.horizon, "step"))});
      columns.push_back({"Exact model: deciding"});
      columns.push_back({"Exact model: simulation"});
    }
    Table table(columns, "Fit and error of each output", false);
    for (Index j = 0; j < model_.outputs; ++j) {
      const auto unit = [&](double value) {
        const std::string text = figure(value);
        const auto& units = found_.names.output_units;
        return size_t(j) < units.size() && !units[size_t(j)].empty() && !std::isnan(value)
                   ? text + " " + units[size_t(j)]
                   : text;
      };
      std::vector<std::string> cells{with_unit(found_.names.output(j), {}, j),
                                     percent(v.simulation.fit(j), 1),
                                     percent(v.one_step.fit(j), 1),
                                     percent(v.horizon.fit(j), 1),
                                     unit(v.simulation.rmse(j)),
                                     unit(v.one_step.rmse(j))};
      if (verdict_.horizon > 0)
        for (const double fit : {deciding.fit.fit(j), deciding.expected(j), deciding.expected_simulation(j)})
          cells.push_back(percent(fit, 1));
      table.row(cells, deciding.fit.fit(j) < bounds::good_fit ? "mark" : "");
    }
    std::string text =
        "Simulation uses the inputs alone; predictions use the measured outputs up to the given number of "
        "steps before. 100 % means no error, 0 % means no better than ";
    text += model_.y_nominal.rows() > 0 ? "the nominal trajectory." : "the mean.";
    if (options_.first_step > 0) text += fmt::format(" The fits begin at step {}.", options_.first_step);
    if (verdict_.horizon > 0)
      text += fmt::format(
          " The model is evaluated by predictions {} ahead: with the noise that it states, the simulation of an exact model "
          "would be bad too, and its predictions over more steps would no longer be good.",
          plural(verdict_.horizon, "step"));
    return section("fit", "Fit per output", paragraph(text) + table.html());
  }

  std::string outputs_section() const {
    const std::string body =
        paragraph(
            "Measured, simulated and predicted outputs, and the errors of the last two. Drag across a plot to "
            "zoom into "
            "all "
            "plots over time, double-click or use the button to show all steps again. With the keyboard on a plot: "
            "arrows read the values, + and − zoom, Escape shows all steps.",
            "note scripted-only") +
        controls(
            "<div class=\"pair grow\"><label>Experiment<select id=\"experiment\"></select></label>"
            "<button type=\"button\" class=\"step\" id=\"previous\" aria-label=\"Previous experiment\">‹</button>"
            "<button type=\"button\" class=\"step\" id=\"next\" aria-label=\"Next experiment\">›</button></div>" +
            choice("output", "Output") + choice("input", "Input") +
            (model_.y_nominal.rows() > 0 ? choice("motion", "Shown") : "") +
            "<button type=\"button\" id=\"reset\" disabled>Show all steps</button>") +
        plot_place("outputs", "Measured, simulated and predicted output over the steps") +
        plot_place("errors", "Errors of simulation and prediction over the steps", "Errors") +
        plot_place("inputs", "Input over the steps", "Input");
    return section("outputs", "Outputs and inputs", body);
  }

  // The fits of all models over the same samples. The best simulation of each output is marked.
  std::string comparison_section() const {
    static constexpr const char* known[] = {"not recognised as those of its identification",
                                            "held out from its identification", "those of its identification",
                                            "in part those of its identification"};
    if (comparison_.models.empty()) return "";
    constexpr Index most_outputs = 24, most_rows = 600;
    const Index most = std::clamp<Index>(most_rows / Index(comparison_.models.size()), 1, most_outputs);
    const Index shown = std::min(most, model_.outputs);
    Table models({{"Model", Align::text}, {"States"}, {"Tested experiments", Align::text}}, "Models", false);
    for (const ComparedModel& one : comparison_.models)
      models.row({words::quoted(one.name), fmt::format("{}", one.states), known[static_cast<size_t>(one.known)]});
    Table table({{"Output", Align::text},
                 {"Model", Align::text},
                 {"Simulation"},
                 {"One step"},
                 {fmt::format("{} ahead", plural(comparison_.horizon, "step"))},
                 {"Choice", Align::text}},
                "Fits of all models", false);
    for (Index j = 0; j < shown; ++j) {
      double best = -std::numeric_limits<double>::infinity();
      for (const ComparedModel& one : comparison_.models) best = std::fmax(best, one.simulation.fit(j));
      for (const ComparedModel& one : comparison_.models) {
        const bool is_best = one.simulation.fit(j) == best;
        table.row({found_.names.output(j), words::quoted(one.name), percent(one.simulation.fit(j), 1),
                   percent(one.one_step.fit(j), 1), percent(one.ahead.fit(j), 1), is_best ? "best simulation" : ""},
                  is_best ? "chosen" : "");
      }
    }
    return section(
        "models", "Comparison of models",
        paragraph(fmt::format(
            "Fits from step {} on, over the samples that every model computes, so that they can be compared. "
            "They can differ from the fits above, which begin where this model begins. A fit on the "
            "experiments of a model's own identification is better than on new data.",
            comparison_.from)) +
            without_fits() + models.html() + table.html() + cut_note(shown, model_.outputs, "output"));
  }

  // Names the compared models that compute no sample of a kind, so that the others are compared without them.
  std::string without_fits() const {
    std::vector<std::string> lines;
    for (const auto& [kind, outputs] :
         {std::pair{&ComparedModel::simulation, std::string("simulated")},
          std::pair{&ComparedModel::one_step, std::string("predicted one step ahead")},
          std::pair{&ComparedModel::ahead, fmt::format("predicted {} ahead", plural(comparison_.horizon, "step"))}}) {
      std::vector<std::string> names;
      for (const ComparedModel& one : comparison_.models)
        if ((one.*kind).samples == 0) names.push_back(words::quoted(one.name));
      if (!names.empty()) lines.push_back(fmt::format("Not every output is {} by {}.", outputs, words::listed(names)));
    }
    return lines.empty() ? "" : list(lines, "plain");
  }

  // All experiments, the worst first. The table has the worst ones, and those that a test marks.
  std::string experiments_section() const {
    constexpr size_t most_worst = 12, most_rows = 40;
    const std::vector<Index> outlying = outlying_samples(found_);
    const ExperimentFits& fits = found_.fits;
    size_t listed = 0, marked = 0;
    Table table({{"Experiment", Align::text}, {"Simulation"}, {"One step"}, {"Error / limit"}, {"Marked", Align::text}},
                "RMS errors relative to the spread of the outputs", false);
    for (size_t i = 0; i < fits.worst_first.size(); ++i) {
      const Index n = fits.worst_first[i];
      std::vector<std::string> marks;
      if (fits.outlying(n)) marks.emplace_back("outlying error");
      if (outlying[size_t(n)] > 0) marks.push_back(plural(outlying[size_t(n)], "outlying sample"));
      marked += !marks.empty();
      if (listed == most_rows || (i >= most_worst && marks.empty())) continue;
      ++listed;
      table.row(
          {"Experiment " + found_.experiment(n), figure(fits.simulation_error(n), 3), figure(fits.one_step_error(n), 3),
           figure(fits.excess(n), 3), fmt::format("{}", fmt::join(marks, ", "))},
          marks.empty() ? "" : "mark");
    }
    const std::string about = fmt::format(
        "RMS errors of each experiment, relative to the spread of the outputs. The limit of an error is {:.0f} times its "
        "median over the experiments, and at least {:.0f} % of the spread. The experiments are in the order of their "
        "larger error over its limit. Those above a limit are marked, and those with single outlying samples. {}",
        outlying_experiment, 100 * least_outlying_error,
        marked == 0 ? "None is marked."
                    : fmt::format("{} of {} marked.", marked, plural(found_.experiments, "experiment")));
    return section("experiments", "All experiments",
                   paragraph(about) + plot_place("experiments", "Errors of all experiments, the largest first") +
                       fmt::format("<details><summary>As a table: {} of {}</summary>\n{}</details>\n", listed,
                                   plural(found_.experiments, "experiment"), table.html()));
  }

  // The candidates are known to the identification alone: a model's file has only what was chosen.
  std::string candidates() const {
    if (!identified_)
      return paragraph(
          "The errors of the other candidates for lag order, λ and number of states are on the page that tokid identify "
          "--report writes. A model's file has only those that were chosen.");
    const std::string tables = selection_tables(*identified_);
    return "<h3>Candidates</h3>\n" +
           (tables.empty() ? paragraph("The lag order and the number of states were given, or follow from the rank of "
                                       "the data. No other candidates were compared.")
                           : tables);
  }

  std::string order_section() const {
    if (!model_.has(&Step::has_singular_values))
      return section("order", "Order", paragraph("The model has no singular values: it was not identified by tokid."));
    return section(
        "order", "Singular values and order",
        paragraph(
            "Singular values of the Hankel matrix of each step: their sizes say how strongly the past affects the "
            "future. The line "
            "is the number of states in use; if the brightness falls strongly at the line, the order is clear.") +
            plot_place(
                "order",
                "Heat map of the singular values of the Hankel matrix over the steps, with the number of states") +
            order_table() + candidates());
  }

  std::string order_table() const {
    const Index n = model_.states();
    // size: singular values σ_i / σ_1; fall: σ_i / σ_{i+1}. Both are collected at the steps of full dimension. No
    // ratios of rounding errors are collected.
    std::vector<std::vector<double>> size, fall;
    for (Index k = model_.full_begin(); n > 0 && k < std::min(model_.full_end(), model_.k_end()); ++k) {
      const Vector& s = model_.at(k).singular_values();
      if (s.size() == 0 || !(s(0) > 0)) continue;
      size.resize(std::max(size.size(), size_t(s.size())));
      fall.resize(size.size());
      for (Index i = 0; i < s.size(); ++i) size[size_t(i)].push_back(s(i) / s(0));
      for (Index i = 0; i + 1 < s.size() && s(i) > 1e-12 * s(0); ++i)
        fall[size_t(i)].push_back(s(i) / std::max(s(i + 1), 1e-16 * s(0)));
    }
    Facts facts;
    facts.row("States", fmt::format("{}", n));
    if (size.size() >= size_t(n) && n > 0)
      facts.row("Last one kept", figure(finite_median(size[size_t(n - 1)]), 3) + " of the largest, median over steps");
    if (size.size() > size_t(n) && n > 0)
      facts.row("First one dropped", figure(finite_median(size[size_t(n)]), 3) + " of the largest");
    std::vector<double> falls;
    falls.reserve(fall.size());
    for (const auto& values : fall) falls.push_back(values.empty() ? 0.0 : finite_median(values));
    // A window can determine only a limited number of states. Above this number, singular values fall to rounding level
    // for any system. A fall to rounding level is therefore ignored.
    const auto informative = [&](size_t i) { return i + 1 < size.size() && finite_median(size[i + 1]) > 1e-12; };
    size_t clearest = 0;
    for (size_t i = 0; i < falls.size(); ++i)
      if (informative(i) && (!informative(clearest) || falls[i] > falls[clearest])) clearest = i;
    if (found_.noisy && clearest < falls.size() && informative(clearest))
      facts.row("Largest fall", fmt::format("by {} after singular value {}", figure(falls[clearest], 3), clearest + 1));
    return facts.html();
  }

  std::string regression_section() const {
    if (!model_.has(&Step::has_condition) && !model_.has(&Step::has_rank))
      return section("regressions", "Regressions", paragraph("The model has no diagnostics of its identification."));
    return section(
        "regressions", "Regressions",
        paragraph(
            "Every step has a regression of its own. Its condition number states how much noise and rounding errors "
            "may be magnified; with full rank, the data determine all of its unknowns.") +
            plot_place("condition", "Condition number of the regression of each step", "Condition number") +
            plot_place("rank", "Rank, number of unknowns and lag order of each step", "Rank, unknowns, lag order") +
            plot_place("step", "Relative one-step error of each step over the experiments", "One-step error") +
            worst_steps());
  }

  // A table of the steps with the worst regressions, for readers without plots.
  std::string worst_steps() const {
    const bool condition = model_.has(&Step::has_condition), lags = model_.has(&Step::has_lags),
               rank = model_.has(&Step::has_rank);
    // A measure of how bad a regression is: its condition number or, if this is missing, its rank deficiency. Steps
    // with unknown values come last.
    const auto badness = [&](Index k) {
      const double value = condition ? model_.at(k).condition() : double(unknowns(model_, k) - model_.at(k).rank());
      return std::isnan(value) ? -std::numeric_limits<double>::infinity() : value;
    };
    std::vector<Index> order;
    for (Index k = model_.k_begin; k < model_.k_end(); ++k) order.push_back(k);
    const size_t count = std::min<size_t>(10, order.size());
    std::partial_sort(order.begin(), order.begin() + std::ptrdiff_t(count), order.end(),
                      [&](Index a, Index b) { return std::pair(-badness(a), a) < std::pair(-badness(b), b); });
    std::vector<Table::Column> columns{{"Step"},      {"Condition"}, {"Rank"},          {"Unknowns"},
                                       {"Lag order"}, {"States"},    {"One-step error"}};
    if (timed()) columns.insert(columns.begin() + 1, {"Time [s]"});
    Table table(columns, fmt::format("{} of {}, {}", count, plural(model_.steps(), "step"),
                                     condition ? "the worst conditioned first"
                                     : lags    ? "those first whose rank lacks most"
                                               : "those of lowest rank first"));
    for (size_t i = 0; i < count; ++i) {
      const Index k = order[i];
      const size_t s = model_.index(k);
      std::vector<std::string> cells{fmt::format("{}", k),
                                     condition ? figure(model_.step[s].condition()) : "–",
                                     rank ? fmt::format("{}", model_.step[s].rank()) : "–",
                                     lags ? fmt::format("{}", unknowns(model_, k)) : "–",
                                     lags ? fmt::format("{}", model_.step[s].lags()) : "–",
                                     fmt::format("{}", model_.n(k)),
                                     k < data_.steps() ? figure(found_.step_error[size_t(k)]) : "–"};
      if (timed()) cells.insert(cells.begin() + 1, figure(double(k) * model_.dt, 6));
      table.row(cells, std::binary_search(found_.ill.begin(), found_.ill.end(), k) ? "mark" : "");
    }
    return table.html();
  }

  std::string frame_text() const {
    const Framed& frame = plots_.frame;
    if (frame.name == "reference")
      return fmt::format(
          "in the reference frame of step {}, in which the states of all steps are measured by the same "
          "combinations of outputs",
          frame.reference_step);
    return "in the smooth frame, in which the coordinates of each step are turned to be as close to those before as "
           "they "
           "can; the reference frame does not reach far enough here";
  }

  std::string pole_section() const {
    if (plots_.radius.empty())
      return section("poles", "Eigenvalues",
                     paragraph(model_.states() == 0 ? "The model has no states, and so no eigenvalues."
                                                    : "No step has as many states before as after it: there are no "
                                                      "eigenvalues."));
    std::string body =
        paragraph(fmt::format("Eigenvalues of A (open loop) and of A + GC (with the observer), {}. Those of one step "
                              "say what that step does to "
                              "the state; in a time varying system they do not decide stability by themselves. All "
                              "steps are faint, the chosen "
                              "one is strong.",
                              frame_text()));
    body += controls(
        "<label class=\"grow\"><span id=\"pole-label\">Step</span><input type=\"range\" id=\"pole-step\" min=\"0\" "
        "max=\"0\" value=\"0\" aria-label=\"Step of the eigenvalues\"></label>"
        "<button type=\"button\" id=\"pole-play\">Play</button>");
    body += "<div class=\"two\"><div>" + plot_place("poles", "Eigenvalues in the complex plane with the unit circle") +
            "</div>\n<div>" +
            plot_place("radius", "Largest magnitude of the eigenvalues over the steps", "Largest magnitude") +
            pole_table() + "</div></div>\n";
    return section("poles", "Eigenvalues", body);
  }

  std::string pole_table() const {
    const auto& radius = plots_.radius;
    const auto [least, most] = std::minmax_element(radius.begin(), radius.end(),
                                                   [](const Radius& a, const Radius& b) { return a.open < b.open; });
    double closed = 0.0;
    for (const Radius& r : radius) closed = std::max(closed, r.closed);
    const Index outside = std::count_if(radius.begin(), radius.end(), [](const Radius& r) { return r.open > 1; });
    Facts facts;
    facts.row("Largest of A",
              fmt::format("{:.4g} (step {}) to {:.4g} (step {})", least->open, least->k, most->open, most->k));
    facts.row("A outside the circle", fmt::format("at {} of {}", outside, plural(Index(radius.size()), "step")));
    facts.row("Largest of A + GC", figure(closed));
    return facts.html();
  }

  std::string modes_section() const {
    if (!plots_.modes)
      return section("modes", "Modes over time",
                     paragraph(model_.states() == 0 ? "The model has no states, and so no modes."
                                                    : "The model has too few steps for modes with the time frozen."));
    const Modes& modes = *plots_.modes;
    const std::string text = fmt::format(
        "Natural frequencies and damping ratios with the time frozen, in coordinates that the outputs of {} steps define. "
        "A mode is valid at a step if it varies by at most {:.3g} while it turns by one radian, and is the same in another "
        "window of outputs. Where it is not valid, its curve is faint and means little. "
        "<code>tokid modes --confidence</code> gives intervals.",
        modes.window, modes.slow);
    return section("modes", "Modes over time",
                   "<p>" + text + "</p>\n" + "<div class=\"two\"><div>" +
                       plot_place("frequency", "Natural frequencies of the modes over the steps",
                                  timed() ? "Natural frequency [rad/s]" : "Natural frequency [rad per step]") +
                       "</div>\n<div>" +
                       plot_place("damping", "Damping ratios of the modes over the steps", "Damping ratio") +
                       "</div></div>\n" + mode_table());
  }

  // The median over the steps at which a mode is valid.
  std::string mode_table() const {
    constexpr Index most = 12;
    const Modes& modes = *plots_.modes;
    const Matrix frequency = natural_frequencies(modes), damping = damping_ratios(modes);
    Table table({{"Mode"},
                 {timed() ? "Frequency [rad/s]" : "Frequency [rad per step]"},
                 {timed() ? "Frequency [Hz]" : "Frequency [per step]"},
                 {"Damping ratio"},
                 {"Valid steps"}},
                fmt::format("Medians over the valid ones of {}", plural(modes.steps(), "step")));
    for (Index i = 0; i < std::min(most, modes.count()); ++i) {
      std::vector<double> frequencies, dampings;
      Index leading = 0;
      for (Index k = 0; k < modes.steps(); ++k) {
        if (!modes.leads(k, i)) continue;
        ++leading;
        if (!modes.valid(k, i)) continue;
        frequencies.push_back(frequency(k, i));
        dampings.push_back(damping(k, i));
      }
      if (leading == 0) continue;
      const Index valid = Index(frequencies.size());
      const double middle = statistics::median(std::move(frequencies));
      table.row({fmt::format("{}", i + 1), figure(middle, 3), figure(middle / (2 * std::numbers::pi), 3),
                 figure(statistics::median(std::move(dampings)), 3), fmt::format("{}", valid)});
    }
    return fmt::format("<details><summary>As a table</summary>\n{}</details>\n", table.html());
  }

  std::string responses_section() const {
    if (model_.inputs == 0) return section("responses", "Responses", paragraph("The model has no inputs."));
    std::string body = paragraph(
        "Outputs after a pulse (1 at a single step) or a step (1 from there on) of one input, from a zero state and without the "
        "nominal trajectory. The response depends on when the input acts: the chosen time is strong, the others are "
        "faint.");
    body += controls(choice("response-input", "Input") + choice("response-output", "Output") +
                     choice("response-start", "Input acts from"));
    body += "<div class=\"two\"><div>" + plot_place("pulse", "Pulse response", "Pulse response") + "</div>\n<div>" +
            plot_place("step-response", "Step response", "Step response") + "</div></div>\n";
    if (const std::optional<ResponseBands>& bands = options_.bands)
      body += paragraph(
          fmt::format("Each value lies in its band with {:.4g} % probability (pointwise). The bands come from {} of "
                      "a bootstrap over the experiments of the identification. Those of the frozen frequency response "
                      "leave out the error of freezing the time.",
                      100 * bands->level, plural(bands->replicates, "replicate")));
    else
      body += paragraph(
          "The responses have no confidence bands: these need the experiments of the identification. "
          "tokid report … --bands TRAINING computes them.");
    return section("responses", "Responses", body + response_table() + frozen_text());
  }

  // The largest values, for readers without plots.
  std::string response_table() const {
    constexpr Index most = 12;
    const std::vector<Index> starts = response_starts(model_, options_.at);
    const Index start = starts[starts.size() / 2];
    const Responses found = responses(model_, {start}, response_length(model_));
    Table table({{"Output", Align::text},
                 {"Input", Align::text},
                 {"Largest pulse response"},
                 {"Steps later"},
                 {"Last step response"}},
                fmt::format("Inputs that act from step {} on, outputs of the {} from there", start,
                            plural(found.length, "step")));
    for (Index i = 0; i < std::min(most, model_.inputs); ++i)
      for (Index j = 0; j < std::min(most, model_.outputs); ++j) {
        const Vector pulse = found.pulse.front().col(j + model_.outputs * i);
        Index peak = 0;
        for (Index k = 0; k < pulse.size(); ++k)
          if (std::abs(pulse(k)) > std::abs(pulse(peak))) peak = k;
        table.row({found_.names.output(j), found_.names.input(i), figure(pulse(peak), 3), fmt::format("{}", peak),
                   figure(found.step.front()(found.length - 1, j + model_.outputs * i), 3)});
      }
    return fmt::format("<details><summary>As a table</summary>\n{}{}{}</details>\n", table.html(),
                       cut_note(std::min(most, model_.inputs), model_.inputs, "input"),
                       cut_note(std::min(most, model_.outputs), model_.outputs, "output"));
  }

  // The chosen steps at which a mode is not valid.
  std::string without_frozen() const {
    const std::vector<Index>& left_out = plots_.frozen.left_out;
    return left_out.empty() ? "the outputs do not determine the states at the chosen steps"
                            : fmt::format("{}, where a mode is not valid", step_list(left_out));
  }

  std::string frozen_text() const {
    const FrozenResponses& frozen = plots_.frozen;
    const std::string heading = "<h3>Frozen frequency response</h3>\n";
    if (model_.states() == 0)
      return heading + paragraph("The model has no states: its outputs follow the inputs at once.");
    if (!plots_.modes)
      return heading + paragraph("Not shown: the model has too few steps for modes with the time frozen.");
    if (frozen.slow > 0 && frozen.steps.empty())
      return heading + paragraph(fmt::format("Not shown: {}.", without_frozen()));
    if (frozen.steps.empty())
      return heading +
             paragraph(fmt::format(
                 "Not shown: at each of the {} with modes, a mode varies by more than {:.3g} while it turns by one radian, "
                 "depends on the window of outputs, or is too fast for the samples. A frequency response with the time "
                 "frozen would mean little. The responses above are exact.",
                 plural(frozen.all, "step"), frozen.limit));
    return heading +
           paragraph(fmt::format(
               "Frequency response of the matrices of one step. It is shown for {} of {}, where every mode varies by at "
               "most {:.3g} while it turns by one radian, and is the same in another window of outputs. "
               "{}",
               frozen.slow, plural(frozen.all, "step"), frozen.limit,
               frozen.left_out.empty() ? std::string("One of the steps below can be chosen.")
                                       : fmt::format("Not shown: {}.", without_frozen()))) +
           controls(choice("frozen-step", "Frozen at")) + "<div class=\"two\"><div>" +
           plot_place("magnitude", "Magnitude of the frozen frequency response", "Magnitude") + "</div>\n<div>" +
           plot_place("phase", "Phase of the frozen frequency response", "Phase [degrees]") + "</div></div>\n";
  }

  std::string matrix_section() const {
    if (model_.states() == 0)
      return section("matrices", "Gain history and A",
                     paragraph("The model has no states: neither gains nor A, the outputs follow the inputs at once."));
    return section(
        "matrices", "Gain history and A",
        paragraph(fmt::format("The plots show the gains {}, and the entries of A in the smooth frame, whose "
                              "coordinates vary slowly from step to step. A system that varies smoothly has smooth "
                              "curves; scatter around them comes from noise.",
                              frame_text())) +
            controls(choice("gain-row", "Rows of G") + choice("a-row", "Rows of A")) +
            plot_place("gain", "Entries of the observer gain over the steps", "Observer gain G") +
            plot_place("a", "Entries of A over the steps in the smooth frame", "A, smooth frame") +
            "<p class=\"note unscripted\">The matrices themselves are in the model's file.</p>\n");
  }

  // The text on the size of the innovations. With 20 or more experiments, the test assumes only that the experiments
  // are independent.
  std::string squares_text() const {
    const NormalisedSquares& s = found_.validation.squares;
    const std::string text = in_words(found_.conclusions.nis) + ".";
    if (std::isnan(s.p)) return text;
    return text + (s.normal ? " The test assumes normal noise."
                            : " The test assumes only that the experiments are independent.");
  }

  std::string whiteness_section() const {
    const Validation& v = found_.validation;
    const Conclusions& c = found_.conclusions;
    const std::string about =
        "The innovations of a correct observer are not correlated in time. The plot shows the correlation of each "
        "output's innovations with those some steps before, over the experiments, averaged over the steps.";
    if (std::isnan(v.whiteness_p))
      return section("whiteness", "Whiteness of the innovations",
                     paragraph(about) + paragraph(in_words(c.whiteness) + ".", "lead"));
    std::vector<Table::Column> columns{{"Lag"}, {"99 % bound"}};
    constexpr Index most = 12;
    for (Index j = 0; j < std::min(most, model_.outputs); ++j) columns.push_back({found_.names.output(j)});
    Table table(columns, "Correlation of the innovations with those some steps before");
    for (Index lag = 1; lag <= v.whiteness.correlation.rows(); ++lag) {
      std::vector<std::string> cells{fmt::format("{}", lag), fmt::format("{:.3f}", v.whiteness.bound(lag - 1))};
      for (Index j = 0; j < std::min(most, model_.outputs); ++j)
        cells.push_back(std::isnan(v.whiteness.correlation(lag - 1, j))
                            ? "–"
                            : fmt::format("{:.3f}", v.whiteness.correlation(lag - 1, j)));
      table.row(cells);
    }
    return section("whiteness", "Whiteness of the innovations",
                   paragraph(about) + paragraph(in_words(c.whiteness) + ".", "lead") +
                       list({fmt::format("Size: {}", squares_text()),
                             fmt::format("Effects of the inputs: {}.", in_words(c.gains))},
                            "plain") +
                       plot_place("whiteness", "Correlation of the innovations over the lag, with its bounds") +
                       fmt::format("<details><summary>As a table</summary>\n{}{}</details>\n", table.html(),
                                   cut_note(std::min(most, model_.outputs), model_.outputs, "output")));
  }

  std::string input_correlation_section() const {
    const InputCorrelation& found = found_.input_correlation;
    const Conclusions& c = found_.conclusions;
    const std::string about = fmt::format(
        "Correlation of each output's innovations with an input some steps before, over the experiments, averaged over "
        "the steps. From lag {} on, a correlation means that the model misses a part of the response. At smaller lags, "
        "the input follows the output: feedback, which is no fault of the model. If nothing is correlated, 99 % of the "
        "points are within the bounds.",
        has_feedthrough(model_.provenance) ? 0 : 1);
    if (found.over == Pooling::none || model_.inputs == 0)
      return section("inputs", "Innovations and inputs",
                     paragraph(about) + paragraph(in_words(c.independence) + ".", "lead"));
    constexpr Index most = 12;
    const Index shown = std::min(most, model_.inputs);
    std::vector<Table::Column> columns{{"Lag"}};
    for (Index i = 0; i < shown; ++i) columns.push_back({found_.names.input(i)}), columns.push_back({"99 % bound"});
    Table table(columns, "Largest correlation of an output's innovations with each input");
    for (size_t lag = 0; lag < found.correlation.size(); ++lag) {
      const Index at = found.first + Index(lag);
      std::vector<std::string> cells{fmt::format("{}{}", at < 0 ? "−" : "", std::abs(at))};
      for (Index i = 0; i < shown; ++i) {
        double largest = 0.0;
        for (const double value : found.correlation[lag].col(i))
          if (!(std::abs(value) < std::abs(largest))) largest = value;
        for (const double value : {largest, found.bound(Index(lag), i)})
          cells.push_back(std::isnan(value) ? "–" : fmt::format("{:.3f}", value));
      }
      table.row(cells);
    }
    return section(
        "inputs", "Innovations and inputs",
        paragraph(about) +
            list({fmt::format("Past and present inputs: {}.", in_words(c.independence)),
                  fmt::format("Later inputs: {}.", in_words(c.feedback))},
                 "plain") +
            controls(choice("correlated-input", "Input")) +
            plot_place("inputs-lags", "Correlation of the innovations with an input over the lag, with its bounds") +
            fmt::format("<details><summary>As a table</summary>\n{}{}</details>\n", table.html(),
                        cut_note(shown, model_.inputs, "input")));
  }

  std::string notes_section() const {
    std::string body = "<h3>Warnings</h3>\n";
    body += found_.findings.empty() ? paragraph("None.") : list(in_words(found_.findings), "plain");
    body += "<h3>What the plots leave out</h3>\n";
    body += plots_.omitted.empty() ? paragraph("Nothing: every sample of every experiment is on this page.")
                                   : list(plots_.omitted, "plain");
    body += "<h3>How the figures are defined</h3>\n";
    body += list(
        {"Fit: 100 · (1 − ‖y − ŷ‖ / ‖y − ȳ‖) %, over all experiments and steps that have both; ȳ is the nominal "
         "trajectory where the model has one, else the mean.",
         "One-step error of a step: root mean square over experiments and outputs, each relative to the spread of its "
         "output.",
         "Condition: of the regressors of a step with columns scaled to norm 1, in Frobenius norms, of the part of "
         "full rank.",
         fmt::format(
             "Whiteness p: the chance of innovations as correlated over {} lags if they were white (Pillai's "
             "traces over the experiments, or where these are too few over all steps together). The test of the "
             "inputs uses the same method for the correlation with "
             "inputs. A p below {} counts as beyond chance. Steps are counted from 0.",
             test_lags, unlikely),
         "Effects of the inputs: by how much more or less the outputs respond to each input than in the model, by "
         "least "
         "squares from the innovations, with its 99 % interval.",
         "Size of the innovations: the mean of εᵀS⁻¹ε over its number of outputs, S being the covariance that the "
         "model states. After missing outputs and unknown initial states, ε is what the best observer of this model "
         "leaves."},
        "plain");
    return section("notes", "Warnings and notes", body);
  }

  const Model& model_;
  const Ensemble& data_;
  const ReportOptions& options_;
  const Identification* identified_;
  Evidence found_;
  Verdict verdict_;
  ModelComparison comparison_;
  Plots plots_;
};

}  // namespace

}  // namespace report

namespace {

// `whole`: the data that were given, of which `tested` has a part.
ReportPage page_of(const Model& model, const Ensemble& whole, const report::Tested& tested,
                   const Identification* identified) {
  const report::Report report(model, tested, report::compare_models(model, whole, tested), identified);
  return {report.verdict(), report.html(), report.findings()};
}

}  // namespace

ReportPage identification_page(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
                               ReportOptions options) {
  return page_of(result.model, data, report::tested(result, data, identified, std::move(options)), &result);
}

ReportPage report_page(const Model& model, const Ensemble& data, const ReportOptions& options) {
  return page_of(model, data, report::tested(model, data, options), nullptr);
}

}  // namespace tokid
