// Model → what is to be said of its states, of the steps that it begins with, and of its fit.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// A model without states.
std::vector<std::string> warnings_of_absent_states(const Model& model);

// A model that begins late, because the initial states are unknown.
std::vector<std::string> warnings_of_late_begin(const Model& model);

// Steps, counted from `origin` on, that have fewer states than were asked for, between steps that have all of them.
// Before and after, states are not reached yet, or not seen any more.
std::vector<std::string> warnings_of_hidden_states(const Model& model, Index origin = 0);

// Outputs that a model does not predict. `one_step_fit`: (m) [%]
std::vector<std::string> warnings_of_fit(const Vector& one_step_fit, const Channels& names);

// σ_n / σ_{n+1} of the steps of full dimension, where there are both.
std::vector<double> singular_value_gaps(const Model& model);

}  // namespace tokid
