// What an identification has decided between the departures and the model, and what a plan makes of windows:
// regressions, and from them the model. Whole ensembles, blocks and updates use the same two functions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/choices.hpp"
#include "tokid/finding.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"
#include "tokid/tvera.hpp"
#include "tokid/windows.hpp"

namespace tokid {

enum class Frame { raw, reference, smooth };
// automatic: TVERA for data without noise from zero initial states, else the subspace realisation
enum class Method { automatic, tvera, subspace };

struct Plan {
  Method method = Method::subspace;                 // tvera or subspace
  Index lags = 0;                                   // p
  Index states = 0;                                 // n; 0: the rank of each H_k
  InitialState initial_state = InitialState::zero;  // of the experiments
  // A model whose initial states are unknown begins where all of its state is seen; blocks in the middle of a record
  // begin where their regressions do, as their neighbours hold the steps before.
  bool from_full_dimension = true;
  bool nominal = false;      // a mean motion was removed, which costs an experiment
  Index nominal_period = 0;  // P: the steps k, k+P, … share that motion; 0: every step has its own
  bool noisy = false;        // residuals beyond rounding errors
  bool coupled = false;      // one regression of all steps, with `choices`; else one for each step
  NoisyChoices choices = {};
  Index rows = 0, cols = 0;        // blocks of H_k; 0: as many as p lags and n states need
  Vector output_size, input_size;  // (m), (r): units in which TVERA forms H_k
  Frame frame = Frame::raw;        // coordinates of the model
  Index reference_step = -1;       // s of the reference frame; -1: the first step of full dimension
};

// (16)-(19): of each step alone, or of all steps coupled. \throws std::invalid_argument as gtv_arx() and smooth_arx()
GtvArx regressions(const Windows& windows, const Plan& plan, const Execution& execution = {});

// (28)-(42), or the subspace realisation; without EM, and in the coordinates that the realisation gives. Free responses
// serve TVERA alone. \throws std::invalid_argument as markov(), tvera() and subspace()
Model realise(const Windows& windows, GtvArx arx, const FreeResponse& free, const Plan& plan,
              const Execution& execution = {});

// Block rows and columns of H_k by the plan.
TveraOptions tvera_options(const Plan& plan, Index outputs);

// A TVERA model of these regressions with what they tell: covariances of the innovations, condition numbers, ranks and
// lags of the regressions, dt, names and initial state.
Model completed(Model model, const Windows& windows, const GtvArx& arx, const Plan& plan);

// A model of experiments with such initial states. Unknown ones can be followed only from where all of the state is
// seen: the model begins there.
Model from_known_state(Model model, InitialState initial);

// s of the plan's reference frame.
Index frame_step(const Model& model, const Plan& plan);
// In the coordinates that the plan asks for. `begin` and `end` are the steps that are in them: all but those that a
// reference frame does not reach.
FramedModel in_frame(Model model, const Plan& plan);
// Where the reference frame of step s ends.
Findings findings_of_frame(const FramedModel& framed, Index s, const Plan& plan);

}  // namespace tokid
