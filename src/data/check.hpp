// Checks an ensemble that a caller has made, and surveys its samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "data/survey.hpp"

namespace tokid {

// Surveys all steps of an ensemble, if it passes its check(). \throws as check()
Survey checked(const Ensemble& ensemble, bool outputs_needed = true);

}  // namespace tokid
