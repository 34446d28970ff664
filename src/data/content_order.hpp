// An order of experiments that depends on their samples only.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// The rows of the experiments, sorted by their samples: ensembles with the same experiments in any order become the
// same ensemble. Rounding errors of the samples hardly ever change the order, and other units of a channel do not. Equal
// experiments keep their order.
std::vector<Index> content_order(const Ensemble& ensemble);

}  // namespace tokid
