// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

namespace tokid {
namespace {

TEST(ParallelFor, CoversEveryIndexOnceForAnyNumberOfThreads) {
  for (const int threads : {0, 1, 2, 3, 8}) {
    for (const Index size : {0, 1, 7, 1000}) {
      std::vector<std::atomic<int>> seen(size_t(size) + 1);
      parallel_for(0, size, {threads, {}}, [&](Index begin, Index end) {
        for (Index k = begin; k < end; ++k) ++seen[size_t(k)];
      });
      for (Index k = 0; k < size; ++k) EXPECT_EQ(seen[size_t(k)], 1) << threads << " threads, index " << k;
    }
  }
}

TEST(ParallelFor, ANegativeNumberOfThreadsIsRefused) {
  try {
    parallel_for(0, 10, {-1, {}}, [](Index, Index) { FAIL(); });
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "threads: -1 found, 1 or more needed, or 0 for one for each processor");
  }
}

TEST(ParallelFor, ReportsProgressThatEndsAtOne) {
  for (const int threads : {1, 3}) {
    std::vector<double> reported;
    parallel_for(3, 103, {threads, [&](const ProgressReport& report) { reported.push_back(report.share); }},
                 [](Index, Index) {});
    ASSERT_FALSE(reported.empty());
    for (size_t i = 1; i < reported.size(); ++i) EXPECT_GT(reported[i], reported[i - 1]);
    EXPECT_EQ(reported.back(), 1.0);
  }
}

TEST(ParallelFor, RethrowsWhatAPieceThrows) {
  for (const int threads : {1, 4})
    EXPECT_THROW(parallel_for(0, 1000, {threads, {}},
                              [](Index begin, Index end) {
                                if (begin <= 500 && 500 < end) throw std::runtime_error("step 500");
                              }),
                 std::runtime_error);
}

struct Enough {};

TEST(ParallelFor, IsStoppedByTheCheckOfItsThread) {
  for (const int threads : {1, 3}) {
    std::atomic<int> checks{0};
    std::atomic<Index> done{0};
    const auto run = [&, own = std::this_thread::get_id()] {
      parallel_for(0, 100'000, {threads, {}}, [&](Index begin, Index end) {
        while (checks < 2 && std::this_thread::get_id() != own) std::this_thread::yield();  // or they do it all
        done += end - begin;
      });
    };
    {
      const Interruptible never([] { throw Enough(); });
      {
        const Interruptible inner([&] {
          if (++checks == 2) throw Enough();
        });
        EXPECT_THROW(run(), Enough);
      }
      EXPECT_EQ(checks, 2);
      EXPECT_LT(done, 100'000);
      EXPECT_THROW(run(), Enough);
    }
    done = 0;
    run();
    EXPECT_EQ(done, 100'000);
  }
}

}  // namespace
}  // namespace tokid
