// What an identification from noisy data chooses, and by which errors.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "tokid/subspace.hpp"
#include "tokid/types.hpp"

namespace tokid {

// What an identification from noisy data has chosen beside p and n.
struct NoisyChoices {
  TimeVariation variation;
  double state_smoothing = 0.0;  // λ of the regressions on states
  Weighting weighting = Weighting::one_step;
  double refinement_smoothing = 0.0;  // λ of EM
  Index refinement_iterations = 0;    // 0: no refinement
};

// How the residuals of the steps k < p compare with the later ones, which the initial state can't reach.
struct InitialStateTest {
  double statistic = 0.0;  // largest ratio of an early to the later residual variance, over steps and outputs
  double threshold = 0.0;
  InitialState decision = InitialState::zero;
  std::string reason;
};

// What each order made of the data; filled where the order was chosen from noisy data.
struct OrderScores {
  static constexpr Index horizon = 10;  // H of `ahead`
  std::vector<Index> states;
  std::vector<double> one_step, ahead, simulation;  // RMS error over that of the departures, mean logs over outputs
  bool cross_validated = false;  // on experiments left out (subspace), else on the training data (TVERA)
  double smoothing = 0.0;        // λ of the regressions on states at which they were found
  Weighting weighting = Weighting::one_step;
  double price = 0.0;                                         // of a state: 2/3 (r+m) / (N m) on the training data
  double smallest = std::numeric_limits<double>::infinity();  // mean
  // Of the difference from the order of the smallest mean, over the folds; empty on training data.
  std::vector<double> uncertainty;
  Index best = 0;  // the smallest order whose mean is within that uncertainty, and 0.5 to 2 %, of the smallest

  void add(Index n, double one_step_error, double ahead_error, double simulation_error);
  double mean(size_t i) const;  // of the three logs, one_step thrice, and the price of the states
  void choose();
};

// How far EM brought the models of experiments forward on others; filled where that was tried.
struct RefinementTrial {
  Index states = 0;        // n
  double smoothing = 0.0;  // λ of EM
  Index iterations = 0;    // 0: the subspace model as it was
  double error = 0.0;      // mean log as of OrderScores
};
struct RefinementChoice {
  static constexpr double worth_it = 1.005;  // fall of the errors
  std::vector<RefinementTrial> trials;
  Index states = 0;  // n: OrderScores::best, unless fewer do as well after EM, or missing samples hid some from it
  double smoothing = 0.0;
  Index iterations = 0;  // 0: no refinement
  double error = 0.0;
  double one_step = 0.0;  // the log of the one-step error alone, where there are iterations
};

}  // namespace tokid
