// Finds out whether the model has seen the data that evaluate it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/report.hpp"

namespace tokid::report {

// The tested data, and their relation to the model, with Evaluation::automatic resolved. If the data are those of an
// identification with held-out experiments, only the held-out ones are tested.
struct Tested {
  Ensemble data;
  ReportOptions options;
  // For each tested experiment: its row in the given data, and its name, empty if it has none.
  std::vector<Index> rows;
  std::vector<std::string> names;
};
// The experiments of these rows of `data`, as they are in `part`.
Tested tested_part(const Ensemble& data, Ensemble part, std::vector<Index> rows, ReportOptions options);
Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options);

}  // namespace tokid::report
