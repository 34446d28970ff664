// What a user may ask of an identification, and its text in a model.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "tokid/plan.hpp"

namespace tokid {

enum class NominalChoice { automatic, none, mean };

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
