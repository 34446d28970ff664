// Model, ensemble → the initial states that hold: those that the caller states, else those of the data, else those of
// the model.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "tokid/model.hpp"

namespace tokid {

inline InitialState initial_state_of(const Model& model, const Ensemble& data, std::optional<InitialState> stated) {
  return stated.value_or(data.initial_state.value_or(model.initial_state));
}

}  // namespace tokid
