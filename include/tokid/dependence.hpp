// Search for dependent experiments: sums, multiples and means of other experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/copies.hpp"

namespace tokid {

// An experiment that is a weighted sum of other experiments.
struct DependentExperiment {
  Index experiment = 0;         // row of the dependent experiment
  std::vector<Index> of;        // rows of the other experiments, ascending
  std::vector<double> weights;  // one for each row in `of`
};

struct Dependence {
  std::vector<Index> used;  // rows of the experiments to use, ascending: none of them is dependent
  std::vector<DependentExperiment> combinations;  // the dependent experiments, ascending; `of` has rows of `used` only
};

// Finds experiments that are a weighted sum of other experiments, with the same weights for all inputs and outputs,
// within rounding. The difference between the experiment and the sum must be as small as find_copies() requires between
// two rows. Each term of the sum also has a part that the other terms do not explain. The difference must be at most an
// eighth of this part.
// - The data must contain noise above the level of rounding errors. Without noise, experiments depend on each other
//   because the system is linear, and no experiment is dropped.
// - The result must not be a coincidence. With as many terms as samples, any experiment is a weighted sum of the terms.
//   The terms must therefore be linearly independent already on two thirds of the record.
// In a weighted sum, every experiment can be computed from the other experiments. The function drops the experiment
// with the largest share in the sum; among equal shares, the last one. It never drops an experiment that has too few
// samples in common with the other experiments. The time is linear in the number of samples, apart from some 10⁹
// operations. Remove copies before the call.
Dependence find_dependence(const Ensemble& ensemble);

// Findings that name each dependent experiment and the experiments in its sum. Empty if no experiment is dependent.
Findings findings_of(const Dependence& dependence, const Ensemble& ensemble);

// The experiments to use: without copies, dependent experiments, and experiments without a sample. Row numbers are
// those of the whole data. `dependent.used` contains the rows that remain.
struct UsedExperiments {
  Copies copies;
  Dependence dependent;
  std::vector<Index> empty = {};  // rows of the experiments without a sample

  bool all(const Ensemble& ensemble) const { return Index(dependent.used.size()) == ensemble.experiments(); }
  const std::vector<Index>& rows() const { return dependent.used; }
};
UsedExperiments used_experiments(const Ensemble& ensemble);
// The dependent experiments among the rows in `copies.used`, with the row numbers of the whole data.
Dependence dependence_beside(const Copies& copies, const Ensemble& ensemble);
Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble);

}  // namespace tokid
