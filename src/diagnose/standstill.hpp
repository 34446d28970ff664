// Ensemble → steps at which a channel stays constant in one experiment, but not in the others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

struct Standstill {
  Index experiment = 0;
  Index begin = 0, end = 0;  // steps begin … end-1
  double value = 0.0;
};

// For channel c (inputs first), returns the experiments in which it stays constant far longer than in the others. For
// each experiment, returns the longest standstill after the channel has first moved. For an output, only steps at which
// an input of the experiment moves count. The result is sorted by experiment.
std::vector<Standstill> standstills(const Ensemble& ensemble, Index c);

}  // namespace tokid
