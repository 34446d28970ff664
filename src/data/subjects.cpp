// SPDX-License-Identifier: BSD-3-Clause
#include "data/subjects.hpp"

namespace tokid {

std::vector<Finding::Experiment> experiments(const Ensemble& ensemble, const std::vector<Index>& rows) {
  std::vector<Finding::Experiment> result;
  for (const Index n : rows) result.push_back(experiment(ensemble, n));
  return result;
}

}  // namespace tokid
