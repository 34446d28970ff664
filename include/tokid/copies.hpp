// Search for copies, and for experiments without a sample: those that are not used.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct Copies {
  std::vector<Index> used;  // rows of the experiments to use, each experiment once, ascending
  // for each experiment with copies: all its rows, the row to use first
  std::vector<std::vector<Index>> groups;
};

// Two rows are copies if one of two conditions holds for all samples that are present in both rows:
// - In each channel, the RMS of the difference of the rows is below 4·10⁻⁶ of the typical departure from the median
//   motion, or below 10⁻¹² of the size of the channel.
// - One row is a rounded version of the other row: in single precision, or with fewer decimal digits.
// At least half of the samples of the shorter row must be present in both rows. The row with most samples is used. Two
// experiments with equal inputs and different noise are not copies. The time is linear in the number of samples.
Copies find_copies(const Ensemble& ensemble);

// Findings that name the copies and their originals. Empty if there are no copies.
Findings findings_of(const Copies& copies, const Ensemble& ensemble);

// The experiments to use: without copies and without experiments that have no sample. Row numbers are those of the whole
// data.
struct UsedExperiments {
  Copies copies;
  std::vector<Index> empty = {};  // rows of the experiments without a sample
  std::vector<Index> rows = {};   // those to use, ascending

  bool all(const Ensemble& ensemble) const { return Index(rows.size()) == ensemble.experiments(); }
};
UsedExperiments used_experiments(const Ensemble& ensemble);
Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble);

}  // namespace tokid
