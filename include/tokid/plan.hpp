// The plan of an identification: its decisions between the departures and the model. regressions() and realise() make
// the model of a plan from windows. Whole ensembles, blocks and updates use these two functions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "tokid/finding.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"
#include "tokid/options.hpp"
#include "tokid/tvera.hpp"
#include "tokid/windows.hpp"

namespace tokid {

struct Plan {
  Method method = Method::subspace;
  Index lags = 0;                                   // p
  Index states = 0;                                 // n; 0: the rank of each H_k
  InitialState initial_state = InitialState::zero;  // initial states of the experiments
  // true: with unknown initial states, the model begins at the first step of full dimension. false: the model begins
  // with its regressions. Blocks in the middle of a record use false, because the block before contains the earlier
  // steps.
  bool from_full_dimension = true;
  FeedthroughChoice feedthrough = {};
  bool nominal = false;      // a mean motion was removed, which uses one degree of freedom
  Index nominal_period = 0;  // P: the steps k, k+P, … share this mean motion; 0: each step has its own
  bool noisy = false;        // true: residuals exceed rounding errors
  bool coupled = false;      // true: one regression of all steps with `choices`; false: one for each step
  NoisyChoices choices = {};
  std::optional<Index> rows = {}, cols = {};  // blocks of H_k; empty: the number that p lags and n states need
  Vector output_size, input_size;             // (m), (r): units in which TVERA forms H_k
  Vector output_weights;                      // (m) weights of the outputs over the largest; empty: all alike
  Frame frame = Frame::raw;                   // coordinates of the model
  std::optional<Index> reference_step = {};   // step of the reference frame; empty: the first with all n states
};

// Was a mean motion removed that was estimated from all experiments at each step?
bool is_centred(const Plan& plan);

// The regressions (16)-(19), of each step alone or of all steps coupled. \throws std::invalid_argument as gtv_arx() and
// smooth_arx()
GtvArx regressions(const Windows& windows, const Plan& plan, const Execution& execution = {});

// The model from the regressions: (28)-(42), the subspace realisation, or the regressions in observer form. EM is not
// applied, and the coordinates are those of the realisation. Only TVERA uses the free responses.
// \throws std::invalid_argument as markov(), tvera(), subspace() and observer_form()
Model realise(const Windows& windows, GtvArx arx, const FreeResponse& free, const Plan& plan,
              const Execution& execution = {});

// Block rows and columns of H_k from the plan.
TveraOptions tvera_options(const Plan& plan, Index outputs);

// Adds to a TVERA model the information from its regressions: covariances of the innovations, condition numbers, ranks
// and lags, dt, names and initial state. \throws std::invalid_argument if `arx` has other steps or channels than the
// model
Model completed(Model model, const Windows& windows, const GtvArx& arx, const Plan& plan);

// Sets the initial state of the model. From an unknown initial state, the model can compute states only from the first
// step of full dimension on. Such a model therefore begins at this step, unless it has a period.
Model from_known_state(Model model, InitialState initial);

// The step s of the plan's reference frame.
Index frame_step(const Model& model, const Plan& plan);
// The model in the coordinates of the plan. `begin` and `end` are the range of steps in these coordinates; a reference
// frame does not include all steps.
FramedModel in_frame(Model model, const Plan& plan);
// Finding about the steps that are not in the reference frame of step s.
Findings findings_of_frame(const FramedModel& framed, Index s, const Plan& plan);

}  // namespace tokid
