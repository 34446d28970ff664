// Ensemble → inputs and outputs that cannot be told apart: combinations of channels, and of their samples before, that
// never vary.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct ExcitationOptions {
  Index lags = 1;                    // p: how far back a regression looks
  Index period = 0;                  // P: the steps k, k+P, … share one model; 0: every step has its own
  bool centred = true;               // a mean motion is, or may be, removed
  bool noisy = false;                // outputs that inputs follow from exactly are no work of theirs
  bool shared = false;               // steps share what they know: a few of them are of no consequence
  Index origin = 0;                  // number of the first step
  std::vector<Index> suspects = {};  // steps whose inputs a regression has found dependent
};

struct Excitation {
  Findings findings;
  std::vector<Index> named;  // steps whose windows hold what they speak of, ascending
};

// Inputs of one step that move together, at all steps; inputs that follow from the samples before them, at the suspects
// and at two dozen steps, and where these tell of any, at all. Nothing that chance makes of few experiments and of
// inputs of few values.
Excitation excitation(const Ensemble& ensemble, const ExcitationOptions& options);

// Outputs that are one combination of others at all steps, and outputs that are the same in every experiment at some
// steps after they have moved.
Findings findings_of_dependent_outputs(const Ensemble& ensemble, Index origin = 0);

// Outputs that stay where they are in single experiments while their inputs move, and which experiments these are.
struct StuckOutputs {
  Findings findings;
  std::vector<Index> experiments;
};
StuckOutputs stuck_outputs(const Ensemble& ensemble, Index origin = 0);

}  // namespace tokid
