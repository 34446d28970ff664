// The frozen system of one step, in coordinates that a window of outputs defines.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid::modes_of {

// The steps whose modes are computed: of a model that goes on, the last period and the steps before it with as many
// states. The period of another model is 0.
Model lasting(Model model);

// A window to compare with: about half of it, or twice if it is the shortest that can determine the state. An even
// number of steps; 0 if the model, which is lasting(), is too short for twice the window.
Index other_window(const Model& model, Index window);

// Has the model states, and enough steps for a window? 0: the window that Frozen chooses.
// \throws std::invalid_argument for an odd or too short window
bool has_window(const Model& model, Index window);

// The windows of outputs of one model. A periodic model is extended, so that all its steps have windows.
class Frozen {
 public:
  // \throws std::invalid_argument for an odd or too short window, a model with too few steps, or a period within which
  // the state dimension changes
  Frozen(const Model& model, Index window);

  Index window() const { return 2 * half_; }
  Index begin() const { return begin_; }  // first step with modes
  Index count() const { return count_; }  // number of steps with modes
  Index states() const { return model_.states(); }
  // The systems of `count` steps, from step `first` on; without states where a window does not determine the state.
  // B, D and the observer gains are zero.
  std::vector<Step> systems(Index first, Index count) const;
  // The system of step k with B and D, which are means around k like A. B is the least-squares fit of the outputs after
  // pulses at these steps. This needs no inverse of A, which delays make singular.
  Step whole(Index k) const;

 private:
  Index reach_of(Index k) const;  // steps on either side of k in the means
  // The scaled outputs of a system without inputs over some steps (steps·m × n).
  Matrix answers(const Step& system, Index steps) const;
  Matrix observed(Index j) const;  // O_j of the scaled outputs (W·m × n)
  Step system(Index k, Index reach, const std::vector<Matrix>& observed, Index from) const;

  Model model_;
  Index half_ = 1, begin_ = 0, count_ = 0;
  Index shift_ = 0;             // a step k has its windows at k + shift_
  Index first_ = 0, last_ = 0;  // steps of the extended model with a window
  Vector scale_;                // (m) sizes of the outputs
};

}  // namespace tokid::modes_of
