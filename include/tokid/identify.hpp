// The pipeline in one call: ensemble → GTV-ARX → Markov parameters → model, and the choice of orders.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/copies.hpp"
#include "tokid/dependence.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"
#include "tokid/outlier.hpp"
#include "tokid/validate.hpp"

namespace tokid {

enum class NominalChoice { automatic, none, mean };
enum class Frame { raw, reference, smooth };
// automatic: TVERA for data without noise from zero initial states, else the subspace realisation
enum class Method { automatic, tvera, subspace };

struct IdentifyOptions {
  // n; 0: the rank of each H_k where the data are free of noise, else the order that predicts and simulates best
  Index states = 0;
  Index lags = 0;  // p; 0: the smallest error on experiments left out, together with λ where the data are noisy
  Method method = Method::automatic;
  // λ of the penalty on variation in time; negative: by cross-validation where the data are noisy or too few for a
  // regression at each step; infinity: one model for all steps. TVERA has none.
  double smoothing = -1.0;
  Index period = 0;  // P: the steps k, k+P, … share one model; 1: time-invariant; 0: every step has its own
  // Of the subspace realisation; empty: by errors on experiments left out where steps share a model, else one_step.
  std::optional<Weighting> weighting = {};
  // Maximum likelihood by EM, as far as it helps on experiments left out; empty: where the data are noisy and the
  // realisation is the subspace one.
  std::optional<bool> refine = {};
  std::optional<InitialState> initial_state =
      {};  // empty: as the data say, else by test on the residuals of the first steps
  NominalChoice nominal = NominalChoice::automatic;
  Frame frame = Frame::raw;
  Index reference_step = -1;  // s of the reference frame; -1: the first step of full dimension
  double hold_out = 0.0;      // share of the experiments kept for validation, 0 ≤ share < 1
  Index rows = 0, cols = 0;   // blocks of H_k; 0: max(p, ⌈n/m⌉)+1 and max(p, n), or with noise max(p, 48)
  // Of an earlier identification of the same kind, to be followed with its `lags` and `states`; empty: made anew.
  std::optional<NoisyChoices> choices = {};
  Execution execution = {};
};

// How the residuals of the steps k < p compare with the later ones, which the initial state can't reach.
struct InitialStateTest {
  double statistic = 0.0;  // largest ratio of an early to the later residual variance, over steps and outputs
  double threshold = 0.0;
  InitialState decision = InitialState::zero;
  std::string reason;
};

struct Identification {
  Model model;
  Index experiments = 0, steps = 0;  // used for identification
  Index lags = 0;                    // p
  TimeVariation variation;           // λ and P
  double state_smoothing = 0.0;      // λ of the regressions on states
  Index min_experiments = 0;         // N_min at this p, one more where a nominal trajectory is estimated
  Index rank_deficient_steps = 0;    // of regressions step by step
  double condition_max = 0.0;        // of the same; 0 where all steps are in one regression
  NominalTest nominal_test;          // filled where the choice was automatic
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;   // filled where p was chosen step by step
  SmoothingChoice smoothing_choice;  // filled where p and λ were chosen together
  OrderScores order_scores;
  RefinementChoice refinement;
  std::optional<NoisyChoices> choices;  // where all steps were regressed together
  bool together = false;                // all steps in one regression, else one for each
  bool noisy = false;                   // residuals beyond rounding errors
  bool nominal = false;                 // a mean motion was removed
  // σ_n / σ_{n+1} of the steps of full dimension, their median: how clearly the order shows; NaN where it does not
  double singular_value_gap = std::numeric_limits<double>::quiet_NaN();
  bool held_out = false;  // else `validation` is on the training data
  Validation validation;
  // Among all experiments of the data, numbered as there. Looked for where there is noise, and five of them or more.
  std::vector<Outlier> outliers;
  // Among all experiments of the data: each was used once, and those that are made of others were not.
  Copies copies;
  Dependence dependent;
  std::vector<std::string> warnings;
  double seconds = 0.0;
};

// \throws std::invalid_argument that names what the data lack: experiments (and which p would do), steps, excitation
Identification identify(const Ensemble& ensemble, const IdentifyOptions& options = {});

// What Model::options holds: every option but the execution, "auto" where the choice was left to the identification,
// and the number of experiments that were used.
std::string to_json(const IdentifyOptions& options, Index experiments);

// The options that a model was identified with; those that its text does not name have their defaults.
// \throws std::invalid_argument where the model holds none, or one that is not known or has another kind of value
IdentifyOptions identify_options(const Model& model);

// Beside the options Model::options remembers what was chosen.
void note_choices(Model& model, const NoisyChoices& choices);
std::optional<NoisyChoices> noted_choices(const Model& model);

}  // namespace tokid
