// tokid confidence: bounds for the errors of the parameters, outputs and eigenvalues of a model.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct ConfidenceCall {
  std::vector<fs::path> paths;
  fs::path model, data, output;  // `data`: how reports name the paths
  ReadOptions read;
  ConfidenceOptions options;
  bool json = false;
};

// RMS half width of the intervals over the RMS of the estimates, for each output and step.
struct Widths {
  std::vector<std::vector<double>> share;  // (m) of (T); NaN if there is nothing to compare

  double typical(Index j) const { return median(share[size_t(j)]); }
  // The steps with the widest intervals, the worst first.
  std::vector<Index> worst(Index j, size_t most) const {
    const std::vector<double>& values = share[size_t(j)];
    std::vector<Index> steps;
    for (size_t k = 0; k < values.size(); ++k)
      if (!std::isnan(values[k])) steps.push_back(Index(k));
    std::stable_sort(steps.begin(), steps.end(),
                     [&](Index a, Index b) { return values[size_t(a)] > values[size_t(b)]; });
    steps.resize(std::min(steps.size(), most));
    return steps;
  }
};

// `entries(k, j)`: the estimates and the half widths of output j at step k.
template <class Entries>
Widths widths(size_t steps, Index outputs, Entries&& entries) {
  Widths result;
  for (Index j = 0; j < outputs; ++j) {
    std::vector<double>& share = result.share.emplace_back();
    for (size_t k = 0; k < steps; ++k) {
      const auto [size, width] = entries(k, j);
      double size_square = 0.0, width_square = 0.0;
      for (Index i = 0; i < size.size(); ++i)
        if (!std::isnan(width(i))) size_square += size(i) * size(i), width_square += width(i) * width(i);
      share.push_back(std::sqrt(width_square / size_square));
    }
  }
  return result;
}

Widths markov_widths(const Confidence& c) {
  return widths(c.markov.step.size(), c.markov.outputs, [&](size_t k, Index j) {
    const Interval& step = c.markov.step[k];
    return std::pair<Vector, Vector>(step.estimate.row(j).transpose(),
                                     (step.upper.row(j) - step.lower.row(j)).transpose() / 2);
  });
}

// Outputs are departures from the mean motion, if there is one.
Widths output_widths(const OutputBounds& bounds, const Model& model) {
  return widths(bounds.step.size(), bounds.step.empty() ? 0 : model.outputs, [&](size_t k, Index j) {
    const Interval& step = bounds.step[k];
    Vector size = step.estimate.col(j);
    if (Index(k) < model.y_nominal.rows()) size.array() -= model.y_nominal(Index(k), j);
    return std::pair<Vector, Vector>(size, (step.upper.col(j) - step.lower.col(j)) / 2);
  });
}

struct Eigenvalues {
  Index total = 0, bounded = 0;
  Index fixed = 0;  // eigenvalues with bounds that are zero, whatever the noise is
  // median half width of the bounds of the real parts of all other eigenvalues
  double width = std::numeric_limits<double>::quiet_NaN();
};
Eigenvalues eigenvalues(const SpectrumBounds& spectrum) {
  Eigenvalues result;
  std::vector<double> half;
  for (const SpectrumBounds::Step& step : spectrum.step)
    for (Index e = 0; e < step.eigenvalues.size(); ++e) {
      ++result.total;
      if (!step.simple(e)) continue;
      ++result.bounded;
      const double width = (step.real.upper(e) - step.real.lower(e)) / 2;
      if (width < 1e-6 && std::abs(step.eigenvalues(e)) < 1e-6)
        ++result.fixed;
      else
        half.push_back(width);
    }
  result.width = median(half);
  return result;
}

std::string share_at_worst(const Widths& widths, Index j) {
  const std::vector<Index> steps = widths.worst(j, 1);
  return steps.empty() ? "-" : fmt::format("{} at {}", share(widths.share[size_t(j)][size_t(steps[0])]), steps[0]);
}

void add_pulse_errors(const Model& model, const Confidence& c, Page& page) {
  page.row("Pulse errors", fmt::format("relative errors of the pulse responses from noise: expected, {} % limit",
                                       number(100 * c.level)));
  const RelativeError error = relative_error(c.markov);
  std::vector<std::vector<std::string>> rows{{"output"}};
  for (Index i = 0; i < model.inputs; ++i) rows.front().push_back(input_label(model.names, i));
  for (Index j = 0; j < model.outputs; ++j) {
    rows.push_back({output_label(model.names, j)});
    for (Index i = 0; i < model.inputs; ++i)
      rows.back().push_back(fmt::format("{}, {}", share(error.expected(j, i)), share(error.limit(j, i))));
  }
  page.table(rows);
}

std::string report(const ConfidenceCall& call, const Model& model, const Ensemble& data, const Confidence& c) {
  Page page;
  page.row("Model", call.model.string());
  page.row("", describe(model));
  page.row("Data", call.data.string());
  page.row("", describe(data));
  page.row("Bounds",
           fmt::format("{} % for each value by itself, from {} experiments", number(100 * c.level), c.experiments));
  page.row("", fmt::format("by {} over experiments; {:.0f} degrees of freedom",
                           plural(c.replicates, "bootstrap replicate"), c.freedom));
  if (c.smoothing > 0) {
    const std::vector<double> bias(c.bias.begin(), c.bias.end());
    page.row("Smoothing", fmt::format("the bias of lambda = {} is included: {} times the scatter at the median step",
                                      number(c.smoothing), number(median(bias))));
  }
  page.row("Half widths", "over the size of the estimates: median over the steps, and largest");
  const Widths markov = markov_widths(c), simulated = output_widths(c.simulated, model);
  std::vector<std::vector<std::string>> rows{{"output", "Markov", "largest at step", "simulation", "largest at step"}};
  for (Index j = 0; j < model.outputs; ++j)
    rows.push_back({output_label(model.names, j), share(markov.typical(j)), share_at_worst(markov, j),
                    share(simulated.typical(j)), share_at_worst(simulated, j)});
  page.table(rows);
  if (model.inputs > 0) add_pulse_errors(model, c, page);
  const Eigenvalues e = eigenvalues(c.spectrum);
  page.row("Eigenvalues",
           e.total == 0 ? "of the closed loop: no bounds"
                        : fmt::format("of the closed loop, steps {} to {}: {} of {} are clearly simple and have bounds",
                                      c.spectrum.begin, c.spectrum.begin + Index(c.spectrum.step.size()) - 1, e.bounded,
                                      e.total));
  if (e.fixed > 0) page.row("", fmt::format("{} of them are zero, as for every deadbeat observer", e.fixed));
  if (!std::isnan(e.width)) page.row("", fmt::format("half width of real parts: median {}", number(e.width)));
  page.row("Written", call.output.string());
  return page.text();
}

Json json(const ConfidenceCall& call, const Model& model, const Confidence& c) {
  const auto summary = [&](const Widths& widths) {
    Json list = Json::array();
    for (Index j = 0; j < Index(widths.share.size()); ++j)
      list.push_back(
          {{"median", widths.typical(j)}, {"worst_steps", widths.worst(j, 5)}, {"per_step", widths.share[size_t(j)]}});
    return list;
  };
  Json j;
  j["model"] = call.model.string();
  j["data"] = json_of(call.paths);
  j["level"] = c.level;
  j["experiments"] = c.experiments;
  j["lags"] = c.lags;
  j["freedom"] = c.freedom;
  j["replicates"] = c.replicates;
  if (c.smoothing > 0) {
    j["smoothing"] = c.smoothing;
    j["bias"] = numbers(c.bias);
  }
  j["band"] = c.markov.band;
  j["k_begin"] = c.markov.k_begin;
  j["output_names"] = Json::array();
  for (Index i = 0; i < model.outputs; ++i) j["output_names"].push_back(model.names.output(i));
  j["markov_half_width"] = summary(markov_widths(c));
  const RelativeError error = relative_error(c.markov);
  for (const auto& [name, values] :
       {std::pair{"relative_error", &error.expected}, {"relative_error_limit", &error.limit}}) {
    j[name] = Json::array();
    for (Index i = 0; i < values->rows(); ++i) j[name].push_back(numbers(values->row(i).transpose()));
  }
  j["simulation_half_width"] = summary(output_widths(c.simulated, model));
  const Eigenvalues e = eigenvalues(c.spectrum);
  j["eigenvalues"] = {{"total", e.total}, {"bounded", e.bounded}, {"zero", e.fixed}, {"half_width", e.width}};
  add_findings(j, c.findings);
  return j;
}

void run_confidence(const ConfidenceCall& call) {
  std::vector<fs::path> kept = call.paths;
  kept.push_back(call.model);
  check_output(call.output, Content::bounds, kept);
  const Model model = load_model(call.model);
  const Ensemble data = load_data(model, call.paths, call.read);
  Confidence result = [&] {
    ProgressBar bar(true);
    ConfidenceOptions options = call.options;
    options.execution.progress = bar.callback();
    return about(call.data, [&] { return confidence(model, data, options); });
  }();
  Findings findings = remarks(model, data);
  append(findings, std::move(result.findings));
  append(findings, differences(model, data));
  result.findings = std::move(findings);
  save_confidence(result, call.output);
  if (call.json)
    print(json(call, model, result));
  else
    print(report(call, model, data, result));
  warn(result.findings);
}

}  // namespace

void add_confidence(CLI::App& tool) {
  const auto call = std::make_shared<ConfidenceCall>();
  ConfidenceOptions& o = call->options;
  Command command(tool, "confidence", "Compute confidence bounds of a model, its outputs and eigenvalues",
                  "tokid confidence model.npz data.npz -o bounds.npz --level 0.99");
  command.argument("MODEL", call->model, "Model that tokid identified: .npz, .h5 or .mat");
  command.data("DATA", call->paths, call->data,
               "The whole ensemble of its identification: .npz, .h5, .mat or .csv; or many .csv: files, a folder, "
               "a pattern");
  command.output(call->output, "Bounds to write: .npz, .h5 or .mat");
  command.columns(call->read);
  command.number<double>("--level", o.level, "P", "Probability that an interval holds the truth (default 0.95)", 1e-6,
                         1 - 1e-9);
  command.number<Index>("--replicates", o.replicates, "B", "Number of replicates of the bootstrap (default 200)", 2,
                        1'000'000);
  command.count_or_auto("--band", o.band,
                        "Largest number of steps between input and output of a Markov parameter "
                        "(auto: twice the steps that determine a state)");
  command.number<Index>("--reference-step", o.reference_step, "s",
                        "Step of the frame of the eigenvalues (default: the first with all states)", 0, 1'000'000);
  command.number<std::uint64_t>("--seed", o.seed, "S", "Seed of the bootstrap (default 1)", 1);
  command.threads(o.execution.threads);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_confidence(*call); });
}

}  // namespace tokid::app
