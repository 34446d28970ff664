// tokid import: tables and logs of other programs. The Python package reads them.
// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

namespace {

// Python would first look for modules in the folder of the data, which may come from somebody else.
constexpr auto script = R"(import sys
sys.path[:] = [folder for folder in sys.path if folder]
try:
    from tokid.__main__ import main
except ModuleNotFoundError as error:
    if error.name != "tokid":
        raise
    print(f"tokid: import: {sys.executable} has no package tokid, which reads tables and logs. Install it: "
          f"{sys.executable} -m pip install 'tokid[read]'", file=sys.stderr)
    sys.exit(2)
sys.exit(main())
)";

// The Python beside the tool, as pip installs it, or else the first in PATH.
std::string python() {
  std::error_code error;
  const fs::path beside = fs::read_symlink("/proc/self/exe", error).parent_path() / "python3";
  return fs::exists(beside, error) ? beside.string() : "python3";
}

// Python takes the place of this process, so that signals and the exit code are its own.
void import_with_python(const std::vector<std::string>& given) {
  std::vector<std::string> words{python(), "-c", script, "import"};
  words.insert(words.end(), given.begin(), given.end());
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execvp(words.front().c_str(), arguments.data());
  throw std::system_error(errno, std::generic_category(), words.front());
}

}  // namespace

void add_import(CLI::App& tool) {
  CLI::App* command = tool.add_subcommand("import", "Read tables and logs of other programs (with the Python package)");
  command->group("Commands");
  command->prefix_command();
  command->set_help_flag("");  // the package prints the help
  command->callback([command] { import_with_python(command->remaining()); });
}

}  // namespace tokid::app
