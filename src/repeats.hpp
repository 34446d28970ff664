// Experiments that repeat others, in all samples or in their inputs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

struct Repeats {
  std::vector<std::vector<Index>> same;  // experiments that are equal in every sample, two or more each
  Index different = 0;                   // experiments, equal ones counted once
  Index courses = 0;                     // different courses of the inputs
};

// Equal to the last bit; missing samples equal each other. Hashes rule most out.
Repeats repeats(const Ensemble& ensemble);

// `needed` are the experiments that it takes at this lag order, 0 where steps lend each other theirs.
std::vector<std::string> warnings_of(const Repeats& repeats, const Ensemble& ensemble, Index needed, Index lags);

}  // namespace tokid
