// Ensemble → faults of its recording that the samples alone show.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// Reports experiments whose channels all stay constant to the end from the same step on: these runs stopped early, and
// their ends were filled with zeros or with the last value. Also reports outputs that jump by a whole turn, because
// they are angles between two limits.
Findings findings_of_recording(const Ensemble& ensemble);

}  // namespace tokid
