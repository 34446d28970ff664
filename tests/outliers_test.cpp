// Experiments that do not fit models of the other experiments.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/outlier.hpp"

#include <gtest/gtest.h>

#include "diagnose/misfits.hpp"
#include "studies/campaigns.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

std::vector<Index> rows_of(const std::vector<Outlier>& outliers) {
  std::vector<Index> rows;
  for (const Outlier& o : outliers) rows.push_back(o.experiment);
  std::sort(rows.begin(), rows.end());
  return rows;
}

// Every kind of fault, with and without noise.
TEST(Outliers, FaultsAreFound) {
  for (const CampaignFault& fault : campaign_faults())
    for (const double noise : {0.0, 0.02, 0.1}) {
      SCOPED_TRACE(std::string(fault.name) + ", noise " + std::to_string(noise));
      const Campaign c{40, 60, {3, 2, 2}, noise, 4};
      Ensemble e = campaign(c, 5);
      const Ensemble before = e;
      fault.change(e, before, 12);
      const std::vector<Outlier> found = identified_outliers(e, c);
      ASSERT_EQ(rows_of(found), std::vector<Index>{12});
      EXPECT_GT(found.front().ratio, 3);
      EXPECT_FALSE(found.front().outputs.empty());
    }
}

TEST(Outliers, OfAnyScaleAreFound) {
  const Campaign c{40, 60, {3, 2, 2}, 0.05, 4};
  for (const double factor : {1e-3, 10.0, 1e3, 1e6}) {
    Ensemble e = campaign(c, 5);
    for (Index k = 0; k < e.steps(); ++k) e.y(12, k, 1) *= factor;
    const std::vector<Outlier> found = identified_outliers(e, c);
    ASSERT_EQ(rows_of(found), std::vector<Index>{12}) << factor;
    EXPECT_EQ(found.front().outputs.front(), (Finding::Channel{true, 1, "y2"}));
  }
}

TEST(Outliers, SeveralDoNotHideEachOther) {
  const Campaign c{40, 60, {3, 2, 2}, 0.05, 4};
  Ensemble e = campaign(c, 5);
  for (Index k = 0; k < e.steps(); ++k) {
    for (const Index n : {3, 12, 30}) std::swap(e.y(n, k, 0), e.y(n, k, 1));
    e.y(21, k, 0) *= 1000;
  }
  EXPECT_EQ(rows_of(identified_outliers(e, c)), (std::vector<Index>{3, 12, 21, 30}));
}

// More experiments than are examined by models of others.
TEST(Outliers, OfManyExperimentsAreFound) {
  const Campaign c{1200, 30, {2, 1, 1}, 0.05, 2};
  for (const double noise : {0.0, 0.05}) {
    Ensemble e = campaign({c.experiments, c.steps, c.size, noise, c.lags}, 3);
    EXPECT_TRUE(identified_outliers(e, c).empty()) << noise;
    for (const Index n : {7, 800})
      for (Index k = 0; k < e.steps(); ++k) e.y(n, k, 0) *= -1;
    EXPECT_EQ(rows_of(identified_outliers(e, c)), (std::vector<Index>{7, 800})) << noise;
  }
}

// Without noise a wrong experiment fits, by states of its own.
TEST(Outliers, OfIdentifyWithoutNoise) {
  for (const Campaign& c : various_campaigns())
    for (const double initial : {0.0, 3.0}) {
      SCOPED_TRACE(std::to_string(c.experiments) + " experiments, initial states " + std::to_string(initial));
      Ensemble e = campaign({c.experiments, c.steps, c.size, 0.0, c.lags}, 1, initial);
      EXPECT_TRUE(identify(e).outliers.empty());
      if (c.experiments < 20) continue;
      for (Index k = 0; k < e.steps(); ++k) e.output(k).row(7) *= -1;
      EXPECT_EQ(rows_of(identify(e).outliers), std::vector<Index>{7});
      // Also among those held out, where the model owes nothing to it.
      IdentifyOptions options;
      options.hold_out = 0.5;
      EXPECT_EQ(rows_of(identify(e, options).outliers), std::vector<Index>{7});
    }
}

// The others tell nothing of the state that it begins with.
TEST(Outliers, OneThatBeginsElsewhereIsHealthy) {
  for (const double displaced : {1e-3, 1.0})
    for (const Index resting : {0, 5}) {
      const Model system = constant_system({2, 1, 1}, 60, 0.9, 3);
      Ensemble e(40, 60, 1, 1);
      Random random(4);
      for (Index k = 0; k < 60; ++k) e.input(k) = (k < resting ? 0.0 : 1.0) * random.matrix(40, 1);
      Matrix x0 = Matrix::Zero(2, 40);
      x0.col(12) << displaced, -2 * displaced;
      e = simulate(system, e, x0);
      e.initial_state = InitialState::unknown;
      EXPECT_TRUE(identify(e).outliers.empty()) << displaced << ", inputs at rest for " << resting << " steps";
      for (Index k = 0; k < 60; ++k) e.output(k).row(7) *= -1;
      const Identification found = identify(e);
      ASSERT_EQ(rows_of(found.outliers), std::vector<Index>{7});
      EXPECT_GE(found.outliers.front().ratio, 1e6);
    }
}

// It reaches a state that the others never do.
TEST(Outliers, OneThatAloneMovesAnInputIsHealthy) {
  Model system = constant_system({2, 1, 2}, 60, 0.9, 1);
  for (Step& step : system.step) {
    step.A() = Vector{{0.9, 0.95}}.asDiagonal();
    step.B().setIdentity();
    step.C().setOnes();
  }
  Ensemble e(40, 60, 2, 1);
  Random random(6);
  for (Index k = 0; k < 60; ++k) {
    e.input(k) << random.matrix(40, 1), Vector::Zero(40);
    if (k < 8) e.u(12, k, 1) = 1.0;
  }
  e = simulate(system, e);
  EXPECT_TRUE(excites_more(e, 12, 2, false));
  EXPECT_FALSE(excites_more(e, 11, 2, false));
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    e.initial_state = initial;
    EXPECT_TRUE(identify(e).outliers.empty());
  }
}

TEST(Outliers, FourExperimentsDoNotTellWhoIsRight) {
  const Campaign c{4, 60, {2, 2, 1}, 0.05, 2};
  Ensemble e = campaign(c, 5);
  for (Index k = 0; k < 60; ++k) e.output(k).row(1) *= 1000;
  EXPECT_TRUE(identified_outliers(e, c).empty());
}

TEST(Outliers, OneWildSampleIsNoWildExperiment) {
  const Campaign c{20, 80, {2, 1, 1}, 0.05, 2};
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Ensemble e = campaign(c, seed);
    e.y(7, 41, 0) += 50 * c.noise * output_sizes(e)(0);
    EXPECT_TRUE(identified_outliers(e, c).empty()) << "seed " << seed;
  }
}

}  // namespace
}  // namespace tokid::testing
