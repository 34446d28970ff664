// Serialises the choices of an identification, with the tests and errors behind them, for messages between processes.
// The structured bindings fail to compile if a member is added and not named here.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "large/plan_archive.hpp"
#include "tokid/identify.hpp"

namespace tokid {

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, InitialStateTest>
void fields(Archive& archive, T& t) {
  auto& [statistic, threshold, decision, reason] = t;
  archive(statistic, threshold, decision, reason);
}

template <class Archive, class E>
requires std::is_same_v<std::remove_const_t<E>, LagOrderErrors>
void fields(Archive& archive, E& e) {
  auto& [steps, error, mean, best] = e;
  archive(steps, error, mean, best);
}

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, SmoothingTrial>
void fields(Archive& archive, T& t) {
  auto& [lags, smoothing, error] = t;
  archive(lags, smoothing, error);
}

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, SmoothingChoice>
void fields(Archive& archive, C& c) {
  auto& [trials, lags, smoothing, error] = c;
  archive(trials, lags, smoothing, error);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, OrderScores>
void fields(Archive& archive, S& s) {
  auto& [states, one_step, ahead, simulation, cross_validated, smoothing, weighting, price, smallest, uncertainty,
         best] = s;
  archive(states, one_step, ahead, simulation, cross_validated, smoothing, weighting, price, smallest, uncertainty,
          best);
}

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, RefinementTrial>
void fields(Archive& archive, T& t) {
  auto& [states, smoothing, iterations, error, log_likelihood] = t;
  archive(states, smoothing, iterations, error, log_likelihood);
}

template <class Archive, class J>
requires std::is_same_v<std::remove_const_t<J>, Jump>
void fields(Archive& archive, J& j) {
  auto& [step, loss] = j;
  archive(step, loss);
}

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, AheadCertainty>
void fields(Archive& archive, C& c) {
  auto& [ratio, model_share] = c;
  archive(ratio, model_share);
}

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, RefinementChoice>
void fields(Archive& archive, C& c) {
  auto& [trials, states, smoothing, first_smoothing, iterations, error, one_step, jumps, ahead, ahead_without_em] = c;
  archive(trials, states, smoothing, first_smoothing, iterations, error, one_step, jumps, ahead, ahead_without_em);
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
