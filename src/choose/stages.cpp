// SPDX-License-Identifier: BSD-3-Clause
#include "choose/stages.hpp"

#include <array>

namespace tokid {

namespace {

struct Row {
  const char* name;
  double exact, noisy, with_em;  // shares at the end
};

// Before it is known whether there is noise, all courses have the same shares. EM takes 60 to 90 % of an
// identification.
constexpr std::array<Row, 11> rows{{
    {"choosing lags", 0.05, 0.05, 0.05},
    {"regressions of each step", 0.08, 0.08, 0.08},
    {"choosing lags and lambda", 0.20, 0.22, 0.12},
    {"regressions of all steps", 0.24, 0.24, 0.13},
    {"testing feedthrough", 0.24, 0.32, 0.15},
    {"models of the folds", 0.24, 0.38, 0.16},
    {"choosing the number of states", 0.24, 0.80, 0.24},
    {"realisation", 0.40, 0.86, 0.25},
    {"EM", 0.40, 0.86, 0.94},
    {"looking for outliers", 0.50, 0.97, 0.98},
    {"validating", 1.00, 1.00, 1.00},
}};
static_assert(rows.size() == size_t(WorkStage::validation) + 1);

double end_of(const Row& row, Course course) {
  return course == Course::noisy_with_em ? row.with_em : course == Course::noisy ? row.noisy : row.exact;
}

}  // namespace

Course course_of(const IdentifyOptions& options) {
  const bool searches = options.refine.value_or(true) && !options.choices && options.method != Method::tvera;
  return searches ? Course::noisy_with_em : Course::noisy;
}

StageShares shares_of(WorkStage stage, Course course) {
  const size_t i = size_t(stage);
  return {i > 0 ? end_of(rows[i - 1], course) : 0.0, end_of(rows[i], course)};
}

Execution in_stage(const Execution& whole, WorkStage stage, Course course) {
  const StageShares shares = shares_of(stage, course);
  Execution part = share(whole, shares.from, shares.to, rows[size_t(stage)].name);
  if (part.progress && (course == Course::unknown || course == Course::noisy_with_em))
    part.progress = [report = part.progress](ProgressReport own) {
      own.open = true;
      report(own);
    };
  return part;
}

}  // namespace tokid
