// The stages of an identification, and the share of its time that each usually takes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/parallel.hpp"

namespace tokid {

enum class WorkStage {
  lags,         // lags of regressions of each step alone
  each_step,    // these regressions
  variation,    // lags and λ of regressions of all steps
  together,     // these regressions
  feedthrough,  // D = 0?
  folds,        // models for cross-validation
  states,       // number of states
  realisation,  // model without EM
  em,           // its search, and EM with all experiments
  examination,  // outliers
  validation,
};

// The execution of one stage, which reports its share of the whole.
Execution in_stage(const Execution& whole, WorkStage stage);

}  // namespace tokid
