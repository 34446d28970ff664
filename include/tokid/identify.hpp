// The pipeline in one call: ensemble → GTV-ARX → Markov parameters → model, and the choice of orders.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/copies.hpp"
#include "tokid/dependence.hpp"
#include "tokid/options.hpp"
#include "tokid/outlier.hpp"
#include "tokid/validate.hpp"

namespace tokid {

struct Identification {
  Model model;
  Plan plan;
  Index experiments = 0, steps = 0;  // used for identification
  Index min_experiments = 0;         // N_min at this p, one more where a nominal trajectory is estimated
  Index rank_deficient_steps = 0;    // of regressions step by step
  double condition_max = 0.0;        // of the same; 0 where all steps are in one regression
  NominalTest nominal_test;          // filled where the choice was automatic
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;   // filled where p was chosen step by step
  SmoothingChoice smoothing_choice;  // filled where p and λ were chosen together
  OrderScores order_scores;
  RefinementChoice refinement;
  // σ_n / σ_{n+1} of the steps of full dimension, their median: how clearly the order shows; NaN where it does not
  double singular_value_gap = std::numeric_limits<double>::quiet_NaN();
  bool held_out = false;  // else `validation` is on the training data
  Validation validation;
  // Among all experiments of the data, numbered as there. Looked for where there is noise, and five of them or more.
  std::vector<Outlier> outliers;
  // Among all experiments of the data: each was used once, and those that are made of others were not.
  Copies copies;
  Dependence dependent;
  Findings findings;
  double seconds = 0.0;
};

// \throws std::invalid_argument that names what the data lack: experiments (and which p would do), steps, excitation
Identification identify(const Ensemble& ensemble, const IdentifyOptions& options = {});

}  // namespace tokid
