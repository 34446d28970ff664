// Quick check of the study of outliers: no healthy experiment is flagged.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "studies/campaigns.hpp"

namespace tokid::testing {
namespace {

// The threshold lets one in a thousand through, of campaigns that differ in everything but what is wrong with them;
// docs/evidence.md has the figures. Of these, none does.
TEST(OutlierRates, NoneAmongExperimentsThatAreAsTheyAre) {
  for (const Campaign& c : various_campaigns()) {
    SCOPED_TRACE(std::to_string(c.experiments) + " experiments");
    EXPECT_TRUE(identified_outliers(campaign(c, 1), c).empty());
    EXPECT_TRUE(identified_outliers(campaign(c, 1, 0.0, 0.3), c).empty()) << "noise of different sizes";
  }
}

// Inputs of different kinds, spikes, coarse outputs: outliers.cpp counts them over a larger grid.
TEST(OutlierRates, NoneInHealthyCampaignsOfAnyKind) {
  for (const CampaignKind& kind : healthy_campaigns())
    for (const Campaign& c : {Campaign{12, 80, {2, 1, 1}, 0.05, 2}, {20, 80, {3, 2, 2}, 0.05, 4}})
      for (std::uint64_t seed = 1; seed <= 3; ++seed)
        for (const Outlier& o : identified_outliers(kind.make(c, seed), c))
          ADD_FAILURE() << kind.name << ", seed " << seed << ": experiment " << o.experiment;
}

}  // namespace
}  // namespace tokid::testing
