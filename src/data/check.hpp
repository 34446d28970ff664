// Checks an ensemble that a caller has made, and surveys its samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "data/survey.hpp"

namespace tokid {

// Checks an ensemble as Ensemble::check() does, and surveys all of its steps. \throws as Ensemble::check()
Survey checked(const Ensemble& ensemble, bool outputs_needed = true);

}  // namespace tokid
