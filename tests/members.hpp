// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tokid/team.hpp"

namespace tokid::testing {

// Threads in the place of processes.
class Threads {
 public:
  explicit Threads(Index size) : size_(size), down_(size_t(size)), up_(size_t(size)) {}

  // Calls work(team) as every member.
  template <class Work>
  void run(Work&& work) {
    std::vector<std::thread> others;
    for (Index rank = 1; rank < size_; ++rank) others.emplace_back([this, rank, &work] { work(member(rank)); });
    work(member(0));
    for (std::thread& other : others) other.join();
  }

 private:
  using Queue = std::deque<std::string>;

  Team member(Index rank) {
    Team team;
    team.rank = rank;
    team.size = size_;
    team.broadcast = [this, rank](const std::string& own) {
      if (rank > 0) return take(down_[size_t(rank)]);
      for (Index other = 1; other < size_; ++other) put(down_[size_t(other)], own);
      return own;
    };
    team.gather = [this, rank](const std::string& own) {
      std::vector<std::string> all;
      if (rank > 0) {
        put(up_[size_t(rank)], own);
        return all;
      }
      all.push_back(own);
      for (Index other = 1; other < size_; ++other) all.push_back(take(up_[size_t(other)]));
      return all;
    };
    return team;
  }
  void put(Queue& queue, const std::string& bytes) {
    const std::lock_guard lock(mutex_);
    queue.push_back(bytes);
    changed_.notify_all();
  }
  std::string take(Queue& queue) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !queue.empty(); });
    std::string bytes = std::move(queue.front());
    queue.pop_front();
    return bytes;
  }

  Index size_;
  std::vector<Queue> down_, up_;
  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace tokid::testing
