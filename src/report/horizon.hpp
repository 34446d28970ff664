// Decides how a report evaluates a model: by its simulation, or by predictions over fewer steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "model/comparison.hpp"
#include "tokid/report.hpp"

namespace tokid::report {

// The noise that the model states can make even the simulation of an exact model bad. Then a bad simulation does not
// show that the model is wrong. In this case the model is evaluated by predictions, over the most steps at which an
// exact model would predict well.
struct DecidingHorizon {
  Index steps = 0;      // prediction horizon H; 0: the simulation
  bool stated = false;  // the covariances are those of the model; false: they come from the innovations of these data
  Vector expected_simulation;  // (m) fit [%] of the simulation of an exact model; empty if not computed
  Vector expected_one_step;    // (m) fit [%] of an exact model, one step ahead
  Vector expected;             // (m) fit [%] of an exact model, at the chosen horizon
  Fit fit;                     // at the chosen horizon
  double inputs =
      0.0;  // RMS of the effect of the inputs within the horizon over that of the errors, largest over the outputs
};
// `options` have the initial state and the first step of the comparison. `spread` (m): RMS of the outputs about their
// nominal trajectory or mean. `moving_outputs`: the outputs that move.
DecidingHorizon deciding_horizon(const Model& model, const Ensemble& data, const Comparison& compared,
                                 const ReportOptions& options, const Vector& spread,
                                 const std::vector<Index>& moving_outputs);

}  // namespace tokid::report
