// An identification whose choices are made already, of a stretch of the steps: what a stream of stretches is made of.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <type_traits>

#include "diagnose/regressions.hpp"
#include "tokid/identify.hpp"

namespace tokid {

// identify() of a part of an ensemble, whose experiments have other numbers there: nothing is said of single ones.
// Where the choices alone are wanted it is not validated.
Identification identify_part(const Ensemble& ensemble, const IdentifyOptions& options, bool validated);

struct Settled {
  // With p, n (0: the rank), what the noisy choices are, and whether a mean motion is removed.
  IdentifyOptions options;
  bool together = false;  // all steps in one regression, which takes options.choices
  bool tvera = false;     // else the subspace realisation
  bool noisy = false;
  InitialState initial_state = InitialState::zero;  // of the experiments
  Vector output_size, input_size;                   // units of TVERA, so that neighbouring stretches have the same
};

struct Stretch {
  Model model;  // counts its steps from the begin of the stretch on, without nominal trajectory
  std::optional<Nominal> nominal;
  Ensemble departures;           // the data less the nominal trajectory
  RegressionSurvey regressions;  // of the steps kept, where they were regressed one by one
};

// `keep_begin` … `keep_end` are the steps of the stretch that the survey is about; `first`: the stretch begins with the
// experiments, else it keeps states from where its regressions begin. \throws as identify()
Stretch identify_stretch(Ensemble data, const Settled& settled, Index keep_begin, Index keep_end, bool first);

// Outputs that a model does not predict.
std::vector<std::string> warnings_of_fit(const Vector& one_step_fit, const Channels& names);

// Of steps of a model, counted from `origin` on, that have fewer states than were asked for, between steps that have
// all of them. Before and behind, states are not reached yet, or not seen any more.
std::vector<std::string> warnings_of_hidden_states(const Model& model, Index origin = 0);

// σ_n / σ_{n+1} of the steps of full dimension, where there are both.
std::vector<double> singular_value_gaps(const Model& model);

// For messages between processes.
template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, NoisyChoices>
void fields(Archive& archive, C& c) {
  archive(c.variation, c.state_smoothing, c.weighting, c.refinement_smoothing, c.refinement_iterations);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, Settled>
void fields(Archive& archive, S& s) {
  auto& o = s.options;
  archive(o.states, o.lags, o.method, o.smoothing, o.weighting, o.refine, o.nominal, o.frame, o.rows, o.cols, o.choices,
          s.together, s.tvera, s.noisy, s.initial_state, s.output_size, s.input_size);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, RegressionSurvey>
void fields(Archive& archive, S& s) {
  archive(s.condition_max, s.rank_deficient, s.ill, s.starved, s.unexcited, s.freedom, s.residual, s.square);
}

}  // namespace tokid
