// The last lines of a report: the verdict on a model, and the command to take next.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "command.hpp"
#include "common.hpp"

namespace tokid::app {

struct NextStep {
  std::string purpose, command;
};

// The verdict with its most serious reason, or with its summary if nothing speaks against the model. `verbose`: with
// the summary and all reasons.
void add_verdict(const Verdict& verdict, bool verbose, Page& page);

// The model and the data of a verdict, and how they can be tested again.
struct Tested {
  fs::path model;
  std::vector<fs::path> data;
  ReadOptions read;
  bool seen = false;          // true: the data that tested the model are those of its identification
  bool can_hold_out = false;  // true: enough experiments for the identification remain if a fifth is held out
  // The command that makes the model from the data, with other options; empty if this is not that command.
  std::function<std::string(const std::string& options)> identify = {};
};
// The next step after a verdict. `findings` are the warnings that the user sees. \pre the verdict was made
NextStep next_step(const Verdict& verdict, const Findings& findings, const Tested& tested);
// The next step if there is no verdict, or one that the training data gave: a test with data that the model has not
// seen. They are read as the data of the command, so that the command needs the same options.
NextStep test_on_other_data(const fs::path& model, const std::vector<fs::path>& data, const ReadOptions& read);

}  // namespace tokid::app
