// Finds out whether the model was identified from the data of the report.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/copies.hpp"
#include "tokid/report.hpp"

namespace tokid::report {

// The tested data and the options of the report. The evaluation in the options is no longer Evaluation::automatic. If
// an identification held out some of the data, only the held-out experiments are tested.
struct Tested {
  Ensemble data;
  ReportOptions options;
  // For each tested experiment: its row in the given data, and its name (empty without a name).
  std::vector<Index> rows;
  std::vector<std::string> names;
  bool distinct = false;  // true: all experiments of the given data but copies and empty ones, with all samples

  // Outlying samples of the tested data, with the rows and names of the given data.
  std::vector<OutlyingSamples> in_given_data(std::vector<OutlyingSamples> outlying) const;
};
// `part`: the experiments of `data` in these rows.
Tested tested_part(const Ensemble& data, Ensemble part, std::vector<Index> rows, ReportOptions options);
// `used`: used_experiments(data)
Tested tested(const Model& model, const Ensemble& data, const UsedExperiments& used, const ReportOptions& options);
Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options);
// The data that test the model of an identification from `data`: the held-out experiments, or else all that were used.
Tested tested(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
              ReportOptions options);

}  // namespace tokid::report
