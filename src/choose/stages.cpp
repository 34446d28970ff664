// SPDX-License-Identifier: BSD-3-Clause
#include "choose/stages.hpp"

#include <array>

namespace tokid {

namespace {

struct Row {
  const char* name;
  double end;  // finished share of the whole at the end of the stage, with EM
};

constexpr std::array<Row, 11> rows{{
    {"choosing lags", 0.05},
    {"regressions of each step", 0.08},
    {"choosing lags and lambda", 0.20},
    {"regressions of all steps", 0.22},
    {"testing feedthrough", 0.25},
    {"models of the folds", 0.28},
    {"choosing the number of states", 0.42},
    {"realisation", 0.45},
    {"EM", 0.94},
    {"looking for outliers", 0.97},
    {"validating", 1.00},
}};
static_assert(rows.size() == size_t(WorkStage::validation) + 1);

}  // namespace

Execution in_stage(const Execution& whole, WorkStage stage) {
  const size_t i = size_t(stage);
  return share(whole, i > 0 ? rows[i - 1].end : 0.0, rows[i].end, rows[i].name);
}

}  // namespace tokid
