// Reads the blocks of a stream ahead of those that work at them.
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

// The given blocks in this order, by a thread of its own: the file has other limits than the processor, and the time of
// both together is that of the slower one.
class Reader {
 public:
  // Up to `ahead` blocks wait, beside those that were taken.
  Reader(const EnsembleFile& file, const BlockLayout& layout, std::vector<Index> blocks, Index ahead);
  ~Reader();
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // The samples of block i, by any thread, each block once. Who asks for one that more than `ahead` blocks lie before
  // waits until others have taken some of these. \throws what reading it has thrown
  Ensemble take(Index i);

 private:
  void run();
  void expect(size_t from) const;

  const EnsembleFile& file_;
  const BlockLayout& layout_;
  const std::vector<Index> blocks_;
  const Index ahead_;
  size_t group_;  // blocks that the system is asked to fetch at once
  std::mutex mutex_;
  std::condition_variable read_, taken_;
  std::map<Index, Ensemble> waiting_;
  std::exception_ptr failure_;
  bool stopped_ = false;
  std::jthread thread_;
};

}  // namespace tokid::stream
