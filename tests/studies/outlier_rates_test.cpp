// Quick check of the study of outliers: no healthy experiment is flagged.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "studies/campaigns.hpp"

namespace tokid::testing {
namespace {

// The threshold lets one in a thousand through, of campaigns that differ in everything but what is wrong with them;
// docs/evidence.md has the figures. Of these 108, none does.
TEST(OutlierRates, NoneAmongExperimentsThatAreAsTheyAre) {
  for (const Campaign& c : various_campaigns())
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      SCOPED_TRACE(std::to_string(c.experiments) + " experiments, seed " + std::to_string(seed));
      const OutlierOptions options{.lags = c.lags};
      EXPECT_TRUE(outliers(campaign(c, seed), options).empty());
      EXPECT_TRUE(outliers(campaign(c, seed, 3.0), options).empty()) << "unknown initial states";
      EXPECT_TRUE(outliers(campaign(c, seed, 0.0, 0.3), options).empty()) << "noise of different sizes";
      EXPECT_TRUE(outliers(campaign({c.experiments, c.steps, c.size, 0.0, c.lags}, seed), options).empty())
          << "no noise";
      Ensemble gaps = campaign(c, seed);
      Random random(seed);
      for (Index k = 0; k < c.steps; ++k)
        for (Index n = 0; n < c.experiments; ++n)
          if (random.uniform(0, 1) < 0.06) gaps.y(n, k, 0) = nan;
      EXPECT_TRUE(outliers(gaps, options).empty()) << "missing samples";
      Ensemble uneven = campaign(c, seed);
      std::vector<Index> length;
      for (Index n = 0; n < c.experiments; ++n)
        length.push_back(n == 0 ? c.steps : Index(random.uniform(0.1, 1) * double(c.steps)));
      set_length(uneven, length);
      EXPECT_TRUE(outliers(uneven, options).empty()) << "lengths";
    }
}

// Inputs of different kinds, spikes, coarse outputs: outliers.cpp counts them over a larger grid.
TEST(OutlierRates, NoneInHealthyCampaignsOfAnyKind) {
  for (const CampaignKind& kind : healthy_campaigns())
    for (const Campaign& c : {Campaign{12, 80, {2, 1, 1}, 0.05, 2}, {20, 80, {3, 2, 2}, 0.05, 4}})
      for (std::uint64_t seed = 1; seed <= 3; ++seed)
        for (const Outlier& o : identified_outliers(kind.make(c, seed), c))
          ADD_FAILURE() << kind.name << ", seed " << seed << ": " << in_words(findings_of({o})).front();
}

}  // namespace
}  // namespace tokid::testing
