// An ensemble as a caller has made it → what its samples are, or a refusal.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "data/survey.hpp"

namespace tokid {

// Of all steps of an ensemble that passes its check(). \throws as that
Survey checked(const Ensemble& ensemble, bool outputs_needed = true);

}  // namespace tokid
