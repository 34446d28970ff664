// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/corrections.hpp"

#include <gtest/gtest.h>

#include "io/formats/provenance_text.hpp"
#include "studies/defects.hpp"
#include "testing.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

TEST(Corrections, DropExperimentsAndReplaceSamples) {
  Ensemble e = random_experiments(constant_system({2, 2, 1}, 10, 0.9, 1), 4, 2);
  e.experiment_names = {"a", "b", "c", "d"};
  const Corrected found =
      corrected(e, {{{"b", 0.0}, {"d", 0.25}, {"unknown", 0.0}}, {{"c", 1, 3, testing::nan}, {"b", 0, 1, 7.0}}});
  EXPECT_EQ(found.rows, (std::vector<Index>{0, 2, 3}));
  EXPECT_EQ(found.weights, (Vector{{1.0, 1.0, 0.25}}));
  EXPECT_EQ(found.data.experiment_name(1), "c");
  EXPECT_TRUE(std::isnan(found.data.y(1, 3, 1)));
  EXPECT_EQ(found.data.missing(), 1);
}

TEST(Corrections, GoByRowsWhereExperimentsHaveNoNames) {
  const Ensemble e = random_experiments(constant_system({2, 1, 1}, 10, 0.9, 1), 4, 2);
  const Corrections corrections{{{"2", 0.0}}, {{"3", 0, 5, 1.5}}};
  EXPECT_EQ(corrected(e, corrections).rows, (std::vector<Index>{0, 1, 3}));
  // A part has the labels of the whole.
  const Corrected part = corrected(e.subset({2, 3}), corrections);
  EXPECT_EQ(part.rows, (std::vector<Index>{1}));
  EXPECT_EQ(part.data.y(0, 5, 0), 1.5);
}

// Least squares over scaled departures are weighted least squares: experiments of weight 0 have no effect.
TEST(Corrections, WeightsOfOneAndZeroAreUsedAndDropped) {
  const Ensemble e = random_experiments(constant_system({2, 2, 1}, 10, 0.9, 1), 5, 2);
  const Vector weights{{1.0, 0.0, 1.0, 1.0, 0.0}};
  const Ensemble used = e.subset({0, 2, 3});
  const Nominal mean = weighted_nominal(e, weights), wanted = nominal_trajectory(used);
  EXPECT_LT((mean.y - wanted.y).cwiseAbs().maxCoeff(), 100 * epsilon);
  EXPECT_LT((mean.u - wanted.u).cwiseAbs().maxCoeff(), 100 * epsilon);
  const Ensemble scaled = weighted(e, weights);
  EXPECT_EQ(scaled.samples().row(1).norm(), 0.0);
  EXPECT_EQ(scaled.samples().row(2), e.samples().row(2));
}

TEST(Corrections, AreKeptInTheTextOfAModel) {
  Provenance origin;
  origin.corrections = {{{"16", 0.0}, {"run 7", 0.125}}, {{"3", 1, 40, testing::nan}, {"4", 0, 2, -0.1}}};
  const Provenance read = io::provenance_of(io::provenance_text(origin));
  EXPECT_EQ(read.corrections.experiments, origin.corrections.experiments);
  ASSERT_EQ(read.corrections.samples.size(), 2u);
  EXPECT_TRUE(std::isnan(read.corrections.samples[0].value));
  EXPECT_EQ(read.corrections.samples[1].label, "4");
  EXPECT_EQ(read.corrections.samples[1].step, 2);
  EXPECT_EQ(read.corrections.samples[1].value, -0.1);
  EXPECT_EQ(io::provenance_text(read), io::provenance_text(origin));
}

TEST(Corrections, OfWrongFormAreIgnored) {
  const Provenance read = io::provenance_of(
      R"({"corrections":{"experiments":[{"label":3,"weight":0},{"label":"a","weight":2},7],"samples":[{"label":"a"}]}})");
  EXPECT_TRUE(read.corrections.empty());
}

}  // namespace
}  // namespace tokid::testing
