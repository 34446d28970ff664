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
};
Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options);

}  // namespace tokid::report
