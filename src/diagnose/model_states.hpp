// Model → findings about its states, its first steps and its fit.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/finding.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Reports a model without states.
Findings findings_of_absent_states(const Model& model);

// Reports a model that begins late because the initial states are unknown.
Findings findings_of_begin(const Model& model);

// Reports steps with fewer states than asked for, between steps that have all of them. Steps before and after these may
// have fewer states, because states are not yet reached or no longer observed.
Findings findings_of_hidden_states(const Model& model);

// Reports steps whose Kalman gain is much larger than the median gain and the pseudoinverse of C_k. The outputs hardly
// determine a direction of the state there, and its error grows, and with it the effect of rounding.
Findings findings_of_gains(const Model& model);

// Reports outputs that the model does not predict. `one_step_fit`: (m) [%]
Findings findings_of_fit(const Vector& one_step_fit, const Channels& names);

// Ratios σ_n / σ_{n+1} of the singular values, at the steps of full dimension that have both values.
std::vector<double> singular_value_gaps(const Model& model);

}  // namespace tokid
