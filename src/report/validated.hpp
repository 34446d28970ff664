// The validation of a model together with its verdict.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/report.hpp"
#include "tokid/validate.hpp"

namespace tokid::report {

struct Validated {
  Validation validation;    // that of validate_distinct()
  ExperimentFits fits;      // of the experiments without copies and empty ones
  std::vector<Index> rows;  // the rows of these experiments in the given data
  Verdict verdict;          // that of verdict()
  bool seen = false;        // true: the given data are those of the identification
};
// Validates a model, and judges it with these options. One comparison of model and data gives both. The verdict needs a
// comparison of its own only if it tests other data: held-out experiments alone, or those that the outlier options of
// the identification left. `horizon`: H of the H-step fit of the validation. \throws as validate() and report_page()
Validated validated(const Model& model, const Ensemble& data, Index horizon, const ReportOptions& options);

}  // namespace tokid::report
