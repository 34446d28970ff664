// The whole tool, as the programs around it see it: tokid, tokid-mpi and the fuzzers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

#include "tokid/team.hpp"

namespace tokid::app {

// The processes that share the work; a single one, unless tokid-mpi says otherwise.
Team& team();

// Its exit status, and what is wrong where that is not zero.
struct Outcome {
  int status = 0;
  std::string complaint;
};
Outcome run_tool(int argc, char** argv);

// What is wrong with a command line, or nothing; its command doesn't run.
std::string complaint(int argc, const char* const* argv);

void message(std::string_view text);  // one line on stderr

}  // namespace tokid::app
