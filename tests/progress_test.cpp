// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/progress.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/search_progress.hpp"

namespace tokid {
namespace {

using std::chrono::milliseconds;

TEST(TimeLeft, FollowsFromTheShareAndTheTimeSoFar) {
  const TimeLeft::Clock::time_point begin{};
  TimeLeft left(begin);
  EXPECT_TRUE(std::isnan(left.after({.share = 0.1}, begin + milliseconds(100))));  // too early
  EXPECT_NEAR(left.after({.share = 0.2}, begin + milliseconds(2000)), 8.0, 1e-9);
  EXPECT_NEAR(left.after({.share = 0.4}, begin + milliseconds(4000)), 6.0, 1e-9);
}

TEST(TimeLeft, IsTheReportedOneIfThereIsOne) {
  const TimeLeft::Clock::time_point begin{};
  TimeLeft left(begin);
  const ProgressReport open{.share = 0.5, .stage = "a", .open = true, .seconds_left = 3.0};
  EXPECT_TRUE(std::isnan(left.after(open, begin + milliseconds(1000))));
  EXPECT_NEAR(left.after({.share = 0.5, .seconds_left = 3.0}, begin + milliseconds(1100)), 3.0, 1e-9);
  // A new estimate replaces the old one little by little: 2.9 s would be left.
  const double soon = left.after({.share = 0.5, .seconds_left = 9.0}, begin + milliseconds(1200));
  EXPECT_GT(soon, 2.9);
  EXPECT_LT(soon, 5.0);
  double later = soon;
  for (int i = 0; i < 100; ++i)
    later = left.after({.share = 0.5, .seconds_left = 9.0}, begin + milliseconds(1300 + 100 * i));
  EXPECT_NEAR(later, 9.0, 0.7);
}

TEST(Share, NamesItsStageAndDropsTheTimeLeftOfAPart) {
  ProgressReport seen;
  const Execution whole{1, [&](const ProgressReport& report) { seen = report; }};
  share(whole, 0.2, 0.6, "fold 1 of 2").progress({.share = 0.5, .seconds_left = 1.0});
  EXPECT_DOUBLE_EQ(seen.share, 0.4);
  EXPECT_EQ(seen.stage, "fold 1 of 2");
  EXPECT_EQ(seen.stage_share, 0.5);
  EXPECT_TRUE(std::isnan(seen.seconds_left));
  share(whole, 0.0, 1.0, "fold 1 of 2")
      .progress({.share = 0.5, .stage = "EM", .stage_share = 0.9, .seconds_left = 1.0});
  EXPECT_EQ(seen.stage, "fold 1 of 2: EM");
  EXPECT_EQ(seen.stage_share, 0.9);
  EXPECT_EQ(seen.seconds_left, 1.0);
}

// The shares after each unit of a search that takes `units`, with 10 as the usual number.
std::vector<double> shares_of_search(int units) {
  std::vector<double> shares;
  SearchProgress work({1, [&](const ProgressReport& report) { shares.push_back(report.share); }}, 0.5, 1.0);
  work.begin("search", 10, 0);
  const Progress progress = work.counted();
  for (int i = 0; i < units; ++i) progress({});
  return shares;
}

TEST(SearchProgress, RisesWithEachUnitHoweverManyFollow) {
  for (const int units : {3, 10, 30}) {
    const std::vector<double> shares = shares_of_search(units);
    for (size_t i = 1; i < shares.size(); ++i) EXPECT_GT(shares[i], shares[i - 1]) << units;
    EXPECT_GE(shares.front(), 0.5);
    EXPECT_LE(shares.back(), 1.0);
  }
  // The usual number of units leads near the end, and half of it about half way.
  EXPECT_GT(shares_of_search(10).back(), 0.85);
  EXPECT_NEAR(shares_of_search(5).back(), 0.75, 0.05);
}

TEST(SearchProgress, MovesFasterIfLessFollowsThanExpected) {
  ProgressReport last;
  SearchProgress work({1, [&](const ProgressReport& report) { last = report; }});
  work.begin("first", 10, 90);
  const Progress progress = work.counted();
  progress({});
  const double slow = last.share;
  EXPECT_NEAR(slow, 0.01, 0.001);
  work.begin("last", 10, 0, SearchProgress::Amount::known);
  EXPECT_EQ(last.share, slow);
  EXPECT_EQ(last.stage, "last");
  for (int i = 0; i < 5; ++i) progress({});
  EXPECT_NEAR(last.share, slow + (1 - slow) / 2, 1e-9);  // half of the known work is done
  for (int i = 0; i < 5; ++i) progress({});
  EXPECT_NEAR(last.share, 1.0, 1e-9);
}

TEST(SearchProgress, TellsTheTimeLeftFromTheTimeOfAUnit) {
  ProgressReport last;
  SearchProgress work({1, [&](const ProgressReport& report) { last = report; }}, 0.0, 0.5);
  work.tell_time_after(2, 0.01);
  work.begin("work", 10, 20, SearchProgress::Amount::known);
  const Progress progress = work.counted(2.0);
  EXPECT_TRUE(last.open);
  const auto begin = TimeLeft::Clock::now();
  while (TimeLeft::Clock::now() - begin < milliseconds(20)) continue;
  progress({});
  const double unit = std::chrono::duration<double>(TimeLeft::Clock::now() - begin).count() / 2;
  EXPECT_FALSE(last.open);
  EXPECT_NEAR((last.seconds_left - 0.01) / unit, 28.0, 3.0);
}

}  // namespace
}  // namespace tokid
