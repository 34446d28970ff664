// Search for copies: experiments that are in the data more than once.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct Copies {
  std::vector<Index> used;  // rows of the experiments to use, each experiment once, ascending
  // rows of the copies of one experiment, two or more; the first row is the one to use
  std::vector<std::vector<Index>> groups;
};

// Two rows are copies if one of these holds, in all samples that both have:
// - The RMS of their difference is below 4·10⁻⁶ of the usual departure of a channel from the median motion, or below
//   10⁻¹² of the size of the channel. This must hold for each channel.
// - One row is the other, rounded to single precision or to fewer decimal digits.
// Copies share at least half of the samples of the shorter row. The row with most samples is used. An experiment that
// repeats the inputs of another with its own noise is not a copy. The time is linear in the number of samples.
Copies find_copies(const Ensemble& ensemble);

// Findings that name the copies and their originals. Empty if there are no copies.
Findings findings_of(const Copies& copies, const Ensemble& ensemble);

}  // namespace tokid
