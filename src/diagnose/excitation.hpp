// Ensemble → inputs and outputs whose effects cannot be separated. Effects cannot be separated if a combination of
// channels, or of their earlier samples, never varies.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct ExcitationOptions {
  Index lags = 1;                           // p, the number of steps before that a regression uses
  Index period = 0;                         // P: the steps k, k+P, … share one model; 0: every step has its own
  bool centred = true;                      // a mean motion is, or may be, removed
  bool noisy = false;                       // true: an input that follows exactly from outputs shows feedback
  bool shared = false;                      // the steps are coupled: a few dependent steps do no harm
  bool sampled = false;                     // true: only some steps, spread evenly, are examined
  std::vector<Index> dependent_steps = {};  // steps whose inputs a regression has found dependent
};

struct Excitation {
  Findings findings;
  Index places = 0;          // number of examined steps, or of phases of a period
  std::vector<Index> named;  // steps whose windows contain a reported dependence, ascending
};

// Reports inputs that move together at a step, and inputs that follow from earlier samples. Every step is examined for
// inputs that move together. Only some steps are examined for inputs that follow from earlier samples:
// `dependent_steps`, steps that look like the step before, and 24 other steps. If such an input is found, all steps are
// examined. Dependences that may be chance are not reported; chance is likely with few experiments or with inputs of
// few values.
Excitation excitation(const Ensemble& ensemble, const ExcitationOptions& options);

// Reports outputs that are the same combination of other outputs at all steps. Also reports outputs that are the same
// in every experiment at some steps after they have moved.
Findings findings_of_dependent_outputs(const Ensemble& ensemble);

// Outputs that stay constant in single experiments while the inputs move, and these experiments.
struct StuckOutputs {
  Findings findings;
  std::vector<Index> experiments;
};
StuckOutputs stuck_outputs(const Ensemble& ensemble);

}  // namespace tokid
