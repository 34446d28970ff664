// GTV-ARX model that assumes zero initial states → a test of this assumption by the errors of the first steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid {

// The initial state that the options state. If the options state none, the initial state that the data state. Empty if
// neither options nor data state one.
std::optional<InitialStateTest> stated_initial_state(const Ensemble& data, const IdentifyOptions& options);

// One-step errors of regressions that assume zero initial states.
struct StepErrors {
  Matrix variance;             // (T × m)
  std::vector<Index> freedom;  // (T) degrees of freedom of each variance
  Vector output_square;        // (m) largest mean square of each output
};
// On the data of the regressions themselves.
StepErrors residuals_of(const GtvArx& arx);
// On held-out experiments, of regressions that couple the steps: their residuals have an unknown number of degrees of
// freedom. `options.initial_state` must be zero. `centred`: see fold(). The data need two experiments.
StepErrors held_out_errors(const Ensemble& data, const SmoothArxOptions& options, bool centred);

// F test of the errors at each step k < p and output against those of later steps, which the initial state does not
// affect.
InitialStateTest test_initial_state(const StepErrors& errors, Index lags);

}  // namespace tokid
