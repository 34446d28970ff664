// tokid modes: natural frequencies and damping ratios of a model over time.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "command.hpp"
#include "common.hpp"
#include "model/continuation.hpp"

namespace tokid::app {

namespace {

struct ModesCall {
  fs::path model, output, data;
  std::vector<Index> at;  // steps; empty: some steps of the model
  ModesOptions options;
  ConfidenceOptions confidence;
  bool json = false;
};

constexpr Index shown_steps = 5;  // steps of the printed table, unless the user states steps

constexpr double inexact = 1e-10;  // errors by rounding of multipliers that are worth a line

double time(const Modes& modes, Index k) { return double(modes.begin + k) * modes.dt; }

struct Table {
  Modes modes;
  Matrix frequency, damping;
  std::optional<ModeBounds> bounds;
};

// Rows of the table: the stated steps, or steps at even distances.
std::vector<Index> rows_of(const ModesCall& call, const Modes& modes) {
  std::vector<Index> result;
  for (const Index step : call.at) {
    if (step < modes.begin || step >= modes.begin + modes.steps())
      throw std::invalid_argument(
          fmt::format("--at: {} found, {} to {} needed: modes need the outputs of {} steps around a step", step,
                      modes.begin, modes.begin + modes.steps() - 1, modes.window));
    result.push_back(step - modes.begin);
  }
  if (!result.empty()) return result;
  const Index last = modes.steps() - 1, rows = std::min(shown_steps, modes.steps());
  for (Index i = 0; i < rows; ++i) result.push_back(rows > 1 ? i * last / (rows - 1) : 0);
  return result;
}

std::string with_width(double value, const Interval* interval, Index k, Index i, double factor) {
  if (!interval) return number(value * factor);
  // Limits of the interval, as of a damping ratio at 1, make the sides unequal.
  const double width = std::max(interval->upper(k, i) - value, value - interval->lower(k, i));
  return fmt::format("{} ± {}", number(value * factor), number(width * factor));
}

bool repeats(const Model& model) { return model.period > 1 && goes_on(model); }

void floquet_rows(Page& page, const Model& model, const Table& t) {
  const Floquet found = floquet(model);
  const Interval* rate = t.bounds ? &t.bounds->exponents_real : nullptr;
  const Interval* turn = t.bounds ? &t.bounds->exponents_imag : nullptr;
  std::vector<std::string> sizes, angles, rates, errors;
  const double period = double(model.period) * model.dt;
  for (Index i = 0; i < found.multipliers.size(); ++i) {
    sizes.push_back(number(std::abs(found.multipliers(i))));
    angles.push_back(with_width(found.exponents(i).imag(), turn, i, 0, period));
    rates.push_back(with_width(found.exponents(i).real(), rate, i, 0, 1.0));
    errors.push_back(number(found.error(i)));
  }
  page.row("Floquet", fmt::format("sizes of the multipliers over {} steps: {}", model.period, fmt::join(sizes, ", ")));
  page.row("", fmt::format("arguments of the multipliers [rad]: {}", fmt::join(angles, ", ")));
  page.row("", fmt::format("rates of growth [1/s]: {}", fmt::join(rates, ", ")));
  if (found.error.maxCoeff() > inexact)
    page.row("", fmt::format("relative errors of the multipliers by rounding: {}", fmt::join(errors, ", ")));
}

std::string report(const ModesCall& call, const Model& model, const Table& t) {
  const Modes& modes = t.modes;
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Modes", fmt::format("with the time frozen at steps {} to {}, from the outputs of {} steps", modes.begin,
                                modes.begin + modes.steps() - 1, modes.window));
  if (t.bounds)
    page.row("", fmt::format("± {} % intervals, by {}", number(100 * t.bounds->level),
                             plural(t.bounds->replicates, "bootstrap replicate")));
  const Interval* frequency = t.bounds ? &t.bounds->frequency : nullptr;
  const Interval* damping = t.bounds ? &t.bounds->damping : nullptr;
  std::vector<std::vector<std::string>> rows{
      {"step", "time [s]", "mode", "rad/s", "Hz", "damping", "variation", "valid"}};
  for (const Index k : rows_of(call, modes))
    for (Index i = 0; i < modes.count(); ++i) {
      if (!modes.leads(k, i)) continue;
      rows.push_back({std::to_string(modes.begin + k), fmt::format("{:.6g}", time(modes, k)), std::to_string(i + 1),
                      with_width(t.frequency(k, i), frequency, k, i, 1.0),
                      with_width(t.frequency(k, i), frequency, k, i, 0.5 / std::numbers::pi),
                      with_width(t.damping(k, i), damping, k, i, 1.0), number(modes.variation(k, i)),
                      modes.valid(k, i) ? "yes" : "no"});
    }
  page.table(rows);
  Index valid = 0, all = 0, unknown = 0;
  for (Index k = 0; k < modes.steps(); ++k)
    for (Index i = 0; i < modes.count(); ++i) {
      unknown += i == 0 && std::isnan(modes.poles(k, i).real());
      if (!modes.leads(k, i)) continue;
      ++all;
      valid += modes.valid(k, i);
    }
  page.row("Valid", fmt::format("{} of {} pairs of step and mode: they vary by at most {} while the mode turns by "
                                "one radian",
                                valid, all, number(modes.slow)));
  if (t.bounds) page.row("", "± of damping includes the variation: the error of freezing is about as large");
  if (unknown > 0)
    page.row("", fmt::format("at {}, a window of outputs does not determine the state", plural(unknown, "step")));
  if (repeats(model)) floquet_rows(page, model, t);
  if (!call.output.empty()) page.row("Written", call.output.string());
  return page.text();
}

// Every mode of every step, with as many digits as a number has.
std::string csv(const Table& t) {
  std::string text = "step,time,mode,frequency,hertz,damping,real,imaginary,variation,window_change,valid";
  if (t.bounds) text += ",frequency_lower,frequency_upper,damping_lower,damping_upper";
  text += '\n';
  for (Index k = 0; k < t.modes.steps(); ++k)
    for (Index i = 0; i < t.modes.count(); ++i) {
      if (!t.modes.leads(k, i)) continue;
      const std::complex<double> s = t.modes.poles(k, i);
      text += fmt::format("{},{},{},{},{},{},{},{},{},{},{}", t.modes.begin + k, time(t.modes, k), i + 1,
                          t.frequency(k, i), t.frequency(k, i) / (2 * std::numbers::pi), t.damping(k, i), s.real(),
                          s.imag(), t.modes.variation(k, i), t.modes.window_change(k, i), int(t.modes.valid(k, i)));
      if (t.bounds)
        text += fmt::format(",{},{},{},{}", t.bounds->frequency.lower(k, i), t.bounds->frequency.upper(k, i),
                            t.bounds->damping.lower(k, i), t.bounds->damping.upper(k, i));
      text += '\n';
    }
  return text;
}

Json per_step(const Matrix& values) {
  Json list = Json::array();
  for (Index k = 0; k < values.rows(); ++k) list.push_back(numbers(values.row(k).transpose()));
  return list;
}

Json json(const ModesCall& call, const Model& model, const Table& t) {
  Json j;
  j["model"] = call.model.string();
  j["begin"] = t.modes.begin;
  j["dt"] = t.modes.dt;
  j["window"] = t.modes.window;
  j["slow"] = t.modes.slow;
  j["frequency"] = per_step(t.frequency);
  j["damping"] = per_step(t.damping);
  j["poles_real"] = per_step(t.modes.poles.real());
  j["poles_imag"] = per_step(t.modes.poles.imag());
  j["variation"] = per_step(t.modes.variation);
  j["window_change"] = per_step(t.modes.window_change);
  j["valid"] = Json::array();
  for (Index k = 0; k < t.modes.steps(); ++k) {
    Json row = Json::array();
    for (Index i = 0; i < t.modes.count(); ++i) row.push_back(bool(t.modes.valid(k, i)));
    j["valid"].push_back(row);
  }
  if (repeats(model)) {
    const Floquet found = floquet(model);
    j["multipliers_real"] = numbers(found.multipliers.real());
    j["multipliers_imag"] = numbers(found.multipliers.imag());
    j["multipliers_error"] = numbers(found.error);
    j["exponents_real"] = numbers(found.exponents.real());
    j["exponents_imag"] = numbers(found.exponents.imag());
  }
  if (t.bounds) {
    j["level"] = t.bounds->level;
    j["replicates"] = t.bounds->replicates;
    j["frequency_lower"] = per_step(t.bounds->frequency.lower);
    j["frequency_upper"] = per_step(t.bounds->frequency.upper);
    j["damping_lower"] = per_step(t.bounds->damping.lower);
    j["damping_upper"] = per_step(t.bounds->damping.upper);
    if (repeats(model)) {
      j["exponents_real_lower"] = numbers(t.bounds->exponents_real.lower.col(0));
      j["exponents_real_upper"] = numbers(t.bounds->exponents_real.upper.col(0));
      j["exponents_imag_lower"] = numbers(t.bounds->exponents_imag.lower.col(0));
      j["exponents_imag_upper"] = numbers(t.bounds->exponents_imag.upper.col(0));
    }
  }
  add_findings(j, t.bounds ? t.bounds->findings : Findings());
  return j;
}

Table table(const ModesCall& call, const Model& model) {
  Table result;
  if (call.data.empty()) {
    result.modes = about(call.model, [&] { return modes(model, call.options); });
  } else {
    const Ensemble data = load_data(model, call.data, {});
    ProgressBar bar(true);
    ConfidenceOptions confidence = call.confidence;
    confidence.execution.threads = call.options.execution.threads;
    confidence.execution.progress = bar.callback();
    result.bounds = about(call.data, [&] { return mode_bounds(model, data, call.options, confidence); });
    result.modes = result.bounds->modes;
  }
  result.frequency = natural_frequencies(result.modes);
  result.damping = damping_ratios(result.modes);
  return result;
}

void run_modes(const ModesCall& call) {
  if (!call.output.empty()) check_output(call.output, Content::table, {call.model, call.data});
  const Model model = load_model(call.model);
  const Table t = table(call, model);
  const std::string text = call.json ? std::string() : report(call, model, t);
  if (!call.output.empty()) save_text(csv(t), call.output);
  if (call.json)
    print(json(call, model, t));
  else
    print(text);
  if (t.bounds) warn(t.bounds->findings);
}

}  // namespace

void add_modes(CLI::App& tool) {
  const auto call = std::make_shared<ModesCall>();
  Command command(tool, "modes", "Compute natural frequencies and damping ratios of a model over time",
                  "tokid modes model.npz --at 20,60,100 --confidence data.npz -o modes.csv");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.value("--at", call->at, "K,...", "Steps to print (default: five steps at even distances)", parse_steps,
                "steps separated by commas needed");
  command.file("-o,--output", call->output, "Table to write, with all steps: .csv");
  command.file("--confidence", call->data,
               "Whole ensemble of the identification, from which a bootstrap computes intervals");
  command.number<double>("--level", call->confidence.level, "P",
                         "Probability that an interval holds the truth (default 0.95)", 1e-6, 1 - 1e-9);
  command.number<Index>("--replicates", call->confidence.replicates, "B",
                        "Number of replicates of the bootstrap (default 200)", 2, 1'000'000);
  command.number<std::uint64_t>("--seed", call->confidence.seed, "S", "Seed of the bootstrap (default 1)", 1);
  command.count_or_auto(
      "--window", call->options.window,
      "Even number of steps whose outputs define the states (auto: the steps that determine a state)");
  command.number<double>("--slow", call->options.slow, "V",
                         "Largest variation of a valid mode while its phase turns by one radian (default 0.1)", 0.0);
  for (const char* option : {"--level", "--replicates", "--seed"}) command.needs(option, "--confidence");
  command.threads(call->options.execution.threads);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_modes(*call); });
}

}  // namespace tokid::app
