// Reads the blocks of a stream before the threads need them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "large/blocks.hpp"

namespace tokid::stream {

// Reads the given blocks in this order in a thread of its own. Reading and computing have different limits, so that
// together they take only the time of the slower one.
class Reader {
 public:
  // Up to `ahead` blocks wait, in addition to the blocks that were taken.
  Reader(const EnsembleFile& file, const BlockLayout& layout, std::vector<Index> blocks, Index ahead);
  ~Reader();
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // Returns the samples of block i. Any thread may call it, once for each block. If more than `ahead` blocks come
  // before block i, it waits until others have taken some of them. \throws the exception of reading the block
  Ensemble take(Index i);

 private:
  void run();
  void expect(size_t from) const;

  const EnsembleFile& file_;
  const BlockLayout& layout_;
  const std::vector<Index> blocks_;
  const Index ahead_;
  size_t group_;  // number of blocks that the system is asked to fetch at once
  std::mutex mutex_;
  std::condition_variable read_, taken_;
  std::map<Index, Ensemble> waiting_;
  std::exception_ptr failure_;
  bool stopped_ = false;
  std::jthread thread_;
};

}  // namespace tokid::stream
