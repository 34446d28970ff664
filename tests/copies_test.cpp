// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/copies.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <limits>
#include <set>

#include "diagnose/repeats.hpp"
#include "testing.hpp"
#include "tokid/cross_validate.hpp"
#include "tokid/identify.hpp"
#include "tokid/refine_model.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

using testing::mentions;

using Groups = std::vector<std::vector<Index>>;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

Ensemble campaign(Index experiments, Index steps, std::uint64_t seed, double noise = 0.0) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, steps, 0.8, seed), experiments, seed + 100);
  return noise > 0 ? with_noise(e, noise, seed + 200) : e;
}

std::vector<Index> rows_from(Index begin, Index end, Index times = 1) {
  std::vector<Index> list;
  for (Index i = 0; i < times; ++i)
    for (Index n = begin; n < end; ++n) list.push_back(n);
  return list;
}

// Every experiment twice: 0 … N-1 and N … 2N-1, the second ones changed.
Ensemble twice(const Ensemble& e, const std::function<double(double)>& change) {
  Ensemble result = e.subset(rows_from(0, e.experiments(), 2));
  for (Index c = 0; c < result.samples().cols(); ++c)
    for (Index n = e.experiments(); n < result.experiments(); ++n)
      result.samples()(n, c) = change(result.samples()(n, c));
  return result;
}

Groups pairs(Index count) {
  Groups result;
  for (Index n = 0; n < count; ++n) result.push_back({n, count + n});
  return result;
}

double to_text(double value, const char* format) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return std::atof(text);
}

TEST(Copies, AreRecognisedWithinRounding) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const double noise : {0.0, 1e-3, 0.1}) {
      const Ensemble e = campaign(12, 60, seed, noise);
      Random random(seed);
      const std::vector<std::pair<const char*, std::function<double(double)>>> changes{
          {"exact", [](double v) { return v; }},
          {"1e-12", [&](double v) { return v * (1 + 1e-12 * random.normal()); }},
          {"1e-6", [&](double v) { return v * (1 + 1e-6 * random.normal()); }},
          {"factor", [](double v) { return v * (1 + 1e-6); }},
          {"single precision", [](double v) { return double(float(v)); }},
          {"six digits", [](double v) { return to_text(v, "%.6g"); }},
          {"four digits", [](double v) { return to_text(v, "%.4g"); }},
          {"four decimals", [](double v) { return to_text(v, "%.4f"); }}};
      for (const auto& [name, change] : changes)
        EXPECT_EQ(find_copies(twice(e, change)).groups, pairs(12)) << name << ", noise " << noise << ", seed " << seed;
      EXPECT_EQ(find_copies(e).groups, Groups{}) << noise;
      EXPECT_EQ(find_copies(e).used, rows_from(0, 12));
    }
}

// A channel far from zero: what is rounding there is measured by its motion, unless the digits show that it is.
TEST(Copies, AreRecognisedFarFromZero) {
  Ensemble e = campaign(12, 60, 5, 1e-2);
  for (Index k = 0; k < 60; ++k) e.output(k).col(0).array() += 1e5 + 1e3 * double(k);
  EXPECT_EQ(find_copies(twice(e, [](double v) { return double(float(v)); })).groups, pairs(12));
  EXPECT_EQ(find_copies(twice(e, [](double v) { return v; })).groups, pairs(12));
  // The same inputs and noise of its own, below single precision of the outputs' size.
  Ensemble again = e.subset(rows_from(0, 12, 2));
  Random random(1);
  for (Index k = 0; k < 60; ++k)
    for (Index n = 12; n < 24; ++n)
      for (Index j = 0; j < 2; ++j) again.y(n, k, j) += 1e-3 * random.normal();
  EXPECT_EQ(find_copies(again).groups, Groups{});
}

// Five courses of the inputs, each ten times, with noise of its own.
TEST(Copies, RepetitionsWithNoiseAreNone) {
  for (const double noise : {0.1, 1e-2, 1e-3, 1e-4, 1e-5})
    for (const std::uint64_t seed : {1, 2, 3}) {
      const Ensemble e = with_noise(campaign(5, 80, seed).subset(rows_from(0, 5, 10)), noise, seed);
      EXPECT_EQ(find_copies(e).groups, Groups{}) << noise << ", seed " << seed;
      EXPECT_EQ(findings_of_repeats(e, 8, 2).size(), 1) << noise;
    }
  // Without noise the simulator has done the same work again.
  EXPECT_EQ(find_copies(campaign(5, 80, 1).subset(rows_from(0, 5, 10))).used, rows_from(0, 5));
}

TEST(Copies, OfCoarseConvertersAreTheEqualOnes) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Ensemble e = with_noise(campaign(6, 80, seed).subset(rows_from(0, 6, 4)), 0.1, seed);
    e.samples() = ((e.samples() / 0.25).array().round() * 0.25).matrix().eval();
    EXPECT_EQ(find_copies(e).groups, Groups{}) << seed;
    e.samples().row(7) = Matrix(e.samples().row(3));
    EXPECT_EQ(find_copies(e).groups, (Groups{{3, 7}})) << seed;
  }
}

TEST(Copies, SharedStretchesAreNone) {
  Ensemble e = campaign(20, 100, 3, 0.01);
  const Index half = 50 * e.channels();
  e.samples().leftCols(half).rowwise() = Eigen::RowVectorXd(e.samples().row(0).head(half));
  EXPECT_EQ(find_copies(e).groups, Groups{});
  e.samples().leftCols(half).setZero();
  EXPECT_EQ(find_copies(e).groups, Groups{});
  e.samples().row(13) = Matrix(e.samples().row(4));
  EXPECT_EQ(find_copies(e).groups, (Groups{{4, 13}}));
  e.y(13, 99, 1) += 0.1;  // the last sample alone
  EXPECT_EQ(find_copies(e).groups, Groups{});
}

// One pulse in each of many experiments, which a few steps tell nothing of.
TEST(Copies, AreFoundAmongManyThatAreAlikeAtMostSteps) {
  Ensemble e(600, 300, 1, 1);
  e.samples().setZero();
  for (Index n = 0; n < 600; ++n) e.u(n, n % 300, 0) = 1.0;
  EXPECT_EQ(find_copies(e).groups, pairs(300));
}

TEST(Copies, WithGapsOfTheirOwnAreRecognised) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Ensemble e = twice(campaign(15, 60, seed, 0.05), [](double v) { return double(float(v)); });
    Random random(seed);
    for (Index n = 15; n < 30; ++n)
      for (Index k = 0; k < 60; ++k)
        if (random.normal() > 1.3) e.y(n, k, 1) = nan;  // one in ten
    EXPECT_EQ(find_copies(e).groups, pairs(15)) << seed;
    for (Index n = 0; n < 15; ++n)
      for (Index k = 30; k < 60; ++k) e.u(n, k, 0) = nan;
    Groups most = pairs(15);  // the one with more samples is used
    for (auto& pair : most) std::swap(pair[0], pair[1]);
    EXPECT_EQ(find_copies(e).groups, most) << seed;
    EXPECT_EQ(find_copies(e).used, rows_from(15, 30)) << seed;
  }
  // Halves that have no sample in common show nothing.
  Ensemble e = twice(campaign(15, 60, 1, 0.05), [](double v) { return v; });
  const Index half = 30 * e.channels();
  e.samples().topLeftCorner(15, half).setConstant(nan);
  e.samples().bottomRightCorner(15, half).setConstant(nan);
  EXPECT_EQ(find_copies(e).groups, Groups{});
}

// However few of the steps they have, and wherever.
TEST(Copies, OfShortExperimentsAreRecognised) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    Ensemble e = campaign(60, 400, seed, 0.05);
    Random random(seed);
    Groups expected;
    for (Index n = 0; n < 20; n += 2) {
      const Index length = Index(random.uniform(3, 30)), begin = Index(random.uniform(0, double(400 - length)));
      const bool rounded = n % 4 == 0;
      for (Index k = 0; k < 400; ++k)
        for (Index c = 0; c < e.channels(); ++c) {
          double& own = e.samples()(n, k * e.channels() + c);
          if (k < begin || k >= begin + length) own = nan;
          e.samples()(n + 1, k * e.channels() + c) = rounded ? double(float(own)) : own;
        }
      expected.push_back({n, n + 1});
    }
    EXPECT_EQ(find_copies(e).groups, expected);
  }
}

TEST(Copies, OneFarOffExperimentHidesNone) {
  Ensemble e = twice(campaign(12, 60, 4, 0.01), [](double v) { return v * (1 + 1e-7); });
  e.samples().row(5) *= 1e6;
  Groups expected = pairs(12);
  expected.erase(expected.begin() + 5);
  EXPECT_EQ(find_copies(e).groups, expected);
  const Ensemble repeated = with_noise(campaign(5, 60, 4).subset(rows_from(0, 5, 4)), 1e-3, 1);
  Ensemble spike = repeated;
  spike.samples().row(2) *= 1e6;
  EXPECT_EQ(find_copies(spike).groups, Groups{});
}

// Experiments of any size are as different as large ones.
TEST(Copies, SmallExperimentsAreNone) {
  Ensemble e = campaign(20, 60, 6);
  e.samples().topRows(8) *= 1e-7;
  EXPECT_EQ(find_copies(e).groups, Groups{});
  EXPECT_EQ(find_copies(twice(e, [](double v) { return double(float(v)); })).groups, pairs(20));
}

TEST(Copies, OfOneRecord) {
  const Ensemble e = campaign(1, 400, 2, 0.1);
  EXPECT_EQ(find_copies(e).groups, Groups{});
  EXPECT_EQ(find_copies(twice(e, [](double v) { return v; })).groups, pairs(1));
  EXPECT_EQ(find_copies(twice(e, [](double v) { return v * (1 + 1e-7); })).groups, pairs(1));
}

TEST(Copies, AreToldByTheirRows) {
  const Ensemble e = campaign(6, 40, 1).subset({0, 1, 2, 0, 4, 1, 0});
  const Copies copies = find_copies(e);
  EXPECT_EQ(copies.groups, (Groups{{0, 3, 6}, {1, 5}}));
  EXPECT_EQ(copies.used, (std::vector<Index>{0, 1, 2, 4}));
  EXPECT_EQ(in_words(findings_of(copies, e)),
            (std::vector<std::string>{
                "3 of 7 experiments are copies of other experiments, within rounding: experiments 3 and 6 of "
                "experiment 0; experiment 5 of experiment 1. The copies are not used"}));
  Ensemble named = e;
  set_experiment_names(named, {"a", "b", "c", "d", "e", "f", "g"});
  EXPECT_NE(in_words(findings_of(copies, named)).front().find("\"f\" (row 5) of experiment \"b\" (row 1)"),
            std::string::npos);
}

// The model is that of the experiments, each of them once, to the last bit; but it knows the whole data.
TEST(Copies, AreUsedOnce) {
  for (const double noise : {0.0, 0.05}) {
    const Ensemble once = campaign(24, 40, 7, noise);
    const Ensemble all = twice(once, [](double v) { return double(float(v)); });
    const Identification plain = identify(once), found = identify(all);
    EXPECT_EQ(testing::all(found.model, &Step::A), testing::all(plain.model, &Step::A));
    EXPECT_EQ(testing::all(found.model, &Step::G), testing::all(plain.model, &Step::G));
    EXPECT_EQ(found.experiments, 24);
    EXPECT_EQ(found.copies.groups, pairs(24));
    EXPECT_EQ(found.findings.size(), plain.findings.size() + 1);
    EXPECT_TRUE(has_seen(found.model.provenance, all));
    EXPECT_TRUE(has_seen(found.model.provenance, once));
    const IdentifyOptions stated{.states = 3, .lags = 2, .refine = false};
    IdentifyOptions half = stated;
    half.hold_out = 0.5;
    EXPECT_EQ(testing::all(identify(all, half).model, &Step::A), testing::all(identify(once, half).model, &Step::A));

    const CrossValidation folds = cross_validate(all, stated, {.folds = 4});
    EXPECT_EQ(folds.simulation.fit, cross_validate(once, stated, {.folds = 4}).simulation.fit);
    std::set<Index> judged;
    for (const Fold& fold : folds.folds) judged.insert(fold.experiments.begin(), fold.experiments.end());
    EXPECT_EQ(judged.size(), 24);
    EXPECT_EQ(folds.findings.size(), 1);

    UpdateState state = update_state(all, found, {}), plain_state = update_state(once, plain, {});
    EXPECT_EQ(state.factors.factor, plain_state.factors.factor);
    const Ensemble more = campaign(10, 40, 7, noise).subset(rows_from(0, 10, 2));
    EXPECT_EQ(update(state, more).size(), 1);
    EXPECT_EQ(state.factors.experiments, 34);
  }
}

TEST(Copies, OutliersHaveTheRowsOfTheData) {
  Ensemble e = campaign(30, 60, 3, 0.05);
  for (Index k = 0; k < 60; ++k) std::swap(e.y(20, k, 0), e.y(20, k, 1));
  std::vector<Index> order{4, 4, 4};
  for (Index n = 0; n < 30; ++n) order.push_back(n);
  const Identification found = identify(e.subset(order));
  ASSERT_EQ(found.outliers.size(), 1);
  EXPECT_EQ(found.outliers.front().experiment, 23);
  EXPECT_EQ(mentions(found.findings, "experiment 23 does not fit"), 1);
  EXPECT_EQ(found.copies.groups, (Groups{{0, 1, 2, 7}}));
}

TEST(Copies, BoundsCountThemOnce) {
  const Ensemble once = campaign(40, 30, 2, 0.05);
  const Ensemble all = twice(once, [](double v) { return v; });
  const Model model = identify(once).model;
  EXPECT_EQ(confidence(model, all).freedom, confidence(model, once).freedom);
}

// Time of the processor that grows with the number of experiments, not with its square; also where many are nearly
// alike.
TEST(Copies, TakeTimeThatIsLinear) {
  const auto time = [](Index experiments) {
    Ensemble e = with_noise(campaign(5, 20, 1).subset(rows_from(0, 5, experiments / 5)), 1e-3, 1);
    e.samples().row(experiments - 1) = Matrix(e.samples().row(3));
    const std::clock_t begin = std::clock();
    EXPECT_EQ(find_copies(e).groups, (Groups{{3, experiments - 1}}));
    return double(std::clock() - begin);
  };
  const double small = std::min(time(2000), time(2000));
  EXPECT_LT(time(32000), 100 * small);  // 16 times as many; squares would take 256 times as long
}

}  // namespace
}  // namespace tokid::testing
