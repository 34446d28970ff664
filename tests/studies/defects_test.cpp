// Experiments and samples that do not fit: they are named, and the option `outliers` acts on them.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/defects.hpp"

#include <gtest/gtest.h>

#include "tokid/uncertainty.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

constexpr Index runs = 60, record = 60;

IdentifyOptions quick(const NoisySystem& system) {
  IdentifyOptions options{.period = system.period};
  options.refine = false;
  return options;
}

Place place(const NoisySystem& system, std::uint64_t seed) {
  return {Index(seed * 7 + 3) % runs, Index(seed) % system.model.outputs, 10 + Index(seed * 13) % 40};
}

// The study counts ten seeds, with hold-out too.
TEST(Defects, AreNamedAndDropped) {
  for (const std::string& name : noisy_systems())
    for (const Defect defect : defects) {
      const std::uint64_t seed = 1 + std::uint64_t(defect);
      SCOPED_TRACE(name + ", " + testing::name(defect));
      const NoisySystem system = noisy_system(name, record, seed);
      const Place at = place(system, seed);
      const Ensemble data = with_defect(system.experiments(runs, seed), system, defect, at);
      IdentifyOptions options = quick(system);
      options.outliers = OutlierChoice::drop;
      const Identification found = identify(data, options);
      const Accused named = accused(found, defect, at);
      EXPECT_TRUE(named.right);
      EXPECT_EQ(named.wrong_experiments + named.wrong_samples, 0);
      EXPECT_EQ(mentions(found.findings, "was dropped"), 1);
      // Nothing else was dropped. The model is therefore that of the data without the defect.
      if (name != noisy_systems().front()) continue;  // the others take as long again
      const Identification by_hand = identify(without_defect(data, defect, at), quick(system));
      EXPECT_EQ(found.experiments, by_hand.experiments);
      EXPECT_NEAR(one_step_error(system, found.model, seed) / one_step_error(system, by_hand.model, seed), 1.0, 1e-6);
    }
}

TEST(Defects, AreKeptUnlessAskedOtherwise) {
  const NoisySystem system = noisy_system("varying 2x2", record, 3);
  const Place at = place(system, 3);
  const Ensemble data = with_defect(system.experiments(runs, 3), system, Defect::late, at);
  const Identification found = identify(data, quick(system));
  ASSERT_EQ(found.outliers.size(), 1u);
  EXPECT_EQ(found.outliers.front().weight, 1.0);
  EXPECT_EQ(found.experiments, runs);
  EXPECT_TRUE(found.model.provenance.corrections.empty());
  EXPECT_EQ(mentions(found.findings, "was dropped"), 0);
}

TEST(Defects, CountLessIfDownweighted) {
  for (const Defect defect : {Defect::sign, Defect::sample}) {
    SCOPED_TRACE(name(defect));
    const NoisySystem system = noisy_system("varying 2x2", record, 4);
    const Place at = place(system, 4);
    const Ensemble data = with_defect(system.experiments(runs, 4), system, defect, at);
    IdentifyOptions options = quick(system);
    options.outliers = OutlierChoice::downweight;
    const Identification found = identify(data, options);
    EXPECT_TRUE(accused(found, defect, at).right);
    EXPECT_EQ(found.experiments, runs);
    const Corrections& made = found.model.provenance.corrections;
    if (defect == Defect::sample) {
      ASSERT_EQ(made.samples.size(), 1u);
      // Between the prediction and the measured sample.
      const double moved = std::abs(made.samples.front().value - data.y(at.experiment, at.step, at.output));
      EXPECT_NEAR(moved / innovation_deviation(system, at), 10, 4);
    } else {
      ASSERT_EQ(made.experiments.size(), 1u);
      EXPECT_GT(made.experiments.front().weight, 0);
      EXPECT_LT(made.experiments.front().weight, 0.1);
    }
    const Identification by_hand = identify(without_defect(data, defect, at), quick(system));
    EXPECT_LT(one_step_error(system, found.model, 4), 1.2 * one_step_error(system, by_hand.model, 4));
  }
}

TEST(Defects, OfHeldOutExperimentsAreNamed) {
  const NoisySystem system = noisy_system("varying 2x2", record, 5);
  const Ensemble healthy = system.experiments(runs, 5);
  const Place at{split(healthy, 0.2).held_out_rows[3], 1, 20};
  for (const Defect defect : {Defect::scaled, Defect::sample}) {
    SCOPED_TRACE(name(defect));
    IdentifyOptions options = quick(system);
    options.hold_out = 0.2;
    const Identification found = identify(with_defect(healthy, system, defect, at), options);
    const Accused named = accused(found, defect, at);
    EXPECT_TRUE(named.right);
    EXPECT_EQ(named.wrong_experiments + named.wrong_samples, 0);
    if (defect == Defect::sample) continue;
    EXPECT_TRUE(found.outliers.front().held_out);
    EXPECT_EQ(mentions(found.findings, "The experiment is held out"), 1);
  }
}

TEST(Defects, OfSeveralExperimentsDoNotHideEachOther) {
  const NoisySystem system = noisy_system("varying 2x2", record, 6);
  Ensemble data = system.experiments(runs, 6);
  for (const Index n : {3, 17, 18, 44}) data = with_defect(data, system, Defect::sign, {n, n % 2, 0});
  data = with_defect(data, system, Defect::sample, {30, 0, 33});
  IdentifyOptions options = quick(system);
  options.outliers = OutlierChoice::drop;
  const Identification found = identify(data, options);
  std::vector<Index> dropped;
  for (const Outlier& o : found.outliers)
    if (o.weight == 0) dropped.push_back(o.experiment);
  std::sort(dropped.begin(), dropped.end());
  EXPECT_EQ(dropped, (std::vector<Index>{3, 17, 18, 44}));
  ASSERT_EQ(found.validation.outlying.size(), 1u);
  EXPECT_EQ(found.validation.outlying.front().experiment, 30);
  EXPECT_EQ(found.validation.outlying.front().steps, (std::vector<Index>{33}));
}

TEST(Defects, AreNotInBoundsAndUpdatesAfterTheyWereDropped) {
  const NoisySystem system = noisy_system("varying 1x1", record, 7);
  const Place at = place(system, 7);
  const Ensemble data = with_defect(system.experiments(runs, 7), system, Defect::sign, at);
  IdentifyOptions options = quick(system);
  options.outliers = OutlierChoice::drop;
  const Identification dropped = identify(data, options);
  const Ensemble rest = without_defect(data, Defect::sign, at);
  const Identification by_hand = identify(rest, quick(system));
  const Confidence a = confidence(dropped.model, data), b = confidence(by_hand.model, rest);
  EXPECT_EQ(a.experiments, runs - 1);
  EXPECT_EQ(mentions(a.findings, "other data"), 0);
  EXPECT_EQ(a.markov.step.back().lower, b.markov.step.back().lower);
  const UpdateState state = update_state(data, dropped, options);
  EXPECT_EQ(state.factors.experiments, runs - 1);
  EXPECT_EQ(state.factors.factor, update_state(rest, by_hand, quick(system)).factors.factor);

  options.outliers = OutlierChoice::downweight;
  const Identification less = identify(data, options);
  EXPECT_NE(message([&] { confidence(less.model, data); }).find("outliers: downweight found"), std::string::npos);
  EXPECT_NE(message([&] { update_state(data, less, options); }).find("outliers: downweight found"), std::string::npos);
}

}  // namespace
}  // namespace tokid::testing
