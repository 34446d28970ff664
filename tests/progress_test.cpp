// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/progress.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "base/search_progress.hpp"

namespace tokid {
namespace {

TEST(Share, NamesItsStage) {
  ProgressReport seen;
  const Execution whole{1, [&](const ProgressReport& report) { seen = report; }};
  share(whole, 0.2, 0.6, "fold 1 of 2").progress({.share = 0.5});
  EXPECT_DOUBLE_EQ(seen.share, 0.4);
  EXPECT_EQ(seen.stage, "fold 1 of 2");
  share(whole, 0.0, 1.0, "fold 1 of 2").progress({.share = 0.5, .stage = "EM"});
  EXPECT_EQ(seen.stage, "fold 1 of 2: EM");
}

TEST(SearchProgress, RisesWithEachUnitHoweverManyFollow) {
  std::vector<double> shares{0.0};
  SearchProgress work({1, [&](const ProgressReport& report) { shares.push_back(report.share); }}, 10);
  const Progress progress = work.counted();
  for (int i = 0; i < 30; ++i) progress({});
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end(), std::less_equal<>()));
  EXPECT_NEAR(shares[5], 0.4, 0.05);
  EXPECT_LT(shares.back(), 1.0);
}

}  // namespace
}  // namespace tokid
