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

// Reads the given blocks in this order in its own thread. The disk limits the reading and the processor limits the
// computing. So both together take only as long as the slower of the two.
class Reader {
 public:
  // `ahead`: the most blocks that are read and not yet taken.
  Reader(const EnsembleFile& file, const BlockLayout& layout, std::vector<Index> blocks, Index ahead);
  ~Reader();
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // Returns the samples of block i, and waits until they are read. Any thread may call this function, once for each
  // block. If more than `ahead` blocks precede block i, other threads must take some of these blocks. \throws the
  // exception of reading the block
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
