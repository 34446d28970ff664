// Model → what is to be said of its states, of the steps that it begins with, and of its fit.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/finding.hpp"
#include "tokid/model.hpp"

namespace tokid {

// A model without states.
Findings findings_of_absent_states(const Model& model);

// A model that begins late, because the initial states are unknown.
Findings findings_of_begin(const Model& model);

// Steps, counted from `origin` on, that have fewer states than were asked for, between steps that have all of them.
// Before and after, states are not reached yet, or not seen any more.
Findings findings_of_hidden_states(const Model& model, Index origin = 0);

// Outputs that a model does not predict. `one_step_fit`: (m) [%]
Findings findings_of_fit(const Vector& one_step_fit, const Channels& names);

// σ_n / σ_{n+1} of the steps of full dimension, where there are both.
std::vector<double> singular_value_gaps(const Model& model);

}  // namespace tokid
