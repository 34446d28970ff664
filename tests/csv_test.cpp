// Strict .csv files: their lines, times and columns, and the order of files.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "io/formats/data_files.hpp"
#include "io/formats/even_times.hpp"
#include "testing.hpp"
#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

Ensemble read(const std::string& text, const ReadOptions& options = {}) {
  const std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();  // tests run side by side
  const auto path = std::filesystem::path(::testing::TempDir()) / (name + ".csv");
  std::ofstream(path, std::ios::binary) << text;
  return load_ensemble(path, options);
}

TEST(EvenTimes, AnySpacingAndOrder) {
  for (const double dt : {1.0, 0.05, 1.0 / 3, 1e-9, 3600.0})
    for (const double begin : {0.0, -7.25, 1e6}) {
      SCOPED_TRACE(fmt::format("{} {}", dt, begin));
      std::vector<double> times;
      for (const int k : {5, 3, 0, 1, 2, 9, 8, 1, 40}) times.push_back(begin + k * dt);
      const io::EvenTimes grid = io::even_times(times);
      // Times of 1e6 s have a rounding of 1e-10 s, so that steps of 1e-9 s are not even.
      if (std::abs(begin) > 1e5 * dt * 1e6) continue;
      EXPECT_FALSE(grid.wrong);
      EXPECT_TRUE(grid.shows_dt);
      EXPECT_NEAR(grid.dt, dt, 1e-9 * dt + 1e-15 * std::abs(begin));
      EXPECT_EQ(grid.step(begin + 40 * dt), 40);
    }
}

TEST(EvenTimes, ADecimalSpacingIsExact) {
  std::vector<double> times;
  for (int k = 0; k < 1000; ++k) times.push_back(12.5 + 0.1 * k);
  EXPECT_EQ(io::even_times(times).dt, 0.1);
}

TEST(EvenTimes, UnevenTimesAreNamed) {
  EXPECT_EQ(io::even_times({0, 1, 2, 3.001, 4}).wrong, 3U);
  EXPECT_EQ(io::even_times({0, 0.1, 0.25}, 0.1).wrong, 2U);
  EXPECT_FALSE(io::even_times({0, 0.2, 0.4}, 0.1).wrong);  // steps that are missing
  EXPECT_FALSE(io::even_times({3, 3, 3}).shows_dt);
}

TEST(StrictCsv, SeparatorsCommentsAndMissingSamples) {
  for (const char mark : {',', ';', '\t'}) {
    std::string text =
        "# dt = 0.5\n# input_units = [\"V\"]\r\nExperiment,time,u1,y1\r\n"
        "a,0,1,NaN\r\na,0.5,,3\r\n\"b, c\",0,+1e-3,-2.5\r\n";
    if (mark != ',')
      text = "# dt = 0.5\n# input_units = [\"V\"]\nexperiment,time,u1,y1\na,0,1,NaN\na,0.5,,3\nb c,0,1e-3,-2.5\n";
    for (size_t i = text.find("xperiment"); i < text.size(); ++i)
      if (mark != ',' && text[i] == ',') text[i] = mark;
    const Ensemble e = read(text);
    EXPECT_EQ(e.dt, 0.5);
    EXPECT_EQ(e.experiment_names, (std::vector<std::string>{"a", mark == ',' ? "b, c" : "b c"}));
    EXPECT_EQ(e.names.input_units, std::vector<std::string>{"V"});
    EXPECT_EQ(e.u(1, 0, 0), 1e-3);
    EXPECT_EQ(e.y(0, 1, 0), 3);
    EXPECT_TRUE(std::isnan(e.y(0, 0, 0)) && std::isnan(e.u(0, 1, 0)) && std::isnan(e.y(1, 1, 0)));
    EXPECT_TRUE(e.remarks.empty());
  }
}

// What is not strict is refused with its line, and with the command that reads it.
TEST(StrictCsv, RefusesTheTablesOfOtherPrograms) {
  const std::vector<std::pair<std::string, std::string>> tables{
      {"k,u,y\n0,1,2\n1,1,5,2\n", "line 3"},                                    // a decimal comma
      {"k;u;y\n0;1;2\n1;1,5;2\n", "line 3, column 'u'"},                        //
      {"k,u,y\ns,V,bar\n0,1,2\n", "line 2, column 'k'"},                        // a row of units
      {"Report\nk,u,y\n0,1,2\n", "no column whose name begins with u"},         // a preamble
      {"0,1,2\n1,2,3\n", "line 1: numbers found"},                              //
      {"k,u,y\n0,Bad,2\n", "line 2, column 'u': 'Bad'"},                        //
      {"time,u,y\n12:00:00,1,2\n", "line 2, column 'time'"},                    //
      {"time,u,y\n0,1,2\n0.1,1,2\n0.25,1,2\n", "line 4, column 'time': 0.25"},  //
      {"k,u,y\n0,1,2\n0,1,2\n", "line 3: a second row for step 0"},             //
      {"k,u,u,y\n0,1,2,3\n", "two columns 'u'"},                                //
      {"u\n1\n\n2\n", "line 3: a blank line"},                                  //
      {"k,u,\"y\n0,1,2\"3\n", "line 2: misplaced quotation mark"},              //
      {"k,u,\"y\n0,1,2\n", "within a quoted cell"},                             //
      {"k,u,y\n0,1,\xB0\n", "line 2: bytes found that are not UTF-8"},          //
      {"experiment,time,u,y\na,0,1,2\na,1,1,2\nb,7,1,2\nb,8,1,2\n", "without a common step"},
      {"experiment,time,u,y\na,0,1,2\na,1,1,2\na,1e9,1,2\n", "found in only 3 rows"},
      {"k,u,y\n0,+-5,2\n", "line 2, column 'u': '+-5'"},
      {"k,u,y\n0,nan(12),2\n", "line 2, column 'u': 'nan(12)'"},
      {"u1,uptime_ms,y\n3,0,1\n1,50,2\n2,100,3\n5,150,1\n", "the input 'uptime_ms' rises evenly like a clock"},
      {"clock,u1,y\n0,3,1\n1,1,2\n", "no column 'time' or 'k' found, but 'clock'"},
      {"k,u,y\n", "no rows found"},
      {"# dt = 1\n", "no header found"}};
  for (const auto& [text, words] : tables) {
    SCOPED_TRACE(text);
    try {
      read(text, {.outputs_required = false});
      ADD_FAILURE() << "no exception";
    } catch (const IoError& error) {
      const std::string found = error.what();
      EXPECT_NE(found.find(words), std::string::npos) << found;
      EXPECT_NE(found.find("tokid import '"), std::string::npos) << found;
    }
  }
}

TEST(StrictCsv, RowsOfEmptyCellsAreSteps) {
  for (const char* text : {"u1,y1\n1,2\n,\n3,4\n", "u1\ty1\n1\t2\n\t\n3\t4\n"}) {
    const Ensemble e = read(text);
    EXPECT_EQ(e.steps(), 3);
    EXPECT_EQ(e.u(0, 2, 0), 3);
    EXPECT_TRUE(std::isnan(e.u(0, 1, 0)));
  }
}

TEST(StrictCsv, ReadsWhatItWrites) {
  Random random(5);
  for (const bool timed : {true, false}) {
    Ensemble e(3, 7, 2, 2, 0.025);
    e.samples() = random.matrix(3, 28);
    e.samples()(1, 5) = nan;
    e.dt_stated = timed;
    e.initial_state = InitialState::unknown;
    e.experiment_names = {"x", "y \"z\"", "3"};
    e.names.output_names = {"p", "q,r"};
    e.names.output_units = {"bar", ""};
    const auto path = std::filesystem::path(::testing::TempDir()) / "written.csv";
    save_ensemble(e, path);
    const Ensemble back = load_ensemble(path);
    EXPECT_TRUE((back.samples().array() == e.samples().array() || back.samples().array().isNaN()).all());
    EXPECT_EQ(back.experiment_names, e.experiment_names);
    EXPECT_EQ(back.names.output_names, e.names.output_names);
    EXPECT_EQ(back.names.output_units, e.names.output_units);
    EXPECT_EQ(back.dt_stated, timed);
    EXPECT_EQ(back.initial_state, e.initial_state);
  }
}

TEST(DataFiles, NumbersInNamesAreOrdered) {
  EXPECT_TRUE(io::is_before("run2.csv", "run10.csv"));
  EXPECT_TRUE(io::is_before("run02.csv", "run3.csv"));
  EXPECT_TRUE(io::is_before("a", "b"));
  EXPECT_FALSE(io::is_before("run10.csv", "run2.csv"));
  EXPECT_FALSE(io::is_before("run2", "run2"));
  EXPECT_TRUE(io::is_before("run", "run2"));
}

}  // namespace
}  // namespace tokid::testing
