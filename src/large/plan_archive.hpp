// Serialises plans and surveys of regressions for messages between processes and for journals.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "diagnose/regressions.hpp"
#include "tokid/plan.hpp"

namespace tokid {

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, NoisyChoices>
void fields(Archive& archive, C& c) {
  archive(c.variation, c.state_smoothing, c.weighting, c.refinement_smoothing, c.refinement_iterations);
}

template <class Archive, class P>
requires std::is_same_v<std::remove_const_t<P>, Plan>
void fields(Archive& archive, P& p) {
  archive(p.method, p.lags, p.states, p.initial_state, p.from_full_dimension, p.feedthrough, p.nominal,
          p.nominal_period, p.noisy, p.coupled, p.choices, p.rows, p.cols, p.output_size, p.input_size, p.frame,
          p.reference_step);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, RegressionSurvey>
void fields(Archive& archive, S& s) {
  archive(s.condition_max, s.rank_deficient, s.ill, s.starved, s.unexcited, s.freedom, s.residual, s.square);
}

}  // namespace tokid
