// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/parallel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace tokid {

namespace {

thread_local const std::function<void()>* check = nullptr;

}  // namespace

Interruptible::Interruptible(std::function<void()> own) : check_(std::move(own)), outer_(check) { check = &check_; }
Interruptible::~Interruptible() { check = outer_; }

void checkpoint() {
  if (check) (*check)();
}

Index thread_count(const Execution& execution) {
  if (execution.threads < 0)
    throw std::invalid_argument(
        fmt::format("threads: {} found, 1 or more needed, or 0 for one for each processor", execution.threads));
  return execution.threads > 0 ? execution.threads : std::max(1, int(std::thread::hardware_concurrency()));
}

Execution share(const Execution& whole, double from, double to, const std::string& stage) {
  Execution part{whole.threads, {}};
  if (!whole.progress) return part;
  part.progress = [report = whole.progress, from, to, stage](ProgressReport own) {
    if (!stage.empty()) own.stage = own.stage.empty() ? stage : stage + ": " + own.stage;
    own.share = from + (to - from) * own.share;
    report(own);
  };
  return part;
}

void parallel_for(Index begin, Index end, const Execution& execution, const std::function<void(Index, Index)>& body) {
  const Index total = end - begin;
  if (total <= 0) return;
  checkpoint();  // also here, because the other threads may take all pieces before this thread takes one
  const Index threads = std::min(thread_count(execution), total);
  // Each thread takes many small pieces. If some pieces take longer, the other threads take more pieces. Progress is
  // reported after each piece.
  const Index piece = std::max<Index>(1, total / (32 * threads));

  std::atomic<Index> next{begin};
  std::mutex mutex;
  std::exception_ptr failure;
  Index done = 0;
  const auto work = [&] {
    for (Index first = next.fetch_add(piece); first < end; first = next.fetch_add(piece)) {
      try {
        const Index last = std::min(end, first + piece);
        checkpoint();
        body(first, last);
        const std::lock_guard lock(mutex);
        done += last - first;
        if (execution.progress) execution.progress({.share = double(done) / double(total)});
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
        next = end;
      }
    }
  };

  std::vector<std::jthread> others;
  for (Index t = 1; t < threads; ++t) others.emplace_back(work);
  work();
  others.clear();  // joins
  if (failure) std::rethrow_exception(failure);
}

}  // namespace tokid
