// Decides how a model is evaluated: by its simulation, or by predictions over fewer steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "model/comparison.hpp"

namespace tokid::report {

// If the noise that the model states spoils the simulation of an exact model too, the simulation says nothing about the
// model. Then predictions evaluate it, over the most steps that an exact model would predict well. A model with wrong
// effects of the inputs spoils its simulation by these, so its simulation evaluates it.
struct DecidingHorizon {
  Index steps = 0;             // 0: the simulation
  bool stated = false;         // the covariances are the model's own, not those of the innovations at hand
  Vector expected_simulation;  // (m) fit [%] of an exact model; empty where it could not be computed
  Vector expected_one_step;    // (m) the same one step ahead
  Vector expected;             // (m) the same at the chosen horizon
  Fit fit;                     // at the chosen horizon
  Ensemble computed;           // outputs at the chosen horizon
  double inputs =
      0.0;  // RMS of the effect of the inputs within the horizon over that of the errors, largest over the outputs
};
// `spread` (m): RMS of the outputs about their nominal trajectory or mean. `moving_outputs`: the outputs that move.
DecidingHorizon deciding_horizon(const Model& model, const Ensemble& data, const Comparison& compared,
                                 std::optional<InitialState> initial_state, const Vector& spread,
                                 const std::vector<Index>& moving_outputs, const Conclusions& conclusions);

}  // namespace tokid::report
