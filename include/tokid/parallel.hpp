// The only door to threads: a loop over time steps whose iterations do not depend on each other.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "tokid/linalg.hpp"

namespace tokid {

// Called with the finished share of the work, 0 … 1, from one thread at a time.
using Progress = std::function<void(double)>;

struct Execution {
  int threads = 1;         // 0: as many as the machine has
  Progress progress = {};  // empty: silent
};

// Calls body(begin, end) on contiguous, disjoint pieces that cover [begin, end). The pieces may run at the same time;
// results are the same bits for any number of threads as long as each index writes only what belongs to it. The first
// exception thrown by a piece is rethrown here.
void parallel_for(Index begin, Index end, const Execution& execution, const std::function<void(Index, Index)>& body);

}  // namespace tokid
