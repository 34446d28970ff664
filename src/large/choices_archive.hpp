// Serialises the choices of an identification, with the tests and errors behind them, for messages between processes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "large/plan_archive.hpp"
#include "tokid/identify.hpp"

namespace tokid {

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, InitialStateTest>
void fields(Archive& archive, T& t) { archive(t.statistic, t.threshold, t.decision, t.reason); }

template <class Archive, class E>
requires std::is_same_v<std::remove_const_t<E>, LagOrderErrors>
void fields(Archive& archive, E& e) { archive(e.steps, e.error, e.mean, e.best); }

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, SmoothingTrial>
void fields(Archive& archive, T& t) { archive(t.lags, t.smoothing, t.error); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, SmoothingChoice>
void fields(Archive& archive, C& c) { archive(c.trials, c.lags, c.smoothing, c.error); }

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, OrderScores>
void fields(Archive& archive, S& s) {
  archive(s.states, s.one_step, s.ahead, s.simulation, s.cross_validated, s.smoothing, s.weighting, s.price, s.smallest,
          s.uncertainty, s.best);
}

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, RefinementTrial>
void fields(Archive& archive, T& t) {
  archive(t.states, t.smoothing, t.iterations, t.error, t.log_likelihood, t.jumps);
}

template <class Archive, class J>
requires std::is_same_v<std::remove_const_t<J>, Jump>
void fields(Archive& archive, J& j) { archive(j.step, j.loss); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, AheadCertainty>
void fields(Archive& archive, C& c) { archive(c.ratio, c.model_share); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, RefinementChoice>
void fields(Archive& archive, C& c) {
  archive(c.trials, c.states, c.smoothing, c.first_smoothing, c.iterations, c.error, c.one_step, c.jumps, c.ahead,
          c.ahead_without_em);
}

// The model and the choices. The nominal test, the validation and the findings are left out, because an identification
// of a stretch has none.
template <class Archive, class R>
requires std::is_same_v<std::remove_const_t<R>, Identification>
void fields(Archive& archive, R& r) {
  archive(r.model, r.plan, r.experiments, r.steps, r.min_experiments, r.rank_deficient_steps, r.condition_max,
          r.initial_state_test, r.lag_order_errors, r.smoothing_choice, r.order_scores, r.refinement,
          r.singular_value_gap);
  // The archive of a plan has no evidence for the feedthrough.
  auto& feedthrough = r.plan.feedthrough;
  archive(feedthrough.response_p, feedthrough.feedback_p, feedthrough.input, feedthrough.output);
}

}  // namespace tokid
