// The options of an identification, and their text in a model.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "tokid/plan.hpp"

namespace tokid {

enum class NominalChoice { none, mean };

// An empty option is chosen by the identification.
struct IdentifyOptions {
  // n. Empty: the rank of each H_k if the data are free of noise, else the order with the smallest prediction and
  // simulation errors.
  std::optional<Index> states = {};
  // p. Empty: the order with the smallest cross-validation error, chosen together with λ if the data are noisy.
  std::optional<Index> lags = {};
  // Empty: TVERA for data without noise from zero initial states, else the subspace realisation.
  std::optional<Method> method = {};
  // λ of the penalty on variation over time. Infinity: one model for all steps. TVERA has no λ. Empty: by
  // cross-validation if the data are noisy or too few for a regression at each step.
  std::optional<double> smoothing = {};
  bool feedthrough = true;  // false: D_k = 0 is known, the outputs do not answer to the inputs of the same step
  Index period = 0;         // P: the steps k, k+P, … share one model; 1: time-invariant; 0: each step has its own
  // Weighting of the subspace realisation. Empty: by cross-validation if steps share a model, else one_step.
  std::optional<Weighting> weighting = {};
  // Maximum likelihood by EM, as far as it lowers the cross-validation error. Empty: true if the data are noisy and the
  // realisation is the subspace one.
  std::optional<bool> refine = {};
  std::optional<InitialState> initial_state = {};  // empty: as the data state it, else by a test of the first residuals
  std::optional<NominalChoice> nominal = {};       // empty: mean if the mean motion is significant, else none
  Frame frame = Frame::raw;
  std::optional<Index> reference_step = {};  // s of the reference frame; empty: the first step of full dimension
  double hold_out = 0.0;                     // held-out share of the experiments, for validation, 0 ≤ share < 1
  // Blocks of H_k. Empty: max(p, ⌈n/m⌉)+1 and max(p, n), or with noise max(p, 48).
  std::optional<Index> rows = {}, cols = {};
  // Choices of an earlier identification of the same kind, to use again with its `lags` and `states`; empty: choose
  // anew.
  std::optional<NoisyChoices> choices = {};
  Execution execution = {};
};

// The text of Model::options: every option but the execution, and the number of experiments used. An option has the
// value "auto" if the identification made the choice.
std::string to_json(const IdentifyOptions& options, Index experiments);

// The options that a model was identified with. Options that its text does not contain have their defaults.
// \throws std::invalid_argument where the model has no options, or an option is unknown or has a value of the wrong
// type
IdentifyOptions identify_options(const Model& model);

// Model::options also stores the choices.
void note_choices(Model& model, const NoisyChoices& choices);
std::optional<NoisyChoices> noted_choices(const Model& model);

}  // namespace tokid
