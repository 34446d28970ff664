// The matrices of a step by name, for files and other languages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

enum class Dimension { next_states, states, inputs, outputs };  // n_{k+1}, n_k, r, m

struct StepField {
  const char* name;
  Step::View (Step::*view)() const;
  bool (*known)(const Step&);
  void (*set)(Step&, const Matrix&);  // the value must have the shape of this matrix in the step
  Dimension rows, cols;
  bool optional;
};

namespace step_fields {

template <bool (Step::*has)() const>
bool known(const Step& step) {
  return (step.*has)();
}
template <void (Step::*part)(const Matrix&)>
void set(Step& step, const Matrix& value) {
  (step.*part)(value);
}
constexpr auto always = [](const Step&) { return true; };
template <Step::Writable (Step::*part)()>
void write(Step& step, const Matrix& value) {
  (step.*part)() = value;
}

using enum Dimension;
inline constexpr std::array all{
    StepField{"A", &Step::A, always, write<&Step::A>, next_states, states, false},
    StepField{"B", &Step::B, always, write<&Step::B>, next_states, inputs, false},
    StepField{"C", &Step::C, always, write<&Step::C>, outputs, states, false},
    StepField{"D", &Step::D, always, write<&Step::D>, outputs, inputs, false},
    StepField{"G", &Step::G, always, write<&Step::G>, next_states, outputs, false},
    StepField{"innovation_cov", &Step::innovation_cov, known<&Step::has_innovation_cov>, set<&Step::set_innovation_cov>,
              outputs, outputs, true},
    StepField{"Q", &Step::Q, known<&Step::has_Q>, set<&Step::set_Q>, next_states, next_states, true},
    StepField{"R", &Step::R, known<&Step::has_R>, set<&Step::set_R>, outputs, outputs, true},
    StepField{"K", &Step::K, known<&Step::has_K>, set<&Step::set_K>, states, outputs, true}};

}  // namespace step_fields

inline bool has(const Model& model, const StepField& field) {
  return !model.step.empty() && field.known(model.step.front());
}

// The values of all steps; empty if the steps do not have this part.
template <class Value>
std::vector<Value> known_values(const Model& model, bool (Step::*known)() const, Value (Step::*get)() const) {
  std::vector<Value> values;
  if (!model.has(known)) return values;
  values.reserve(model.step.size());
  for (const Step& step : model.step) values.push_back((step.*get)());
  return values;
}

// n_k, k_begin ≤ k ≤ k_end
inline std::vector<Index> state_dimensions(const Model& model) {
  std::vector<Index> result;
  for (Index k = model.k_begin; k <= model.k_end(); ++k) result.push_back(model.n(k));
  return result;
}

// Size of a dimension at a step.
inline Index size(const Step& step, Dimension dimension) {
  switch (dimension) {
    case Dimension::next_states:
      return step.next_states();
    case Dimension::states:
      return step.states();
    case Dimension::inputs:
      return step.inputs();
    default:
      return step.outputs();
  }
}

// Size of a dimension in the matrices of all steps, padded to one size.
inline Index padded_size(const Model& model, Dimension dimension, Index states) {
  return dimension == Dimension::inputs ? model.inputs : dimension == Dimension::outputs ? model.outputs : states;
}

}  // namespace tokid
