// The command line tool: one subcommand for each use of the library.
// SPDX-License-Identifier: BSD-3-Clause
#include "tool.hpp"

#include <fcntl.h>
#include <hdf5.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <new>

#include "command.hpp"
#include "common.hpp"
#include "linalg/simd.hpp"
#include "suggestion.hpp"
#include "tokid/printable.hpp"

namespace tokid::app {

void add_commands(CLI::App& tool) {
  add_identify(tool);
  add_validate(tool);
  add_refine(tool);
  add_update(tool);
  add_report(tool);
  add_paper(tool);
  add_confidence(tool);
  add_modes(tool);
  add_simulate(tool);
  add_predict(tool);
  add_info(tool);
  add_plan(tool);
  add_lqr(tool);
  add_learn(tool);
  add_export(tool);
  add_example(tool);
  add_convert(tool);
  add_import(tool);
}

namespace {

constexpr int failed = 1, wrong_call = 2;

// The formatter of CLI11 would add to the description how many subcommands are required.
class Help : public CLI::Formatter {
 public:
  Help() {
    label("SUBCOMMAND", "COMMAND");
    label("REQUIRED", "(required)");
    label("Positionals", "Arguments");
    column_width(names_width);
  }
  std::string make_description(const CLI::App* command) const override {
    return wrapped(command->get_description(), line_columns, "\n") + "\n\n";
  }
  // The caller indents the lines after the first one.
  std::string make_option_desc(const CLI::Option* option) const override {
    return wrapped(option->get_description(), line_columns - names_width, "\n");
  }
  std::string make_subcommand(const CLI::App* command) const override {
    const std::string separator = "\n" + std::string(names_width, ' ');
    return fmt::format("  {:<{}}{}\n", command->get_name(), names_width - 2,
                       wrapped(command->get_description(), line_columns - names_width, separator));
  }

 private:
  static constexpr size_t names_width = 34;
};

// Opens missing standard streams. Otherwise a file opened later would receive the printed text.
void open_standard_streams() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    while (fcntl(fd, F_GETFD) == -1 && open("/dev/null", O_RDWR) >= 0)
      ;
}

std::vector<std::string> command_names(const CLI::App& tool) {
  std::vector<std::string> names;
  for (const CLI::App* command : tool.get_subcommands({})) names.push_back(command->get_name());
  return names;
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  return names;
}

std::string unknown_command(const CLI::App& tool, const std::string& found) {
  const std::vector<std::string> commands = command_names(tool);
  const std::string hint = did_you_mean(found, commands);
  return fmt::format("unknown command '{}'{} See 'tokid --help'", found,
                     hint.empty() ? fmt::format(", one of {} needed.", fmt::join(commands, ", ")) : hint);
}

// CLI11 reports a missing argument before an unexpected one. The unexpected argument comes first here, because it is
// more often the cause.
std::string complaint(const CLI::App& tool, const CLI::ParseError& error) {
  const std::vector<std::string> unexpected = tool.remaining(true);
  if (tool.get_subcommands().empty()) {
    if (!unexpected.empty()) return unknown_command(tool, unexpected.front());
    return fmt::format("no command given, one of {} needed; see 'tokid --help'", fmt::join(command_names(tool), ", "));
  }
  const CLI::App& command = *tool.get_subcommands().front();
  const std::string see = fmt::format("ee 'tokid {} --help'", command.get_name());
  if (unexpected.empty()) {
    const std::string what = error.what();
    if (const size_t end = what.find(" was given a disallowed flag override"); end != std::string::npos)
      return fmt::format("option '--{}' takes no value. S{}", what.substr(0, end), see);
    return fmt::format("{}; s{}", what, see);
  }
  const std::string& first = unexpected.front();
  if (!first.starts_with('-')) return fmt::format("unexpected argument '{}'; s{}", first, see);
  const std::string name = first.substr(0, first.find('='));
  const std::string hint = did_you_mean(name, option_names(command));
  return fmt::format("unknown option '{}'{} S{}", name, hint.empty() ? "." : hint, see);
}

Outcome parse_and_run(int argc, char** argv) {
  CLI::App tool("Identifies linear time varying systems from repeated experiments.", "tokid");
  tool.formatter(std::make_shared<Help>());
  tool.set_version_flag("--version", fmt::format("tokid {}", version), "Print the version and exit");
  tool.set_help_flag("-h,--help", "Print this help and exit");
  tool.require_subcommand(1);
  tool.footer("Example:\n  tokid example oscillator -o data.npz && tokid identify data.npz -o model.npz");
  add_commands(tool);
  if (argc < 2) {
    print(tool.help());
    return {};
  }
  try {
    tool.parse(argc, argv);
  } catch (const CLI::CallForHelp&) {
    print(tool.help());
  } catch (const CLI::CallForVersion& call) {
    print(std::string(call.what()) + '\n');
  } catch (const CLI::ParseError& error) {
    return {wrong_call, complaint(tool, error)};
  }
  return {};
}

}  // namespace

Team& team() {
  static Team processes;
  return processes;
}

Outcome run_tool(int argc, char** argv) {
#ifdef __GLIBC__
  // Keeps freed memory for the next stage or block, because new memory from the system costs a page fault for each
  // page.
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the largest value that is accepted
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
#endif
  H5dont_atexit();  // all files are closed at exit, and HDF5 would print its own messages about damaged files
  // Without these signals, writing to a closed pipe, or beyond the limit of a file's size, returns an error.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  open_standard_streams();
  try {
    simd::target();  // refuses a wrong TOKID_SIMD before any work
    return parse_and_run(argc, argv);
  } catch (const WriteError& error) {
    return {failed, error.what()};
  } catch (const IoError& error) {
    return {wrong_call, error.what()};
  } catch (const std::invalid_argument& error) {
    return {wrong_call, error.what()};
  } catch (const std::bad_alloc&) {
    return {failed, "out of memory"};
  } catch (const std::exception& error) {
    return {failed, error.what()};
  }
}

std::string complaint(int argc, const char* const* argv) {
  CLI::App tool("", "tokid");
  add_commands(tool);
  struct Parsed {};
  tool.parse_complete_callback([] { throw Parsed{}; });  // stops before the command runs
  try {
    tool.parse(argc, argv);
  } catch (const Parsed&) {
  } catch (const CLI::ParseError& error) {
    return complaint(tool, error);
  }
  return {};
}

// If stderr cannot be written, the error cannot be reported anywhere.
void message(std::string_view text) {
  const std::string whole = printable(fmt::format("tokid: {}", text));
  // A file or another program gets each message in one line, in which it can search.
  const std::string line = (isatty(STDERR_FILENO) != 0 ? wrapped(whole, line_columns - 2, "\n  ") : whole) + '\n';
  std::fwrite(line.data(), 1, line.size(), stderr);
}

}  // namespace tokid::app
