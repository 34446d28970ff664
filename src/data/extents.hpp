// Which steps each experiment has samples at, and which steps enough experiments reach.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// The steps begin … end-1 from the first sample of an experiment to its last one. Equal if it has no sample.
struct Extent {
  Index begin = 0, end = 0;
};
std::vector<Extent> extents(const Ensemble& ensemble);  // (N)

// (N) The stated lengths or, if none are stated, the end of each extent: an array holds experiments of several lengths
// with NaN after the end of the shorter ones.
std::vector<Index> lengths(const Ensemble& ensemble);

// The steps from the first to the last one that lie within the extents of at least `needed` experiments. All steps if
// there is no such step.
Extent reached(const Ensemble& ensemble, Index needed);

// Reports the steps before and after those that `needed` of the experiments in `rows` reach, and the experiments that
// have samples there. No model of these steps can be identified.
Findings findings_of_reach(const Ensemble& ensemble, const std::vector<Index>& rows, Extent reached, Index needed);

// The steps 0 … end-1, with the free responses and the remarks of the whole ensemble.
Ensemble begin_of(const Ensemble& ensemble, Index end);

// Fewest experiments from which departures from a mean motion can be identified. A single one equals its own mean.
inline constexpr Index fewest_at_a_step = 2;

}  // namespace tokid
