// Serialises plans and surveys of regressions, for messages between processes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "diagnose/regressions.hpp"
#include "model/archived.hpp"
#include "tokid/plan.hpp"

namespace tokid {

template <class Archive, class P>
requires std::is_same_v<std::remove_const_t<P>, Plan>
void fields(Archive& archive, P& p) {
  archive(p.method, p.lags, p.states, p.initial_state, p.from_full_dimension, p.feedthrough, p.nominal,
          p.nominal_period, p.noisy, p.coupled, p.choices, p.rows, p.cols, p.output_size, p.input_size,
          p.output_weights, p.frame, p.reference_step);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, RegressionSurvey>
void fields(Archive& archive, S& s) {
  archive(s.condition_max, s.rank_deficient, s.ill, s.starved, s.unexcited, s.freedom, s.residual, s.square);
}

}  // namespace tokid
