// The stages of an identification, and the share of its time that each usually takes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/options.hpp"
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

// What is known about the work that follows. Regressions of each step alone tell whether there is noise.
enum class Course { unknown, exact, noisy, noisy_with_em };

struct StageShares {
  double from = 0.0, to = 1.0;
};
// The course of an identification of noisy data: with EM or without.
Course course_of(const IdentifyOptions& options);
StageShares shares_of(WorkStage stage, Course course);
// The execution of one stage. If EM may follow, the amount of work is open before it. The short work after EM states no
// time left either.
Execution in_stage(const Execution& whole, WorkStage stage, Course course);

}  // namespace tokid
