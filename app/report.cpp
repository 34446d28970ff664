// tokid report: one page that shows whether a model can be trusted.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"
#include "report/verdict_json.hpp"
#include "verdict.hpp"

namespace tokid::app {

namespace {

struct ReportCall {
  std::vector<fs::path> paths;
  fs::path model, data, output, identified;  // `data`: how reports name the paths
  std::vector<fs::path> compare;
  ReadOptions read;
  ReportOptions options;
  int threads = 1;
  bool json = false;
};

void run_report(const ReportCall& call) {
  check_output(call.output, Content::page);
  const Model model = load_model(call.model);
  const Ensemble data = load_data(model, call.paths, call.read);
  ReportOptions options = call.options;
  options.model_name = call.model.filename().string();
  options.data_name = call.data.filename().string();
  options.findings = remarks(model, data);
  for (const fs::path& other : call.compare) options.compare.push_back({other.filename().string(), load_model(other)});
  if (!call.identified.empty()) {
    const Ensemble identified = load_data(model, call.identified, call.read);
    ProgressBar bar(true);
    ConfidenceOptions bounds;
    bounds.execution.threads = call.threads;
    bounds.execution.progress = bar.callback();
    options.bands = about(call.identified, [&] { return response_bands(model, identified, bounds, call.options.at); });
  }
  const ReportPage page = about(call.data, [&] { return report_page(model, data, options); });
  save_text(page.html, call.output);

  if (call.json) {
    Json j = with_checks(page.verdict);
    j["page"] = call.output.string();
    add_findings(j, page.findings);
    print(j);
  } else {
    Page text;
    add_verdict(page.verdict, true, text);
    text.row("Written", call.output.string());
    print(text.text());
  }
  warn(page.findings);
}

}  // namespace

void add_report(CLI::App& tool) {
  const auto call = std::make_shared<ReportCall>();
  Command command(tool, "report", "Write a page (HTML) that shows whether a model can be trusted",
                  "tokid report model.npz fresh.npz -o page.html");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.data("DATA", call->paths, call->data,
               "Ensemble: .npz, .h5, .mat or .csv; or many .csv: files, a folder, a pattern");
  command.output(call->output, "Page to write: .html");
  command.columns(call->read);
  command.number<Index>("--horizon", call->options.horizon, "H",
                        "Number of steps ahead of the multi-step predictions (default 10)", 1, 1'000'000);
  command.number<Index>("--from", call->options.first_step, "STEP",
                        "First step of the fits, for example after a start that no model can know", 0, 1'000'000'000);
  command.number<Index>("--experiments", call->options.experiments, "N",
                        "Largest number of experiments in the plots (default 24)", 1, 1000);
  command.files("--compare", call->compare, "Other models of the same channels, to compare on the page");
  command.file(
      "--bands", call->identified,
      "Ensemble of the identification, for 95 % bands of the responses by a bootstrap: .npz, .h5, .mat or .csv");
  command.value("--at", call->options.at, "K,...",
                "Steps of the pulse, step and frozen frequency responses (default: steps at even distances)",
                parse_steps, "steps separated by commas needed, such as 0,20,50");
  command.threads(call->threads);
  command.flag("--json", call->json, "Print the verdict and its checks as one JSON object");
  command.runs([call] { run_report(*call); });
}

}  // namespace tokid::app
