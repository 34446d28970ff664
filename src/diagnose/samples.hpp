// Ensemble → findings about its samples, before anything is chosen.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "data/extents.hpp"
#include "data/survey.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// Reports inputs and outputs that tell nothing at some steps, and outputs that move together. `reached`: the steps that
// enough experiments reach; at the other steps, a single experiment is no news. With a period, steps count as phases.
Findings findings_of_samples(const Ensemble& ensemble, Survey samples, Extent reached, Index period);

}  // namespace tokid
