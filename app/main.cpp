// tokid, in a process of its own.
// SPDX-License-Identifier: BSD-3-Clause
#include "tool.hpp"

int main(int argc, char** argv) {
  const tokid::app::Outcome outcome = tokid::app::run_tool(argc, argv);
  if (outcome.status != 0) tokid::app::message(outcome.complaint);
  return outcome.status;
}
