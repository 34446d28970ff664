// Experiments that are in the data more than once.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct Copies {
  std::vector<Index> used;                 // row numbers, each experiment once, ascending
  std::vector<std::vector<Index>> groups;  // rows of one experiment, two or more: first the one that is used
};

// Rows that agree in all samples that both have, within rounding:
// - the root mean square of their difference is below 4·10⁻⁶ of the usual departure of a channel from the median motion
//   (or 10⁻¹² of its size), for each channel, or
// - one is the other, rounded to single precision or to fewer decimal digits.
// They share half of the samples of the shorter one, at least. The one with most samples is used. Experiments that
// repeat the inputs with noise of their own are none. Takes time that is linear in the samples of the experiments.
Copies find_copies(const Ensemble& ensemble);

// Which experiments are copies, and of which ones; nothing where there are none.
Findings findings_of(const Copies& copies, const Ensemble& ensemble);

}  // namespace tokid
