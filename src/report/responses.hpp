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

// The length of the responses on a page [steps], and the steps at which they start. Without `at` these are evenly
// spaced, and fewer for many channels; one step if all steps are the same. With `at` they are its steps in order, each
// once. \throws std::invalid_argument for steps without a model, or more steps than the page has room for
Index response_length(const Model& model);
std::vector<Index> response_starts(const Model& model, const std::vector<Index>& at = {});

// C (e^{iω dt} I - A)⁻¹ B + D of the frozen system at each chosen step. Chosen are steps at which all modes are valid:
// evenly spaced ones, or those of `at`.
struct FrozenResponses {
  std::vector<Index> steps;                             // (S) chosen steps
  Vector frequencies;                                   // (F) [rad/s], or [rad per step] without a stated sample time
  std::vector<std::vector<Eigen::MatrixXcd>> response;  // (S) of (F) of (m × r)
  Index slow = 0, all = 0;                              // steps at which all modes are valid, and all steps with modes
  double limit = 0.0;                                   // largest variation of a valid mode, as in ModesOptions
  std::vector<Index> left_out;                          // steps of `at` without a response: a mode is not valid there
};
FrozenResponses frozen_responses(const Model& model, const Modes& modes, const std::vector<Index>& at = {});
// The responses of another model with these modes at the steps and frequencies of `own`. Without frequencies at a step
// at which not all of its modes are valid.
std::vector<std::vector<Eigen::MatrixXcd>> frozen_responses_of(const Model& other, const std::optional<Modes>& modes,
                                                               const FrozenResponses& own, double dt);

// Magnitude and phase [rad] of frozen responses: (K) of (F × m·r), column j + m·i for output j and input i. The phase
// has no jumps of 2π over the frequency. Empty matrices for a step without a response.
struct FrozenCurves {
  std::vector<Matrix> magnitude, phase;
};
FrozenCurves frozen_curves(const std::vector<std::vector<Eigen::MatrixXcd>>& response);

// The modes of a page, with the options of the frozen responses; empty if the model has no states, or too few steps.
std::optional<Modes> modes_of_page(const Model& model);
// The row of step k in the modes of a model; -1 if they do not have it. A periodic model goes on.
Index row_of(const Model& model, const Modes& modes, Index k);

}  // namespace tokid::report
