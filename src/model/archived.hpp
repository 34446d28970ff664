// Conversion of models to bytes and back.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <type_traits>

#include "base/archive.hpp"
#include "tokid/model.hpp"

namespace tokid {

template <>
inline constexpr size_t archive::least_bytes<Step> = 6 * sizeof(std::int32_t) + sizeof(Index);  // its dimensions

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Channels>
void fields(Archive& archive, C& c) { archive(c.input_names, c.output_names, c.input_units, c.output_units); }

template <class Archive, class N>
requires std::is_same_v<std::remove_const_t<N>, SharedNumbers>
void fields(Archive& archive, N& numbers) {
  Vector values = numbers.values();
  archive(values);
  if constexpr (!std::is_const_v<N>) {
    numbers = SharedNumbers(values.size());
    std::copy_n(values.data(), values.size(), numbers.own());
  }
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, Step>
void fields(Archive& archive, S& step) {
  archive(step.states_, step.next_states_, step.inputs_, step.outputs_, step.singular_values_, step.parts_,
          step.numbers_);
  if constexpr (!std::is_const_v<S>)
    if (!step.whole()) throw std::runtime_error("a damaged record found");
}

template <class Archive, class V>
requires std::is_same_v<std::remove_const_t<V>, TimeVariation>
void fields(Archive& archive, V& v) { archive(v.smoothing, v.period, v.jumps); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, NoisyChoices>
void fields(Archive& archive, C& c) {
  archive(c.variation, c.state_smoothing, c.weighting, c.refinement_smoothing, c.refinement_iterations, c.delays);
}

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, FeedthroughChoice>
void fields(Archive& archive, C& c) {
  archive(c.present, c.reason);  // as in files: the other members are evidence
}

// The options that a provenance contains.
template <class Archive, class O>
requires std::is_same_v<std::remove_const_t<O>, IdentifyOptions>
void fields(Archive& archive, O& o) {
  // A field more does not compile here until it is archived.
  auto& [states, lags, method, smoothing, feedthrough, period, jumps, delays, weighting, output_weights, horizons,
         refine, initial_state, nominal, frame, reference_step, hold_out, outliers, rows, cols, choices, execution] = o;
  archive(states, lags, method, smoothing, feedthrough, period, jumps, delays, weighting, output_weights, horizons,
          refine, initial_state, nominal, frame, reference_step, hold_out, outliers, rows, cols);
  static_cast<void>(choices), static_cast<void>(execution);  // not part of a provenance
}

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Corrections::Experiment>
void fields(Archive& archive, C& c) { archive(c.label, c.weight); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Corrections::Sample>
void fields(Archive& archive, C& c) { archive(c.label, c.output, c.step, c.value); }

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Corrections>
void fields(Archive& archive, C& c) { archive(c.experiments, c.samples); }

template <class Archive, class P>
requires std::is_same_v<std::remove_const_t<P>, Provenance>
void fields(Archive& archive, P& p) {
  archive(p.options, p.experiments, p.data, p.dt_stated, p.choices, p.refinement, p.corrections, p.feedthrough,
          p.version, p.text, p.unread);
}

template <class Archive, class M>
requires std::is_same_v<std::remove_const_t<M>, Model>
void fields(Archive& archive, M& m) {
  archive(m.inputs, m.outputs, m.k_begin, m.dt, m.step, m.period, m.frame, m.method, m.initial_state, m.names,
          m.u_nominal, m.y_nominal, m.x0_mean, m.x0_cov, m.provenance);
}

}  // namespace tokid
