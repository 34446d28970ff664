// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/runs.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "testing.hpp"

namespace tokid::testing {
namespace {

using Numbers = std::vector<double>;
using Lists = std::vector<Numbers>;

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(Runs, AreTheSameFromNumbersListsAndMatrices) {
  const Numbers u{1, 2, 3, 4, 5, 6}, y{10, nan, 30};  // three steps of two inputs and one output
  Runs runs(2, 1);
  runs.add(u, y);
  runs.add(Lists{{1, 2}, {3, 4}, {5, 6}}, Lists{{10}, {nan}, {30}});
  runs.add(Matrix{{1, 2}, {3, 4}, {5, 6}}, Vector{{10, nan, 30}});
  const Ensemble data = runs.ensemble();
  ASSERT_EQ(data.experiments(), 3);
  ASSERT_EQ(data.steps(), 3);
  for (Index n = 0; n < 3; ++n)
    for (Index k = 0; k < 3; ++k) {
      EXPECT_EQ(data.u(n, k, 0), double(2 * k + 1));
      EXPECT_EQ(data.u(n, k, 1), double(2 * k + 2));
      if (k == 1)
        EXPECT_TRUE(std::isnan(data.y(n, k, 0)));
      else
        EXPECT_EQ(data.y(n, k, 0), double(10 * (k + 1)));
    }
  EXPECT_TRUE(data.length.empty());
  EXPECT_TRUE(data.experiment_names.empty());
}

TEST(Runs, SetTheLengthsOfShorterRuns) {
  Runs runs(1, 1);
  runs.add(Numbers{1, 2}, Numbers{3, 4});
  runs.add(Numbers{1, 2, 3}, Numbers{4, 5, 6});
  const Ensemble data = runs.ensemble();
  EXPECT_EQ(data.steps(), 3);
  EXPECT_EQ(data.length, (std::vector<Index>{2, 3}));
  EXPECT_EQ(data.y(0, 1, 0), 4);
  EXPECT_TRUE(std::isnan(data.u(0, 2, 0)) && std::isnan(data.y(0, 2, 0)));
  EXPECT_EQ(data.y(1, 2, 0), 6);
  EXPECT_EQ(missing_samples(data), 0);
  EXPECT_NO_THROW(data.check());
}

TEST(Runs, StateTheSampleTimeOnlyIfItIsKnown) {
  Runs counted(1, 1), timed(1, 1, {.dt = 0.05});
  for (Runs* runs : {&counted, &timed}) runs->add(Numbers{1}, Numbers{2});
  EXPECT_FALSE(counted.ensemble().dt_stated);
  EXPECT_EQ(counted.ensemble().dt, 1.0);
  EXPECT_TRUE(timed.ensemble().dt_stated);
  EXPECT_EQ(timed.ensemble().dt, 0.05);
}

TEST(Runs, KeepNamesUnitsAndTheInitialState) {
  Runs runs(1, 1, {.names = {{"thrust"}, {"height"}, {"N"}, {"m"}}, .initial_state = InitialState::unknown});
  runs.add(Numbers{1}, Numbers{2}, "Monday");
  runs.add(Numbers{1}, Numbers{2});
  const Ensemble data = runs.ensemble();
  EXPECT_EQ(data.names.output(0), "height");
  EXPECT_EQ(data.names.input_units, (std::vector<std::string>{"N"}));
  EXPECT_EQ(data.initial_state, InitialState::unknown);
  EXPECT_EQ(data.experiment_names, (std::vector<std::string>{"Monday", "1"}));
}

TEST(Runs, RefuseWhatDoesNotFitAndNameTheRun) {
  Runs runs(2, 1, {.names = {{"thrust", "torque"}, {"height"}, {}, {}}});
  runs.add(Numbers{1, 2}, Numbers{3}, "good");
  EXPECT_EQ(
      message([&] {
        runs.add(Numbers{1, 2, 3}, Numbers{1, 2}, "odd");
      }),
      "u of experiment \"odd\" (row 1): 3 samples found, a multiple of 2 needed: one for each input at each step");
  EXPECT_EQ(message([&] {
              runs.add(Numbers{1, 2, 3, 4}, Numbers{1, 2, 3});
            }),
            "experiment 1: 2 steps of inputs and 3 steps of outputs found, equal numbers needed. Mark missing samples "
            "by NaN");
  EXPECT_EQ(message([&] {
              runs.add(Lists{{1, 2}, {3}}, Lists{{1}, {2}});
            }),
            "u of experiment 1: 1 sample found at step 1, 2 needed: one for each input");
  EXPECT_EQ(message([&] { runs.add(Matrix::Zero(2, 5), Matrix::Zero(5, 1)); }),
            "u of experiment 1: 2 x 5 samples found, 2 columns needed. Rows are steps: transpose the matrix");
  EXPECT_EQ(message([&] { runs.add(Matrix::Zero(5, 2), Matrix::Zero(5, 3)); }),
            "y of experiment 1: 5 x 3 samples found, 1 column needed. Rows are steps");
  EXPECT_EQ(message([&] { runs.add(Numbers{}, Numbers{}); }), "experiment 1: no step found, at least one needed");
  EXPECT_EQ(message([&] {
              runs.add(Numbers{1, 2, 3, infinity}, Numbers{1, 2});
            }),
            "input torque: infinite value in experiment 1 at step 1, finite or missing (NaN) needed");
  EXPECT_EQ(message([&] {
              runs.add(Numbers{1, 2}, Numbers{-infinity}, "sad");
            }),
            "output height: infinite value in experiment \"sad\" (row 1) at step 0, finite or missing (NaN) needed");
  EXPECT_EQ(runs.size(), 1);  // what was refused is not there
  runs.add(Numbers{1, 2}, Numbers{3}, "good");
  EXPECT_NE(message([&] { runs.ensemble(); }).find("\"good\" found at rows 0 and 1"), std::string::npos);
}

TEST(Runs, RefuseChannelsThatDoNotFit) {
  EXPECT_NE(message([] { Runs(0, 0); }), "no exception");
  EXPECT_NE(message([] { Runs(1, 1, {.dt = 0.0}); }).find("dt: 0 found"), std::string::npos);
  EXPECT_EQ(message([] {
              Runs(1, 3, {.names = {{}, {"height"}, {}, {}}});
            }),
            "output_names: 1 found, 3 needed, one for each channel");
  EXPECT_EQ(message([] {
              Runs(1, 3, {.names = {{}, {"a", "b", "a"}, {}, {}}});
            }),
            "output_names: \"a\" found for the channels 1 and 3, different names needed");
  EXPECT_EQ(message([] { Runs(1, 1).ensemble(); }), "runs: no run found, at least one needed");
}

TEST(Runs, MayHaveOutputsAlone) {
  Runs runs(0, 2);
  runs.add(Numbers{}, Numbers{1, 2, 3, 4});
  runs.add(Matrix(), Matrix{{1, 2}, {3, 4}});
  const Ensemble data = runs.ensemble();
  EXPECT_EQ(data.steps(), 2);
  EXPECT_EQ(data.y(0, 1, 0), 3);
  EXPECT_EQ(data.y(1, 1, 1), 4);
}

}  // namespace
}  // namespace tokid::testing
