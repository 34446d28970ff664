// SPDX-License-Identifier: BSD-3-Clause
#include "stream/reader.hpp"

#include <algorithm>
#include <chrono>
#include <future>

#include "tokid/parallel.hpp"

namespace tokid::stream {

namespace {

// What the system fetches ahead, which its memory has to hold [bytes].
constexpr double most_fetched = 512e6;

}  // namespace

Reader::Reader(const EnsembleFile& file, const Plan& plan, Index first, Index stride, Index ahead)
    : file_(file), plan_(plan), first_(first), stride_(stride), ahead_(ahead) {
  const double block = double(plan.longest() * file.experiments() * file.channels()) * sizeof(double);
  group_ = std::clamp<Index>(Index(most_fetched / 2 / block), 1, 8);
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

// A group of blocks, the first of which is `from`. Those that follow each other without a gap are asked for as one:
// longer runs of the file.
void Reader::expect(Index from) const {
  const Index to = std::min(plan_.count, from + group_ * stride_);
  if (stride_ == 1 && from < to) return file_.expect(plan_.block(from).first, plan_.block(to - 1).last);
  for (Index i = from; i < to; i += stride_) file_.expect(plan_.block(i).first, plan_.block(i).last);
}

void Reader::run() {
  try {
    std::future<void> expected = std::async(std::launch::async, [this] { expect(first_); });
    for (Index i = first_, count = 0; i < plan_.count; i += stride_, ++count) {
      {
        std::unique_lock lock(mutex_);
        taken_.wait(lock, [&] { return stopped_ || Index(waiting_.size()) < ahead_; });
        if (stopped_) return;
      }
      if (count % group_ == 0) {
        expected.wait();
        expected = std::async(std::launch::async, [this, next = i + group_ * stride_] { expect(next); });
      }
      Ensemble samples = file_.read(plan_.block(i).first, plan_.block(i).last);
      const std::lock_guard lock(mutex_);
      waiting_.emplace(i, std::move(samples));
      read_.notify_all();
    }
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    read_.notify_all();
  }
}

}  // namespace tokid::stream
