// Ensemble → where a channel stays at one value in one experiment, unlike in the others.
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

// The longest of each experiment, of those experiments in which channel c (inputs first) stays far longer than is usual
// in the others, after it has moved; an output only as long as an input of the experiment moves. By experiments.
std::vector<Standstill> standstills(const Ensemble& ensemble, Index c);

}  // namespace tokid
