// The whole tool, for the programs around it: tokid, tokid-mpi and the fuzzers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

#include "tokid/team.hpp"

namespace CLI {
class App;
}

namespace tokid::app {

// The processes that share the work: one process, unless tokid-mpi sets more.
Team& team();

// The exit status, and the error message if it is not zero.
struct Outcome {
  int status = 0;
  std::string complaint;
};
Outcome run_tool(int argc, char** argv);

// Adds all commands with their options.
void add_commands(CLI::App& tool);

// The error message for a command line; empty if the command line is valid. The command does not run.
std::string complaint(int argc, const char* const* argv);

// On stderr: one line, or on a terminal lines of at most 100 columns, of which all but the first are indented.
void message(std::string_view text);

}  // namespace tokid::app
