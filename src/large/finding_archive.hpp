// Serialises findings and outliers for messages between processes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/archive.hpp"
#include "tokid/finding.hpp"
#include "tokid/outlier.hpp"

namespace tokid {

template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Finding::Channel>
void fields(Archive& archive, C& c) { archive(c.output, c.index, c.name); }

template <class Archive, class E>
requires std::is_same_v<std::remove_const_t<E>, Finding::Experiment>
void fields(Archive& archive, E& e) { archive(e.row, e.name); }

template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, Finding::Term>
void fields(Archive& archive, T& t) { archive(t.channel, t.lag, t.factor); }

template <class Archive, class F>
requires std::is_same_v<std::remove_const_t<F>, Finding>
void fields(Archive& archive, F& f) {
  archive(f.kind, f.scope, f.channels, f.experiments, f.steps, f.numbers, f.terms, f.groups, f.names, f.detail, f.file);
}

template <class Archive, class O>
requires std::is_same_v<std::remove_const_t<O>, Outlier>
void fields(Archive& archive, O& o) { archive(o.experiment, o.ratio, o.name, o.outputs, o.weight, o.held_out); }

}  // namespace tokid
