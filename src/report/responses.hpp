// Responses of a model to pulses and steps of its inputs at chosen steps, and its frequency responses with the time
// frozen.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/modes.hpp"
#include "tokid/report.hpp"

namespace tokid::report {

// Responses from zero states. A pulse is 1 at its step and 0 elsewhere. A step is 1 from its step on.
struct Responses {
  std::vector<Index> starts;  // (S) the steps at which the inputs begin to act
  Index length = 0;           // L: outputs at start, start+1, … start+L-1
  // (S) of (L × m·r): column j + m·i has output j for input i. NaN at steps without a model.
  std::vector<Matrix> pulse, step;
};
Responses responses(const Model& model, const std::vector<Index>& starts, Index length);

// The length of the responses on a page [steps], and the steps at which they start: evenly spaced, and fewer for many
// channels. One step if all steps are the same.
Index response_length(const Model& model);
std::vector<Index> response_starts(const Model& model);

// C (e^{iω dt} I - A)⁻¹ B + D of the frozen system at each chosen step. Chosen are evenly spaced steps at which all
// modes are valid.
struct FrozenResponses {
  std::vector<Index> steps;                             // (S) chosen steps
  Vector frequencies;                                   // (F) [rad/s], or [rad per step] without a stated sample time
  std::vector<std::vector<Eigen::MatrixXcd>> response;  // (S) of (F) of (m × r)
  Index slow = 0, all = 0;                              // steps at which all modes are valid, and all steps with modes
  double limit = 0.0;                                   // largest variation of a valid mode, as in ModesOptions
};
FrozenResponses frozen_responses(const Model& model, const Modes& modes);

// The modes of a page, with the options of the frozen responses; empty if the model has no states, or too few steps.
std::optional<Modes> modes_of_page(const Model& model);

}  // namespace tokid::report
