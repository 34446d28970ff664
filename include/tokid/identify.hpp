// Identification in one call: ensemble → GTV-ARX → Markov parameters → model, with the choice of the orders.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/copies.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/options.hpp"
#include "tokid/outlier.hpp"
#include "tokid/plan.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/validate.hpp"

namespace tokid {

struct Identification {
  Model model;
  Plan plan;
  Index experiments = 0, steps = 0;  // number of experiments and steps used for the identification
  // Fewest experiments for a regression at each step with the lag order p = plan.lags: minimum_experiments(), plus one
  // if a nominal trajectory is estimated
  Index min_experiments = 0;
  Index rank_deficient_steps = 0;  // of the regressions of single steps
  double condition_max = 0.0;      // of the regressions of single steps; 0 if all steps are in one regression
  NominalTest nominal_test;        // filled if the choice was automatic
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;   // filled if p was chosen with a regression for each step
  SmoothingChoice smoothing_choice;  // filled if p and λ were chosen together
  OrderScores order_scores;
  RefinementChoice refinement;
  // Empty: the choices were not cross-validated, or the steps share their matrices periodically.
  std::optional<RegressionComparison> comparison;
  // Median of the ratio σ_n / σ_{n+1} of singular values over the steps of full dimension. A large ratio confirms n.
  // NaN if not known.
  double singular_value_gap = std::numeric_limits<double>::quiet_NaN();
  bool held_out = false;           // true: `validation` uses held-out data; false: the training data
  Index held_out_experiments = 0;  // their number; 0 also if the end of a single record is held out
  Validation validation;
  // Outliers, with their rows in the whole data. Empty with fewer than five experiments.
  std::vector<Outlier> outliers;
  // Copies, with their rows in the whole data.
  Copies copies;
  // Rows of the experiments that were used, before outliers were dropped. Empty: all.
  std::vector<Index> used;
  Findings findings;
  double seconds = 0.0;  // of the whole call
};

// Gets the first model of an identification: the subspace model, before EM refines it. Only noisy data have it.
using OnModel = std::function<void(Model)>;

// Identifies a model. `on_model` is called at most once, in the calling thread, with the first model. It is not called
// if no EM follows. Its exceptions end the identification, as those of `execution.progress` do.
// \throws as Ensemble::check(), and std::invalid_argument for too few experiments or steps, or too little excitation.
// For too few experiments, the message states the p that their number permits.
Identification identify(const Ensemble& ensemble, const IdentifyOptions& options = {}, const OnModel& on_model = {});

}  // namespace tokid
