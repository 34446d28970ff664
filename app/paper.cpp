// tokid paper: the paper's example, figures and printed numbers, recomputed from experiments.
// SPDX-License-Identifier: BSD-3-Clause
#include <chrono>

#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct PaperCall {
  fs::path directory;
  std::uint64_t seed = 1;
  int threads = 1;
};

// Makes the directory, unless it exists.
void make_directory(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return;
  if (fs::exists(path, error)) throw IoError(fmt::format("{}: a file found, a directory needed", path.string()));
  fs::create_directories(path, error);
  if (error)
    throw WriteError(fmt::format("{}: the directory can't be made: {}", path.string(), error.message()), error.value());
}

std::string text(const Paper& paper, const KalmanStudy& study, const PaperCall& call, double seconds) {
  Page page;
  page.row("Appendix B", "eigenvalues of A + G C in the reference frame");
  std::vector<std::vector<std::string>> rows{{"equation", "printed", "computed", "difference"}};
  for (const PrintedNumber& n : paper.printed)
    if (n.quantity.starts_with("λ") && std::abs(n.printed) > 1e-9)
      rows.push_back({n.equation, fmt::format("{:.5g}", n.printed.real()), fmt::format("{:.7f}", n.computed.real()),
                      fmt::format("{:.1e}", std::abs(n.computed - n.printed))});
  page.table(rows);
  const auto agree =
      std::count_if(paper.printed.begin(), paper.printed.end(), [](const auto& n) { return n.agrees(); });
  page.row("", fmt::format("{} of {} printed numbers agree", agree, paper.printed.size()));
  for (const PaperCase* one : {&paper.minimum, &paper.more})
    page.row(one == &paper.minimum ? "Case 1" : "Case 2",
             fmt::format("N = {}: Markov parameters exact to {:.1e}, outputs to {:.1e}", one->experiments,
                         one->direct_error.tail(one->direct_error.size() - 1).maxCoeff(),
                         one->output_error.cwiseAbs().maxCoeff()));
  for (const KalmanStudyCell& cell : study.cells)
    if (cell.lags == 10 && cell.experiments == 2000)
      page.row("Noise",
               fmt::format("N = 2000, p = 10: one-step error {:.3f} times that of the Kalman filter", cell.error));
  page.row("Written", fmt::format("{}: paper.html, paper.json in {:.1f} s", call.directory.string(), seconds));
  return page.text();
}

void run_paper(const PaperCall& call) {
  const auto begin = std::chrono::steady_clock::now();
  make_directory(call.directory);
  const Paper paper = paper_example({.seed = call.seed, .execution = {call.threads, {}}});
  const KalmanStudy study = kalman_study({.seed = call.seed, .execution = {call.threads, {}}});
  FilesTogether files;
  save_text(paper_page(paper, study), call.directory / "paper.html");
  save_text(paper_json(paper, study), call.directory / "paper.json");
  files.commit();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  print(text(paper, study, call, seconds));

  std::vector<std::string> warnings;
  for (const PrintedNumber& n : paper.printed)
    if (!n.agrees())
      warnings.push_back(fmt::format("{} {}: the paper prints {:.5g}, but {:.5g} was computed", n.equation, n.quantity,
                                     n.printed.real(), n.computed.real()));
  warn(warnings);
  if (!warnings.empty())
    throw std::runtime_error(fmt::format("{} of {} printed numbers of the paper do not agree with the computed numbers",
                                         warnings.size(), paper.printed.size()));
}

}  // namespace

void add_paper(CLI::App& tool) {
  const auto call = std::make_shared<PaperCall>();
  Command command(tool, "paper", "Compute the figures and printed numbers of the paper again", "tokid paper -o paper");
  command.output(call->directory, "Directory for paper.html and paper.json", "DIR");
  command.number<std::uint64_t>("--seed", call->seed, "S", "Seed of the experiments (default 1)", 0);
  command.threads(call->threads);
  command.runs([call] { run_paper(*call); });
}

}  // namespace tokid::app
