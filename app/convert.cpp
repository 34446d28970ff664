// tokid convert: ensembles and models from one format to another.
// SPDX-License-Identifier: BSD-3-Clause
#include <optional>

#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

struct ConvertCall {
  std::vector<fs::path> paths;
  fs::path input, output;  // `input`: how the report names the paths
  ReadOptions read{{}, {}, false};
  WriteOptions write;
};

// The last path is the file to write.
ConvertCall with_output(ConvertCall call) {
  if (call.paths.size() < 2) throw std::invalid_argument("OUT is required; see 'tokid convert --help'");
  call.output = call.paths.back();
  call.paths.pop_back();
  call.input = shown(call.paths);
  return call;
}

// A shell that expands a pattern makes its last file OUT if the user forgot OUT. That file must stay.
void check_no_recording(const ConvertCall& call) {
  const auto is_csv = [](const fs::path& path) { return extension_of(path) == ".csv"; };
  std::error_code error;
  if (!is_csv(call.output) || !fs::exists(call.output, error)) return;
  if (call.paths.size() == 1 && !is_csv(call.paths.front())) return;
  throw std::invalid_argument(fmt::format(
      "OUT: '{}' found, a .csv that exists and may be a recording, so it was not replaced. The last file is "
      "the one to write: name a new file there, or delete this one first",
      call.output.string()));
}

void run_convert(const ConvertCall& call) {
  const std::optional<FileKind> kind = call.paths.size() == 1 ? std::optional(file_kind(call.input)) : std::nullopt;
  if (kind == FileKind::controller)
    throw std::invalid_argument(
        fmt::format("{}: a controller of tokid lqr found, an ensemble or a model needed", call.input.string()));
  const bool model = kind == FileKind::model;
  // The converted file has only the arrays and columns that tokid uses. The original must therefore not be replaced.
  check_output(call.output, model ? Content::model : Content::ensemble, call.paths);
  check_no_recording(call);
  if (call.write.mat73 && extension_of(call.output) != ".mat")
    throw std::invalid_argument(fmt::format("--mat73: the output is '{}', a .mat needed", call.output.string()));
  std::vector<std::string> warnings;
  if (model) {
    save_model(load_model(call.input), call.output, call.write);
  } else {
    const Ensemble data = load_ensemble(call.paths, call.read);
    warnings = data.remarks;
    save_ensemble(data, call.output, call.write);
  }

  Page page;
  page.row("Converted", fmt::format("{} {}", model ? "the model" : "the ensemble", call.input.string()));
  page.row("Written", call.output.string());
  print(page.text());
  warn(warnings);
}

}  // namespace

void add_convert(CLI::App& tool) {
  const auto call = std::make_shared<ConvertCall>();
  Command command(tool, "convert", "Convert an ensemble or a model to another format",
                  "tokid convert data.csv data.mat --mat73");
  command.argument("IN...OUT", call->paths,  // CLI11 from 2.4 on, of Debian 13, refuses a name with spaces
                   "Ensemble or model to read, or many .csv: files, a folder, a pattern; then the file to write, whose "
                   "extension determines the format");
  command.columns(call->read);
  command.flag("--mat73", call->write.mat73, "Write a .mat of MATLAB version 7.3");
  command.runs([call] { run_convert(with_output(*call)); });
}

}  // namespace tokid::app
