// The tests and errors that decide the choices of an identification from noisy data.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "tokid/options.hpp"

namespace tokid {

// The test of the initial state. It compares the residuals of the steps k < p with those of later steps, which the
// initial state does not affect.
struct InitialStateTest {
  double statistic = 0.0;  // largest ratio of an early residual variance to the later one, over steps and outputs
  double threshold = 0.0;
  InitialState decision = InitialState::zero;
  std::string reason;
};

// The errors of each state dimension. They are filled where n was chosen from noisy data.
struct OrderScores {
  static constexpr Index horizon = 10;  // H of `ahead`
  std::vector<Index> states;
  // Logs of the RMS error over the RMS of the departures, mean over the outputs.
  std::vector<double> one_step, ahead, simulation;
  bool cross_validated = false;  // true: cross-validation errors (subspace); false: errors on the training data (TVERA)
  double smoothing = 0.0;        // λ of the regressions on states that gave these errors
  Weighting weighting = Weighting::one_step;
  double price = 0.0;  // penalty for each state on the training data: 2/3 (r+m) / (N m)
  double smallest = std::numeric_limits<double>::infinity();  // smallest mean
  // Standard error, over the folds, of the difference from the order with the smallest mean. Empty for errors on the
  // training data.
  std::vector<double> uncertainty;
  // The smallest order whose mean exceeds the smallest mean by no more than a margin. The margin is this standard
  // error, but at least 0.5 % and at most 2 %.
  Index best = 0;

  void add(Index n, double one_step_error, double ahead_error, double simulation_error);
  // The mean of the three logs, with weight 3 for one_step, plus the penalty for the states.
  double mean(size_t i) const;
  void choose();
};

// The cross-validation of EM, filled where EM was tried.
struct RefinementTrial {
  Index states = 0;        // n
  double smoothing = 0.0;  // λ of EM
  Index iterations = 0;    // 0: the subspace model without EM
  double error = 0.0;      // mean log as in OrderScores
};
struct RefinementChoice {
  static constexpr double worth_it = 1.005;  // the errors must fall by this factor
  std::vector<RefinementTrial> trials;
  // n: OrderScores::best, unless fewer states do as well after EM, or missing samples hid some states from OrderScores
  Index states = 0;
  double smoothing = 0.0;
  Index iterations = 0;  // 0: no refinement
  double error = 0.0;
  double one_step = 0.0;  // log of the one-step error alone; set if there are iterations
};

}  // namespace tokid
