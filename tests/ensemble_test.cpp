// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/ensemble.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "data/survey.hpp"
#include "testing.hpp"
#include "tokid/copies.hpp"
#include "tokid/cross_validate.hpp"
#include "tokid/em.hpp"
#include "tokid/example.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/identify.hpp"
#include "tokid/innovations.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/refine_model.hpp"
#include "tokid/report.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/update.hpp"
#include "tokid/windows.hpp"

namespace tokid::testing {
namespace {

// Every sample tells where it belongs: 10000·experiment + 100·step + channel.
Ensemble numbered(Index experiments, Index steps, Index inputs, Index outputs) {
  Ensemble e(experiments, steps, inputs, outputs);
  for (Index n = 0; n < experiments; ++n)
    for (Index k = 0; k < steps; ++k) {
      for (Index i = 0; i < inputs; ++i) e.u(n, k, i) = double(10000 * n + 100 * k + i);
      for (Index j = 0; j < outputs; ++j) e.y(n, k, j) = double(10000 * n + 100 * k + inputs + j);
    }
  return e;
}

TEST(Ensemble, WindowHoldsTheOldestLagFirstAndTheInputOfTheStepLast) {
  const Ensemble e = numbered(3, 6, 2, 1);
  const Matrix w = e.window(4, 2);
  ASSERT_EQ(w.cols(), 2 * 3 + 2);
  const double expected[] = {200, 201, 202, 300, 301, 302, 400, 401};
  for (Index c = 0; c < w.cols(); ++c) EXPECT_EQ(w(1, c), 10000 + expected[c]);
  EXPECT_EQ(e.window_and_output(4, 2).rightCols(1), e.output(4));
  EXPECT_EQ(e.window(0, 0), e.input(0));
}

TEST(Ensemble, ExperimentsThatShareNoStepAreWarnedOf) {
  Ensemble e = numbered(3, 12, 1, 1);
  EXPECT_TRUE(findings_of_overlap(e).empty());
  const auto only = [&e](Index n, Index begin, Index end) {
    for (Index k = 0; k < e.steps(); ++k)
      if (k < begin || k >= end) e.u(n, k, 0) = e.y(n, k, 0) = nan;
  };
  only(1, 3, 8);
  only(2, 7, 12);
  EXPECT_TRUE(findings_of_overlap(e).empty());
  only(1, 3, 7);
  const std::vector<std::string> found = in_words(findings_of_overlap(e));
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NE(found[0].find("experiment 2 begins at step 7, after experiment 1 has ended at step 6"), std::string::npos)
      << found[0];
}

TEST(Ensemble, InputsAndOutputsOfAnExperimentHaveOneRowForEachStep) {
  const Ensemble e = numbered(3, 5, 2, 3);
  const Matrix u = e.inputs_of(1), y = e.outputs_of(2);
  ASSERT_TRUE(u.rows() == 5 && u.cols() == 2 && y.rows() == 5 && y.cols() == 3);
  for (Index k = 0; k < 5; ++k) {
    for (Index i = 0; i < 2; ++i) EXPECT_EQ(u(k, i), e.u(1, k, i));
    for (Index j = 0; j < 3; ++j) EXPECT_EQ(y(k, j), e.y(2, k, j));
  }
}

TEST(Ensemble, CompleteRowsAreThoseWithoutAMissingSampleInTheWindow) {
  Ensemble e = numbered(4, 6, 1, 1);
  e.y(0, 1, 0) = nan;
  e.u(2, 3, 0) = nan;
  EXPECT_EQ(e.missing(), 2);
  EXPECT_EQ(e.complete_rows(1, 1), (std::vector<Index>{1, 2, 3}));
  EXPECT_EQ(e.complete_rows(3, 2), (std::vector<Index>{1, 3}));
  EXPECT_EQ(e.complete_rows(5, 1), (std::vector<Index>{0, 1, 2, 3}));
}

TEST(Ensemble, WhatLiesBeyondTheLengthsIsNoMissingSample) {
  Ensemble e = numbered(3, 4, 1, 1);
  e.y(1, 0, 0) = nan;
  set_length(e, {4, 2, 0});
  EXPECT_EQ(e.length, (std::vector<Index>{4, 2, 0}));
  EXPECT_EQ(e.missing(), 1 + 4 + 8);
  EXPECT_EQ(missing_samples(e), 1);
  EXPECT_EQ(e.u(1, 1, 0), numbered(3, 4, 1, 1).u(1, 1, 0));
  EXPECT_THROW(set_length(e, {4, 2}), std::invalid_argument);
  EXPECT_THROW(set_length(e, {4, 2, 5}), std::invalid_argument);
}

TEST(Ensemble, SubsetAndSplitKeepWholeExperiments) {
  Ensemble e = numbered(10, 3, 1, 2);
  e.length = {3, 3, 3, 3, 3, 3, 3, 3, 3, 2};
  const Split parts = split(e, 0.3);
  ASSERT_EQ(parts.training.experiments(), 7);
  ASSERT_EQ(parts.held_out.experiments(), 3);
  EXPECT_EQ(parts.held_out.length.back(), 2);
  // The held-out experiments are spread over the campaign.
  std::vector<double> first;
  for (Index n = 0; n < 3; ++n) first.push_back(parts.held_out.u(n, 0, 0) / 10000);
  EXPECT_EQ(first, (std::vector<double>{3, 6, 9}));
  for (const double bad : {0.0, 1.0, -0.1, 0.01, 0.99, nan}) EXPECT_THROW(split(e, bad), std::invalid_argument) << bad;
}

TEST(Ensemble, ChannelsAreTakenByNameInAnyOrderAndAmongOthers) {
  Ensemble data = numbered(3, 5, 3, 2);
  data.names = {{"a", "b", "c"}, {"p", "q"}, {"N", "", "V"}, {}};
  data.length = {5, 4, 5};
  data.experiment_names = {"17", "4", "x"};
  data.free = {2, 3, Matrix::Random(2, 6)};
  const auto wanted = [](std::vector<std::string> inputs, std::vector<std::string> outputs) {
    return Channels{std::move(inputs), std::move(outputs), {}, {}};
  };
  const auto found = in_order(data, wanted({"c", "a"}, {"q", "p"}));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->names.input_units, (std::vector<std::string>{"V", "N"}));
  EXPECT_EQ(found->length, data.length);
  EXPECT_EQ(found->experiment_names, data.experiment_names);
  for (Index k = 0; k < 5; ++k) {
    EXPECT_EQ(found->input(k).col(0), data.input(k).col(2));
    EXPECT_EQ(found->input(k).col(1), data.input(k).col(0));
    EXPECT_EQ(found->output(k).col(0), data.output(k).col(1));
  }
  for (Index k = 0; k < 3; ++k) EXPECT_EQ(found->free.y.col(2 * k), data.free.y.col(2 * k + 1));
  const auto back = in_order(*in_order(data, wanted({"c", "b", "a"}, {"q", "p"})), data.names);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->samples(), data.samples());
  EXPECT_FALSE(in_order(data, data.names));                                    // as it stands
  EXPECT_FALSE(in_order(data, wanted({"a", "d"}, {"p", "q"})));                // no channel "d"
  EXPECT_FALSE(in_order(data, {}));                                            // nothing is wanted
  EXPECT_FALSE(in_order(numbered(3, 5, 2, 1), wanted({"u2", "u1"}, {"y1"})));  // the data name nothing
  data.names.input_names = {"a", "a", "c"};
  EXPECT_FALSE(in_order(data, wanted({"c", "a"}, {"q", "p"})));  // which "a"?
}

std::vector<std::string> names_from(Index first, Index count) {
  std::vector<std::string> names;
  for (Index n = 0; n < count; ++n) names.push_back(std::to_string(first + n));
  return names;
}

TEST(Ensemble, ExperimentsAreCalledByTheirNamesWithTheirRows) {
  Ensemble e = numbered(4, 3, 1, 1);
  EXPECT_EQ(e.experiment(2), "2");
  EXPECT_EQ(e.experiment_name(2), "");
  set_experiment_names(e, {"17", "0", "after lunch", "3"});
  EXPECT_EQ(e.experiment(0), "\"17\" (row 0)");
  EXPECT_EQ(e.experiment(1), "\"0\" (row 1)");
  EXPECT_EQ(e.experiment(2), "\"after lunch\" (row 2)");
  EXPECT_EQ(e.experiment(3), "3");  // the name of row 3 is 3
  e.u(2, 1, 0) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(message([&] { e.check(); }),
            "input u1: infinite value in experiment \"after lunch\" (row 2) at step 1, finite or missing (NaN) needed");
}

TEST(Ensemble, NamesOfExperimentsAreHarmless) {
  Ensemble e = numbered(3, 3, 1, 1);
  set_experiment_names(e, {"a\nb\x1b[31m", "\u202eevil", std::string(10'000, 'x')});
  EXPECT_EQ(e.experiment(0), "\"a b [31m\" (row 0)");
  EXPECT_EQ(e.experiment(1), "\"evil\" (row 1)");
  EXPECT_EQ(e.experiment(2), "\"" + std::string(80, 'x') + "…\" (row 2)");
}

TEST(Ensemble, NamesOfExperimentsAreDifferentAndSayMoreThanRows) {
  Ensemble e = numbered(3, 3, 1, 1);
  set_experiment_names(e, {"0", "1", "2"});
  EXPECT_TRUE(e.experiment_names.empty());
  set_experiment_names(e, {"0", "2", "1"});
  EXPECT_EQ(e.experiment_names, (std::vector<std::string>{"0", "2", "1"}));
  const auto refused = [&e](std::vector<std::string> names) {
    return message([&] { set_experiment_names(e, std::move(names)); });
  };
  EXPECT_EQ(refused({"a", "b"}), "experiment_names: 2 names found for 3 experiments");
  EXPECT_EQ(refused({"a", "b", ""}), "experiment_names: an empty text found at row 2, a name needed");
  EXPECT_EQ(refused({"a", "b", "a"}), "experiment_names: \"a\" found at rows 0 and 2, different names needed");
  EXPECT_EQ(e.experiment_names, (std::vector<std::string>{"0", "2", "1"}));
  e.experiment_names.pop_back();
  EXPECT_EQ(message([&] { e.check(); }), "experiment_names: 2 names found for 3 experiments");
  set_experiment_names(e, {});
  EXPECT_TRUE(e.experiment_names.empty());
}

TEST(Ensemble, PartsRememberWhichExperimentsTheyHold) {
  Ensemble e = numbered(60, 6, 1, 1);
  EXPECT_EQ(e.subset({3, 5}).experiment_names, (std::vector<std::string>{"3", "5"}));
  EXPECT_EQ(e.subset({3, 5}).subset({1}).experiment(0), "\"5\" (row 0)");
  EXPECT_TRUE(e.subset({0, 1, 2}).experiment_names.empty());
  EXPECT_TRUE(e.subset({3, 3}).experiment_names.empty());
  set_experiment_names(e, names_from(1, 60));
  EXPECT_EQ(e.subset({16, 3}).experiment_names, (std::vector<std::string>{"17", "4"}));
  EXPECT_TRUE(e.subset({16, 16}).experiment_names.empty());
  const Split parts = split(e, 0.25);
  ASSERT_EQ(parts.held_out_rows.size(), 15u);
  for (Index n = 0; n < 15; ++n) {
    const Index row = parts.held_out_rows[size_t(n)];
    EXPECT_EQ(parts.held_out.experiment_name(n), std::to_string(row + 1));
    EXPECT_EQ(parts.held_out.u(n, 0, 0), e.u(row, 0, 0));
  }
  EXPECT_EQ(stretch(e, 2, 5).experiment_names, e.experiment_names);
  EXPECT_EQ(departures(e, nominal_trajectory(e)).experiment_names, e.experiment_names);
  const Ensemble pieces = cut(e, 2);
  EXPECT_EQ(pieces.experiment_name(16), "17 from step 0 on");
  EXPECT_EQ(pieces.experiment_name(60 + 16), "17 from step 2 on");
  EXPECT_TRUE(cut(numbered(2, 4, 1, 1), 2).experiment_names.empty());
}

TEST(Ensemble, EndOfASingleRecordIsHeldOutFromAStepOfTheFirstPhaseOn) {
  const Split parts = split(numbered(1, 100, 1, 1), 0.25, 4);
  EXPECT_EQ(parts.training.steps(), 72);
  EXPECT_EQ(parts.held_out.steps(), 28);
  EXPECT_EQ(parts.held_out.u(0, 0, 0), 7200);
  EXPECT_EQ(
      message([] { split(numbered(1, 10, 1, 1), 0.5, 7); }),
      "hold-out fraction: 0.5 of 10 steps leaves 0 steps to identify with: leave at least one period, and hold out at least one "
      "step");
  EXPECT_EQ(split(numbered(4, 100, 1, 1), 0.25, 4).training.steps(), 100);
}

TEST(Ensemble, FingerprintsAreOfTheSamplesAlone) {
  Ensemble e = numbered(3, 5, 2, 1);
  const std::string own = fingerprint(e);
  EXPECT_EQ(own.size(), 16u);
  e.names.input_names = {"a", "b"};
  e.dt = 2.0;
  e.u(0, 0, 0) = -0.0;  // was 0
  EXPECT_EQ(fingerprint(e), own);
  Ensemble other = e;
  other.u(2, 4, 1) += 1e-9;
  EXPECT_NE(fingerprint(other), own);
  EXPECT_NE(fingerprint(e.subset({0, 2, 1})), own);
  EXPECT_NE(fingerprint(numbered(3, 5, 1, 2)), own);  // the same numbers as other channels
  // A sample is missing, whatever its bits are.
  e.y(1, 1, 0) = nan;
  other = e;
  other.y(1, 1, 0) = -nan;
  EXPECT_EQ(fingerprint(other), fingerprint(e));
  EXPECT_NE(fingerprint(e), own);
}

// Of as many experiments, steps and channels as make tiles of every kind: whole ones, cut ones, a single sample.
TEST(Ensemble, DigestsTellExperimentsApart) {
  Random random(11);
  for (const Index experiments : {1, 2, 31, 32, 33, 70})
    for (const Index steps : {1, 7, 16, 40}) {
      SCOPED_TRACE(fmt::format("{} x {}", experiments, steps));
      Ensemble e(experiments, steps, 2, 2);
      e.samples() = random.matrix(experiments, steps * 4);
      const std::vector<Digest> own = experiment_digests(e);
      ASSERT_EQ(own.size(), size_t(experiments));
      EXPECT_EQ(std::set<Digest>(own.begin(), own.end()).size(), own.size());
      // Those of an experiment alone, wherever it stands and whatever is said of it.
      Ensemble reversed = e;
      for (Index n = 0; n < experiments; ++n) reversed.samples().row(n) = e.samples().row(experiments - 1 - n);
      reversed.names.input_names = {"a", "b"};
      reversed.dt = 0.1;
      const std::vector<Digest> backwards = experiment_digests(reversed);
      EXPECT_TRUE(std::equal(own.rbegin(), own.rend(), backwards.begin()));
      EXPECT_EQ(experiment_digests(e.subset({experiments / 2})).front(), own[size_t(experiments / 2)]);
      // One bit of one sample, a gap, exchanged channels: each changes its own experiment and no other.
      const Index n = Index(random.uniform(0, double(experiments))), k = Index(random.uniform(0, double(steps)));
      const std::vector<std::function<void(Ensemble&)>> changes{
          [&](Ensemble& x) { x.y(n, k, 1) = std::nextafter(x.y(n, k, 1), 9.0); },
          [&](Ensemble& x) { x.u(n, k, 0) = nan; },
          [&](Ensemble& x) { std::swap(x.y(n, k, 0), x.y(n, k, 1)); },
          [&](Ensemble& x) { std::swap(x.u(n, k, 0), x.y(n, k, 0)); },
      };
      for (const auto& change : changes) {
        Ensemble other = e;
        change(other);
        const std::vector<Digest> found = experiment_digests(other);
        for (size_t i = 0; i < found.size(); ++i) EXPECT_EQ(found[i] == own[i], Index(i) != n) << i;
      }
      // Zeros and gaps are what they are, whatever their bits.
      Ensemble one = e, other = e;
      one.u(n, k, 1) = 0.0, other.u(n, k, 1) = -0.0;
      one.y(n, k, 0) = nan, other.y(n, k, 0) = -nan;
      EXPECT_EQ(experiment_digests(one), experiment_digests(other));
    }
}

TEST(Ensemble, ChecksNameChannelExperimentAndStep) {
  Ensemble e = numbered(3, 4, 1, 2);
  e.names.output_names = {"angle", "rate"};
  EXPECT_NO_THROW(e.check());
  Ensemble infinite = e;
  infinite.y(1, 2, 1) = std::numeric_limits<double>::infinity();
  EXPECT_NE(message([&] { infinite.check(); }).find("output rate: infinite value in experiment 1 at step 2"),
            std::string::npos);
  Ensemble silent = e;
  for (Index k = 0; k < 4; ++k) silent.output(k).col(0).setConstant(nan);
  EXPECT_NO_THROW(silent.check(false));  // where outputs are not needed
  EXPECT_NE(message([&] { silent.check(); }).find("output angle: all 12 samples are missing"), std::string::npos);
  Ensemble misnamed = e;
  misnamed.names.input_names = {"a", "b"};
  EXPECT_NE(message([&] { misnamed.check(); }).find("input_names: 2 found, 1 needed"), std::string::npos);
  Ensemble overlong = e;
  overlong.length = {4, 5, 4};
  EXPECT_NE(message([&] { overlong.check(); }).find("length: 5 found, 0 to 4 needed"), std::string::npos);
  EXPECT_THROW(Ensemble(1, 1, 0, 0), std::invalid_argument);
  EXPECT_THROW(Ensemble(1, 1, 1, 1, 0.0), std::invalid_argument);
  EXPECT_THROW(initial_state_from("rest"), std::invalid_argument);
  EXPECT_EQ(initial_state_from(to_string(InitialState::unknown)), InitialState::unknown);
}

TEST(Nominal, IsTheMeanOfTheSamplesThatAreThere) {
  Ensemble e = numbered(3, 2, 1, 1);
  e.y(2, 1, 0) = nan;
  const Nominal nominal = nominal_trajectory(e);
  EXPECT_DOUBLE_EQ(nominal.u(1, 0), 10100);
  EXPECT_DOUBLE_EQ(nominal.y(1, 0), 5101);
  const Ensemble rest = departures(e, nominal);
  EXPECT_DOUBLE_EQ(rest.u(0, 1, 0), -10000);
  EXPECT_TRUE(std::isnan(rest.y(2, 1, 0)));
}

// 0.1 and the like are no sums of powers of two: the mean of many is another number, if it is taken without care.
TEST(Nominal, WhatIsAlwaysTheSameDoesNotDepart) {
  Ensemble e(61, 20, 1, 2);
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k).setConstant(1e-5);
    e.output(k).col(0).setConstant(0.1);
    e.output(k).col(1).setConstant(double(k) / 3);
  }
  e.y(0, 3, 0) = nan;
  Nominal nominal = nominal_trajectory(e);
  const Ensemble rest = departures(e, nominal);
  for (const double value : rest.samples().reshaped()) EXPECT_TRUE(value == 0 || std::isnan(value));
  share_phases(nominal, 1);
  for (Index k = 0; k < e.steps(); ++k) EXPECT_EQ(nominal.y(k, 0), 0.1);
}

// Campaigns without a mean motion, of kinds that are hard on the test: outputs with a long memory, levels that do not
// change at all, inputs of two values that are held, initial states that die out, gaps, and pieces of one record.
Ensemble campaign(int kind, Random& random) {
  static constexpr Index sizes[] = {2, 3, 5, 8, 12, 20, 40};
  const Index N = sizes[size_t(random.uniform(0, 7))], T = random.uniform(0, 1) < 0.5 ? 12 : 60;
  const bool record = kind == 5;
  Ensemble e(record ? 1 : N, record ? 40 * T : T, 1, 2);
  const double memory = kind == 1 || record ? 0.9 : kind == 3 ? 0.0 : 0.5;
  for (Index n = 0; n < e.experiments(); ++n) {
    double x = random.normal() / std::sqrt(1 - memory * memory), held = 0.0;
    const double level = random.normal();
    for (Index k = 0; k < e.steps(); ++k) {
      if (k % (kind == 3 ? 5 : 1) == 0) held = random.normal();
      x = memory * x + random.normal();
      e.u(n, k, 0) = kind == 3 ? (held > 0 ? 1.0 : -1.0) : kind == 2 ? level : held;
      e.y(n, k, 0) = kind == 4 ? level * std::pow(0.8, double(k)) + 0.01 * random.normal() : x;
      e.y(n, k, 1) = kind == 2 ? 2 * level + 0.01 * random.normal() : kind == 0 ? random.uniform(-1, 1) : x * x * x;
      if (kind == 0 && random.uniform(0, 1) < 0.3) e.y(n, k, 0) = nan;
    }
  }
  return record ? cut(e, T) : e;
}

// One campaign in a thousand may be a false alarm: of 3000, ten or more would have a probability of 0.1 %.
TEST(Nominal, TestKeepsItsPromise) {
  Random random(7);
  int alarms = 0;
  for (int i = 0; i < 3000; ++i) alarms += test_nominal(campaign(i % 6, random)).significant;
  EXPECT_LT(alarms, 10);
}

TEST(Nominal, TestSeesAMotionOfTwiceTheSpread) {
  Random random(1);
  Ensemble e(20, 50, 1, 1);
  for (Index k = 0; k < 50; ++k) {
    e.input(k) = random.matrix(20, 1);
    e.output(k) = random.matrix(20, 1).array() + 2 * std::sin(0.1 * double(k) + 1);
  }
  EXPECT_TRUE(test_nominal(e).significant);
  EXPECT_FALSE(test_nominal(e.subset({3})).significant);  // a single experiment has no spread
}

// Over all steps together the first is lost in the noise, and at no step the second stands out.
TEST(Nominal, TestSeesFewStepsAndSmallMotionsThatLast) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Random random(seed);
    Ensemble brief(20, 100, 2, 2);
    brief.samples() = random.matrix(20, 400);
    Ensemble lasting = brief;
    for (Index k = 40; k < 46; ++k) brief.output(k).col(1).array() += 4.0;
    brief.y(3, 42, 1) = nan;
    const NominalTest few = test_nominal(brief);
    EXPECT_LT(few.statistic, few.threshold);
    EXPECT_GT(few.step_statistic, few.step_threshold);
    EXPECT_TRUE(few.significant);
    ASSERT_EQ(few.departures.size(), 1u);
    EXPECT_EQ(few.departures[0].channel, 3);
    EXPECT_EQ(few.departures[0].steps, (std::vector<Index>{40, 41, 42, 43, 44, 45}));

    lasting.samples().array() += 1.05;
    const NominalTest all = test_nominal(lasting);
    EXPECT_TRUE(all.significant);
    EXPECT_GT(all.statistic, all.threshold);
  }
}

// Every function that takes an ensemble of a caller.
TEST(Check, InfiniteSamplesAreRefusedByEachFunction) {
  const ExperimentOptions noise{.experiments = 30, .process_noise = 0.1, .measurement_noise = 0.1};
  const Ensemble data = experiments(oscillator(20), noise);
  IdentifyOptions options{.states = 4, .lags = 2, .initial_state = InitialState::zero};
  const Identification result = identify(data, options);
  const Model& model = result.model;
  ASSERT_TRUE(model.has(&Step::has_innovation_cov));
  const std::pair<const char*, std::function<void(const Ensemble&)>> calls[] = {
      {"simulate_data", [&](const Ensemble& e) { simulate_data(model, e); }},
      {"predict", [&](const Ensemble& e) { predict(model, e); }},
      {"estimate_state", [&](const Ensemble& e) { estimate_state(model, e, 2, 4); }},
      {"model_innovations", [&](const Ensemble& e) { model_innovations(model, e); }},
      {"validate", [&](const Ensemble& e) { validate(model, e); }},
      {"validate_distinct", [&](const Ensemble& e) { validate_distinct(model, e); }},
      {"experiment_fits", [&](const Ensemble& e) { experiment_fits(model, e); }},
      {"verdict", [&](const Ensemble& e) { verdict(model, e); }},
      {"report_page", [&](const Ensemble& e) { report_page(model, e); }},
      {"refine", [&](const Ensemble& e) { refine(model, e); }},
      {"refine_model", [&](const Ensemble& e) { refine_model(model, e); }},
      {"log_likelihoods", [&](const Ensemble& e) { log_likelihoods(model, e); }},
      {"confidence", [&](const Ensemble& e) { confidence(model, e); }},
      {"bootstrap",
       [&](const Ensemble& e) {
         bootstrap(
             model, e, [&](const Ensemble&) { return model; }, [](const Model&) { return Vector::Ones(1); });
       }},
      {"gtv_arx", [&](const Ensemble& e) { gtv_arx(e, {.lags = {2}}); }},
      {"lag_order_errors", [&](const Ensemble& e) { lag_order_errors(e); }},
      {"choose_smoothing", [&](const Ensemble& e) { choose_smoothing(e, {.lags = {2}}); }},
      {"window_factors", [&](const Ensemble& e) { window_factors(e, 2, InitialState::zero); }},
      {"update_state", [&](const Ensemble& e) { update_state(e, result, options); }},
      {"find_copies", [&](const Ensemble& e) { find_copies(e); }},
      {"cross_validate", [&](const Ensemble& e) { cross_validate(e, options); }},
      {"identify", [&](const Ensemble& e) { identify(e, options); }}};
  Ensemble bad_output = data, bad_input = data;
  bad_output.y(7, 5, 1) = std::numeric_limits<double>::infinity();
  bad_input.u(7, 5, 1) = -std::numeric_limits<double>::infinity();
  for (const auto& [name, call] : calls) {
    if (std::string_view(name) != "simulate_data") {  // this one may not read the outputs
      EXPECT_NE(message([&] { call(bad_output); }).find("output y2: infinite value in experiment 7 at step 5"),
                std::string::npos)
          << name << ": " << message([&] { call(bad_output); });
    }
    EXPECT_NE(message([&] { call(bad_input); }).find("input u2: infinite value in experiment 7 at step 5"),
              std::string::npos)
        << name << ": " << message([&] { call(bad_input); });
  }
  EXPECT_NE(message([&] { simulate(model, bad_input); }).find("input u2: infinite value"), std::string::npos);
  EXPECT_NO_THROW(simulate(model, bad_output));  // its outputs are not read
}

TEST(Survey, AnInputOfOneExperimentAloneIsNotTheSameInAll) {
  Ensemble e = numbered(3, 6, 1, 1);
  for (Index n = 0; n < 3; ++n) e.u(n, 2, 0) = 5;
  e.names.input_names = {"thrust"};
  set_length(e, {4, 6, 4});
  EXPECT_EQ(
      in_words(findings_of_inputs(survey(e, 0, 6), e.names)),
      (std::vector<std::string>{
          "input thrust is the same in every experiment at step 2: its effect at these steps can't be separated from the mean "
          "motion. Vary this input from experiment to experiment",
          "only one experiment has samples of input thrust at steps 4–5: its effect at these steps can't be identified"}));
  Survey parts = survey(e, 0, 3);
  parts.append(survey(e, 3, 6), 3);
  EXPECT_EQ(parts.alone, survey(e, 0, 6).alone);
  const Ensemble single = e.subset({1});
  EXPECT_TRUE(survey(single, 0, 6).alone[0].empty());  // one experiment, as recorded
}

TEST(Check, NamesMustFitTheChannelsAndDiffer) {
  const Model model = oscillator(12);
  Ensemble data = random_experiments(model, 6, 1);
  data.names = {{"a", "b"}, {"c", "c"}, {}, {}};
  EXPECT_EQ(message([&] { data.check(); }),
            "output_names: \"c\" found for the channels 1 and 2, different names needed");
  EXPECT_EQ(message([&] { identify(data); }), message([&] { data.check(); }));
  data.names = {{"a", "b"}, {"a", "b"}, {}, {}};  // an output may be called as an input
  EXPECT_EQ(message([&] { data.check(); }), "no exception");
  data.names = {{}, {"c"}, {}, {}};
  EXPECT_EQ(message([&] { validate(model, data); }), "output_names: 1 found, 2 needed, one for each channel");
  data.names = {{"a"}, {}, {}, {}};
  EXPECT_EQ(message([&] { simulate(model, data); }), "input_names: 1 found, 2 needed, one for each channel");
}

}  // namespace
}  // namespace tokid::testing
