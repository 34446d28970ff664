// SPDX-License-Identifier: BSD-3-Clause
#include "large/reader.hpp"

#include <algorithm>
#include <chrono>
#include <future>
#include <utility>

#include "tokid/parallel.hpp"

namespace tokid::stream {

namespace {

// Limit of the memory for blocks that the system fetches in advance [bytes].
constexpr double most_fetched = 512e6;

}  // namespace

Reader::Reader(const EnsembleFile& file, const BlockLayout& layout, std::vector<Index> blocks, Index ahead)
    : file_(file), layout_(layout), blocks_(std::move(blocks)), ahead_(ahead) {
  const double block = double(layout.longest() * file.experiments() * file.channels()) * sizeof(double);
  group_ = std::clamp<size_t>(size_t(most_fetched / 2 / block), 1, 8);
  thread_ = std::jthread([this] { run(); });
}

Reader::~Reader() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  taken_.notify_all();
}

Ensemble Reader::take(Index i) {
  std::unique_lock lock(mutex_);
  while (!read_.wait_for(lock, std::chrono::milliseconds(100), [&] { return failure_ || waiting_.count(i) > 0; })) {
    lock.unlock();
    checkpoint();
    lock.lock();
  }
  const auto found = waiting_.find(i);
  if (found == waiting_.end()) std::rethrow_exception(failure_);
  Ensemble samples = std::move(found->second);
  waiting_.erase(found);
  taken_.notify_all();
  return samples;
}

// Asks the system to fetch `group_` blocks, beginning with entry `from` of blocks_. Consecutive blocks are requested
// together, because the system then reads longer runs of the file.
void Reader::expect(size_t from) const {
  const size_t to = std::min(blocks_.size(), from + group_);
  for (size_t i = from, end = from; i < to; i = end) {
    for (end = i + 1; end < to && blocks_[end] == blocks_[end - 1] + 1;) ++end;
    file_.expect(layout_.block(blocks_[i]).first, layout_.block(blocks_[end - 1]).last);
  }
}

void Reader::run() {
  try {
    std::future<void> expected = std::async(std::launch::async, [this] { expect(0); });
    for (size_t count = 0; count < blocks_.size(); ++count) {
      {
        std::unique_lock lock(mutex_);
        taken_.wait(lock, [&] { return stopped_ || Index(waiting_.size()) < ahead_; });
        if (stopped_) return;
      }
      if (count % group_ == 0) {
        expected.wait();
        expected = std::async(std::launch::async, [this, next = count + group_] { expect(next); });
      }
      const Block block = layout_.block(blocks_[count]);
      Ensemble samples = file_.read(block.first, block.last);
      const std::lock_guard lock(mutex_);
      waiting_.emplace(blocks_[count], std::move(samples));
      read_.notify_all();
    }
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    read_.notify_all();
  }
}

}  // namespace tokid::stream
