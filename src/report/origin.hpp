// Has the model seen the data that it is judged by?
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/report.hpp"

namespace tokid::report {

// What is tested, and what it is to the model, with Evaluation::automatic resolved: where the data are those of an
// identification that held some back, these alone are tested.
struct Tested {
  Ensemble data;
  ReportOptions options;
  // Of each experiment tested, in the data that were given: its row, and its name, empty where it has none.
  std::vector<Index> rows;
  std::vector<std::string> names;
};
// The experiments of these rows of `data`, as they are in `part`.
Tested tested_part(const Ensemble& data, Ensemble part, std::vector<Index> rows, ReportOptions options);
Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options);

}  // namespace tokid::report
