// Experiments that were made of others: their sums, multiples and means.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/copies.hpp"

namespace tokid {

// An experiment that is the sum of others, each multiplied by its weight.
struct DependentExperiment {
  Index experiment = 0;         // its row
  std::vector<Index> of;        // rows of the others, ascending
  std::vector<double> weights;  // one for each of them
};

struct Dependence {
  std::vector<Index> used;  // row numbers of the experiments that are made of no others, ascending
  std::vector<DependentExperiment> combinations;  // of used experiments, by ascending row
};

// Looks for experiments whose inputs and outputs are one combination of those of others, within rounding: by residuals
// of the size that find_copies allows, and at most an eighth of the part of the others that nothing else explains.
// - Only where noise is visible. Experiments without noise are combinations of each other by the linearity of the
//   system, and none is dropped.
// - Only where it is no coincidence: the others must be independent on two thirds of the record, so that the whole has
//   room for experiments that are no combination of them.
// Of experiments that can be computed from each other, those with the smaller share in the combination are used, and
// the first ones of equal shares. Experiments with so many missing samples that the others have few in common with them
// are used. Takes time that is linear in the samples, but for some 10⁹ operations. Copies must have been removed.
Dependence find_dependence(const Ensemble& ensemble);

// Which experiments are sums or multiples, and of which ones; nothing where there are none.
Findings findings_of(const Dependence& dependence, const Ensemble& ensemble);

// The experiments that tell something of their own. Both parts have the row numbers of the whole data, and
// `dependent.used` has those that both leave.
struct UsedExperiments {
  Copies copies;
  Dependence dependent;

  bool all(const Ensemble& ensemble) const { return Index(dependent.used.size()) == ensemble.experiments(); }
  const std::vector<Index>& rows() const { return dependent.used; }
};
UsedExperiments used_experiments(const Ensemble& ensemble);
// Among the experiments that copies leave, with the row numbers of the whole data.
Dependence dependence_beside(const Copies& copies, const Ensemble& ensemble);
// The rows that these leave of so many experiments.
std::vector<Index> used_experiments(Index experiments, const Copies& copies, const Dependence& dependent);
Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble);

}  // namespace tokid
