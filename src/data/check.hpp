// Checks an ensemble that a caller has made, and surveys its samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "data/survey.hpp"

namespace tokid {

// Checks an ensemble as Ensemble::check() does, and surveys all of its steps. \throws as Ensemble::check()
Survey checked(const Ensemble& ensemble, bool outputs_needed = true);

// Checks the parts of an ensemble that a model reads: no infinite sample, and numbers of names, units and lengths that
// fit. Samples may be missing, also all of a channel. Without outputs, only the inputs are checked.
// \throws std::invalid_argument
void check_samples(const Ensemble& ensemble, bool with_outputs = true);

// Checks the names and units of channels. \throws std::invalid_argument for a wrong number, or names that are not
// different
void check_names(const Channels& names, Index inputs, Index outputs);

}  // namespace tokid
