// The only interface to threads: a loop whose iterations do not depend on each other.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

#include "tokid/progress.hpp"
#include "tokid/types.hpp"

namespace tokid {

// How long calls use the machine, and to whom they report. Options of such calls have a member `execution`.
struct Execution {
  int threads = 1;         // 0: one for each processor of the machine. The results do not depend on it
  Progress progress = {};  // empty: no reports
};

// The number of threads that `execution` asks for; 0 stands for the number of processors.
// \throws std::invalid_argument for a negative number
Index thread_count(const Execution& execution);

// The execution of one stage of the work. It has the same threads, and its progress is reported between `from` and
// `to`. `stage`: its name, which stands in front of the names of its own stages; empty: it has none.
Execution share(const Execution& whole, double from, double to, const std::string& stage = {});

// Calls body(begin, end) on contiguous, disjoint pieces that cover [begin, end). The pieces may run at the same time.
// If the body writes for each index only the results of this index, the results have the same bits for any number of
// threads. The first exception of a piece is rethrown to the caller.
void parallel_for(Index begin, Index end, const Execution& execution, const std::function<void(Index, Index)>& body);

// Lets a caller stop long computations. While this object lives, all loops and long stages on the thread that created
// it call `check` regularly, even if they report no progress. If `check` throws, the computation stops and its caller
// receives the exception. The exception must not be a std::exception, because some stages catch every std::exception.
// If there are several objects, the newest is used.
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
// Calls the check of this thread, if there is one.
void checkpoint();

}  // namespace tokid
