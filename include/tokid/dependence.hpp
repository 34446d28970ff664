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
  std::vector<DependentExperiment> combinations;  // the dependent experiments, in ascending order, as sums of used ones
};

// Finds experiments whose inputs and outputs are the same weighted sum of other experiments, within rounding. The
// residuals must be as small as find_copies() requires. They must also be at most an eighth of the part of each term
// that the other terms do not explain.
// - The data must contain visible noise. Experiments without noise depend on each other because the system is linear;
//   none of them is dropped.
// - The result must not be a coincidence. The terms must be linearly independent on two thirds of the record. The whole
//   record then has enough samples to show that an experiment does not depend on them.
// If several experiments can be computed from each other, the function uses those with the smaller share in the sum. If
// shares are equal, it uses the first ones. It also uses an experiment whose missing samples leave few in common with
// the others. The time is linear in the number of samples, apart from some 10⁹ operations. Copies must be removed
// before.
Dependence find_dependence(const Ensemble& ensemble);

// Findings that name the dependent experiments and the ones that they depend on. Empty if there are none.
Findings findings_of(const Dependence& dependence, const Ensemble& ensemble);

// The experiments that carry information of their own: neither copies nor dependent experiments. Both fields hold row
// numbers of the whole data. `dependent.used` holds the rows that remain after both searches.
struct UsedExperiments {
  Copies copies;
  Dependence dependent;

  bool all(const Ensemble& ensemble) const { return Index(dependent.used.size()) == ensemble.experiments(); }
  const std::vector<Index>& rows() const { return dependent.used; }
};
UsedExperiments used_experiments(const Ensemble& ensemble);
// The dependent experiments among the rows in `copies.used`, with the row numbers of the whole data.
Dependence dependence_beside(const Copies& copies, const Ensemble& ensemble);
// The rows that remain of this number of experiments.
std::vector<Index> used_experiments(Index experiments, const Copies& copies, const Dependence& dependent);
Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble);

}  // namespace tokid
