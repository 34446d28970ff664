// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/cross_validate.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/remarks.hpp"

namespace tokid::testing {
namespace {

const ExperimentOptions noisy{.experiments = 41, .seed = 7, .process_noise = 0.05, .measurement_noise = 0.1};

TEST(CrossValidate, EveryExperimentIsJudgedOnceByAModelThatHasNotSeenIt) {
  const Ensemble data = experiments(oscillator(30), noisy);
  for (const std::optional<std::uint64_t> seed : {std::optional<std::uint64_t>(), std::optional<std::uint64_t>(3)}) {
    const CrossValidation found = cross_validate(data, {.states = 4, .lags = 3, .method = Method::tvera},
                                                 {.folds = 4, .horizon = 5, .seed = seed});
    ASSERT_EQ(found.folds.size(), 4u);
    std::vector<int> judged(41, 0);
    double squares = 0.0;
    for (const Fold& fold : found.folds) {
      EXPECT_TRUE(fold.experiments.size() == 10 || fold.experiments.size() == 11);
      EXPECT_EQ(fold.states, 4);
      EXPECT_EQ(fold.lags, 3);
      std::vector<Index> rest;
      for (Index n = 0; n < 41; ++n)
        if (std::count(fold.experiments.begin(), fold.experiments.end(), n) == 0) rest.push_back(n);
      for (const Index n : fold.experiments) ++judged[size_t(n)];
      const Model model = identify(data.subset(rest), {.states = 4, .lags = 3, .method = Method::tvera}).model;
      const Validation v = validate(model, data.subset(fold.experiments), {.horizon = 5});
      EXPECT_EQ(fold.simulation.fit, v.simulation.fit);
      EXPECT_EQ(fold.one_step.fit, v.one_step.fit);
      EXPECT_EQ(fold.horizon.fit, v.horizon.fit);
      squares += v.one_step.rmse(1) * v.one_step.rmse(1) * double(v.one_step.samples);
    }
    EXPECT_EQ(judged, std::vector<int>(41, 1));
    EXPECT_EQ(found.folds[0].experiments == (std::vector<Index>{0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40}), !seed);
    EXPECT_EQ(found.one_step.samples, 41 * 30);
    EXPECT_NEAR(found.one_step.rmse(1), std::sqrt(squares / (41 * 30)), 1e-12);
    for (Index j = 0; j < 2; ++j) {
      double least = 100, most = -100;
      for (const Fold& fold : found.folds) {
        least = std::min(least, fold.horizon.fit(j));
        most = std::max(most, fold.horizon.fit(j));
      }
      // The standard deviation of four numbers is between 0.41 and 0.58 of their range.
      EXPECT_GT(found.horizon_spread(j), 0.4 * (most - least));
      EXPECT_LT(found.horizon_spread(j), 0.6 * (most - least));
    }
  }
}

TEST(CrossValidate, FitsBeginAtTheGivenStep) {
  const Ensemble data = with_noise(experiments(oscillator(20), {.experiments = 24}), 0.1, 1);
  const IdentifyOptions known{.states = 4, .lags = 2, .method = Method::tvera};
  const CrossValidation late = cross_validate(data, known, {.folds = 3, .first_step = 12});
  EXPECT_EQ(late.one_step.samples, 24 * 8);
  EXPECT_EQ(late.folds[0].simulation.samples, 8 * 8);
  EXPECT_NE(message([&] {
              cross_validate(data, known, {.folds = 3, .first_step = 20});
            }).find("first_step: 20 found, 0 to 19 needed"),
            std::string::npos);
}

TEST(CrossValidate, ExperimentsAreNamedAsInTheWholeEnsemble) {
  Ensemble data = experiments(oscillator(20), {.experiments = 24});
  const IdentifyOptions known{.states = 4, .lags = 2, .method = Method::tvera};
  EXPECT_TRUE(cross_validate(data, known, {.folds = 3}).folds[1].experiment_names.empty());
  std::vector<std::string> names;
  for (int n = 1; n <= 24; ++n) names.push_back(std::to_string(n));
  set_experiment_names(data, names);
  const CrossValidation found = cross_validate(data, known, {.folds = 3});
  EXPECT_EQ(found.folds[1].experiments, (std::vector<Index>{1, 4, 7, 10, 13, 16, 19, 22}));
  EXPECT_EQ(found.folds[1].experiment_names, (std::vector<std::string>{"2", "5", "8", "11", "14", "17", "20", "23"}));
  EXPECT_TRUE(found.findings.empty());

  // Two that share no step: said once, and not by the rows that they have in a fold.
  Ensemble apart = data;
  for (Index k = 0; k < 20; ++k) {
    if (k < 10) apart.input(k).row(9).setConstant(nan), apart.output(k).row(9).setConstant(nan);
    if (k >= 9) apart.input(k).row(4).setConstant(nan), apart.output(k).row(4).setConstant(nan);
  }
  const std::vector<std::string> told = in_words(remarks(cross_validate(apart, known, {.folds = 3})));
  Index count = 0;
  for (const std::string& text : told)
    if (text.find("begins at step") != std::string::npos) {
      ++count;
      EXPECT_EQ(
          text.find("cross-validation: experiment \"10\" (row 9) begins at step 10, after experiment \"5\" (row 4) "
                    "has ended at step 8"),
          0u)
          << text;
    }
  EXPECT_EQ(count, 1);

  data.y(10, 5, 1) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(message([&] { cross_validate(data, known, {.folds = 3}); }),
            "output y2: infinite value in experiment \"11\" (row 10) at step 5, finite or missing (NaN) needed");
}

TEST(CrossValidate, LeavesOneOutWhereThereAreAsManyFoldsAsExperiments) {
  const Ensemble data = experiments(oscillator(20), {.experiments = 12});
  const CrossValidation found = cross_validate(data, {.states = 4, .lags = 2}, {.folds = 12});
  for (size_t i = 0; i < 12; ++i) EXPECT_EQ(found.folds[i].experiments, std::vector<Index>{Index(i)});
  for (const double f : found.simulation.fit) EXPECT_GT(f, 100 - 1e-6);  // no noise
  EXPECT_EQ(found.horizon.fit, found.one_step.fit);
}

// Orders that suit all experiments are no secret kept from the fold; each fold chooses its own.
TEST(CrossValidate, EachFoldMakesItsOwnChoices) {
  const Ensemble data = experiments(oscillator(14), noisy);  // few steps, of which no two folds make the same
  const CrossValidation found = cross_validate(data, {.hold_out = 0.3}, {.folds = 3});
  for (const Fold& fold : found.folds) {
    std::vector<Index> rest;
    for (Index n = 0; n < 41; ++n)
      if (std::count(fold.experiments.begin(), fold.experiments.end(), n) == 0) rest.push_back(n);
    const Identification own = identify(data.subset(rest));  // nothing more is held out
    EXPECT_EQ(fold.lags, own.plan.lags);
    EXPECT_EQ(fold.states, own.model.states());
    EXPECT_EQ(in_words(fold.findings), in_words(own.findings));
  }
}

TEST(CrossValidate, MeanMotionIsThatOfTheOthers) {
  Ensemble data = experiments(oscillator(20), {.experiments = 20, .seed = 2});
  for (Index k = 0; k < 20; ++k) data.output(k).array() += 50.0 + double(k);
  const CrossValidation found =
      cross_validate(data, {.states = 4, .lags = 2, .nominal = NominalChoice::mean}, {.folds = 5});
  // Departures from the mean of 16 experiments of a linear system obey it exactly. Against the mean over the steps too,
  // the fit would count the common motion.
  for (const double f : found.simulation.fit) EXPECT_GT(f, 100 - 1e-6);
  const CrossValidation noise = cross_validate(data, {.states = 1, .lags = 1, .nominal = NominalChoice::mean});
  EXPECT_LT(noise.simulation.fit(0), 99);
  EXPECT_NEAR(noise.simulation.fit(0), noise.folds[0].simulation.fit(0), 30);
}

TEST(CrossValidate, ReportsProgressOfAllFolds) {
  std::vector<double> seen;
  IdentifyOptions options{.states = 4, .lags = 2};
  options.execution.progress = [&](const ProgressReport& report) { seen.push_back(report.share); };
  cross_validate(experiments(oscillator(20), {.experiments = 24}), options, {.folds = 2});
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  EXPECT_EQ(seen.back(), 1.0);
  EXPECT_NE(std::find(seen.begin(), seen.end(), 0.5), seen.end());
}

TEST(CrossValidate, RefusesWhatCannotBeCut) {
  const Ensemble data = experiments(oscillator(20), {.experiments = 12});
  for (const Index folds : {-1, 0, 1, 13})
    EXPECT_NE(
        message([&] { cross_validate(data, {}, {.folds = folds}); }).find(std::to_string(folds) + " found, 2 to 12"),
        std::string::npos)
        << folds;
  EXPECT_NE(message([&] { cross_validate(data, {}, {.folds = 3, .horizon = 0}); }).find("horizon"), std::string::npos);
  // 12 experiments carry two lags, 6 don't.
  const std::string few = message([&] { cross_validate(data, {.lags = 2, .method = Method::tvera}, {.folds = 2}); });
  EXPECT_NE(few.find("fold 1 of 2, identified from the other 6 experiments: experiments: 6 found"), std::string::npos)
      << few;
}

// The factors of a combination differ from fold to fold in their last digits; it is one finding all the same.
TEST(CrossValidate, FindingsOfAllFoldsAreOne) {
  Ensemble e = with_noise(random_experiments(random_system({2, 2, 3}, 20, 0.9, 21), 40, 22), 0.01, 23);
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k).col(2) = 0.3 * e.input(k).col(0) - 1.7 * e.input(k).col(1);
    e.output(k).col(1) = 0.7 * e.output(k).col(0);
  }
  const Findings found = remarks(cross_validate(e, {.refine = false}, {.folds = 4}));
  for (const Finding::Kind kind : {Finding::Kind::inputs_dependent, Finding::Kind::outputs_dependent}) {
    const auto is_of_kind = [kind](const Finding& finding) { return finding.kind == kind; };
    ASSERT_EQ(std::count_if(found.begin(), found.end(), is_of_kind), 1) << to_string(kind);
    const Finding& one = *std::find_if(found.begin(), found.end(), is_of_kind);
    EXPECT_EQ(one.scope, Finding::Scope::folds);
    EXPECT_EQ(one.numbers.at("folds_with"), 4);
  }
}

}  // namespace
}  // namespace tokid::testing
