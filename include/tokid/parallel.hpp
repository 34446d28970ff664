// The only door to threads: a loop over time steps whose iterations do not depend on each other.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "tokid/types.hpp"

namespace tokid {

// Called with the finished share of the work, 0 … 1, from one thread at a time.
using Progress = std::function<void(double)>;

struct Execution {
  int threads = 1;         // 0: as many as the machine has
  Progress progress = {};  // empty: silent
};

// Threads that it asks for: 0 stands for as many as the machine has.
Index thread_count(const Execution& execution);

// For a stage that takes the part from … to of the whole progress: the same threads, and its own share reported so.
Execution share(const Execution& whole, double from, double to);

// Calls body(begin, end) on contiguous, disjoint pieces that cover [begin, end). The pieces may run at the same time;
// results are the same bits for any number of threads as long as each index writes only what belongs to it. The first
// exception thrown by a piece is rethrown here.
void parallel_for(Index begin, Index end, const Execution& execution, const std::function<void(Index, Index)>& body);

// While it lives, all loops and long stages on the thread that made it call `check` every now and then, also those that
// report no progress. What that throws stops them and comes out of the call; it must be no std::exception, lest it be
// taken for one of the failures that some stages can do without. The innermost one counts.
class Interruptible {
 public:
  explicit Interruptible(std::function<void()> check);
  ~Interruptible();
  Interruptible(const Interruptible&) = delete;
  Interruptible& operator=(const Interruptible&) = delete;

 private:
  std::function<void()> check_;
  const std::function<void()>* outer_;
};
// The check of this thread, where it has one.
void checkpoint();

}  // namespace tokid
