// Times as a table writes them → the steps of one grid.
// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/time_axis.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <charconv>
#include <functional>

#include "testing.hpp"
#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

using io::Grid;
using io::TimeColumn;

// A column of times, of experiments one below the other, written with so many decimals or, without, with all digits.
class Column {
 public:
  explicit Column(int decimals = -1) : decimals_(decimals) { rows_.name = "time"; }
  Column& experiment(const std::string& name) {
    rows_.experiments.push_back(name);
    return *this;
  }
  Column& add(double time) {
    const std::string text = decimals_ < 0 ? fmt::format("{}", time) : fmt::format("{:.{}f}", time, decimals_);
    double written = 0.0;
    std::from_chars(text.data(), text.data() + text.size(), written);
    rows_.time.push_back(written);
    rows_.precision.add(text, written);
    rows_.experiment.push_back(Index(rows_.experiments.size()) - 1);
    rows_.line.push_back(Index(rows_.time.size()) + 1);  // below a header
    return *this;
  }
  // begin + k dt for the steps of a list
  Column& add(double begin, double dt, const std::vector<Index>& steps) {
    for (const Index k : steps) add(begin + double(k) * dt);
    return *this;
  }
  TimeColumn& rows() { return rows_; }

 private:
  TimeColumn rows_;
  int decimals_;
};

std::vector<Index> steps_of(const TimeColumn& rows, const Grid& grid) {
  std::vector<Index> steps;
  for (const double time : rows.time) steps.push_back(Index(grid.step(time)));
  return steps;
}

std::string refusal(const TimeColumn& rows, std::optional<double> dt = std::nullopt) {
  try {
    io::time_grid(rows, dt);
  } catch (const IoError& error) {
    return error.what();
  }
  return "no exception";
}

void expect_words(const std::string& text, const std::vector<std::string>& words) {
  for (const std::string& word : words) EXPECT_NE(text.find(word), std::string::npos) << word << " in: " << text;
}

// 0 … 39 but for two gaps.
std::vector<Index> with_gaps() {
  std::vector<Index> steps = range(0, 20);
  for (const auto& [begin, end] : {std::pair<Index, Index>{23, 35}, {36, 40}})
    for (const Index k : range(begin, end)) steps.push_back(k);
  return steps;
}

TEST(TimeAxis, CountsTheStepsOfTimesAsWritten) {
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const double dt = std::pow(10.0, random.uniform(-4, 2)), begin = 100.0 * dt * random.normal();
    const int finest = int(std::ceil(-std::log10(dt))) + 1;  // at most a tenth of a step
    for (const int decimals : {-1, std::max(0, finest), std::max(0, finest + 3)})
      for (const std::vector<Index>& steps : {range(0, 40), with_gaps()}) {
        SCOPED_TRACE(fmt::format("begin {}, dt {}, {} decimals, {} rows", begin, dt, decimals, steps.size()));
        const TimeColumn rows = Column(decimals).experiment("a").add(begin, dt, steps).rows();
        const Grid grid = io::time_grid(rows, std::nullopt);
        EXPECT_EQ(steps_of(rows, grid), steps);
        // Both lines lie within a unit of the same written times, or within 1e-6 of a step.
        const double largest = std::abs(begin) + 40 * dt;
        const double unit = std::max(rows.precision.unit(largest), 1e-6 * dt) + 8 * epsilon * largest;
        EXPECT_NEAR(grid.dt, dt, 2 * unit / 39);
        EXPECT_NEAR(grid.begin, begin, 2 * unit);
        EXPECT_TRUE(grid.shows_dt);
      }
  }
}

// The grid begins with the first of them, wherever its rows are.
TEST(TimeAxis, IsOneForAllExperiments) {
  const TimeColumn rows =
      Column().experiment("late").add(7.5, 0.25, range(0, 20)).experiment("early").add(5.0, 0.25, range(0, 30)).rows();
  const Grid grid = io::time_grid(rows, std::nullopt);
  EXPECT_EQ(grid.begin, 5.0);
  EXPECT_EQ(grid.dt, 0.25);
  EXPECT_EQ(grid.step(rows.time[0]), 10.0);
}

TEST(TimeAxis, TakesRowsInAnyOrder) {
  TimeColumn rows = Column().experiment("a").add(3.0, 0.1, with_gaps()).rows();
  std::reverse(rows.time.begin(), rows.time.end());
  std::swap(rows.time[3], rows.time[20]);
  const Grid grid = io::time_grid(rows, std::nullopt);
  EXPECT_NEAR(grid.dt, 0.1, 1e-12);
  EXPECT_EQ(grid.step(rows.time.back()), 0.0);
  EXPECT_EQ(grid.step(rows.time.front()), 39.0);
}

TEST(TimeAxis, NamesTheLineOfATimeOffTheGrid) {
  for (const Index bad : {5, 20, 38})
    for (const double off : {0.3, -0.3, 0.02}) {
      Column column(5);
      column.experiment("a");
      for (Index k = 0; k < 40; ++k) column.add(0.1 * (double(k) + (k == bad ? off : 0.0)));
      const std::string line = fmt::format("line {}, column 'time'", bad + 2);
      expect_words(refusal(column.rows()), {line});
      expect_words(refusal(column.rows(), 0.1), {line});
    }
}

TEST(TimeAxis, RefusesExperimentsThatShareNoSteps) {
  Column apart, between;
  apart.experiment("a").add(0.0, 0.1, range(0, 20)).experiment("b").add(5.0, 0.1, range(0, 20));
  between.experiment("a").add(0.0, 0.1, range(0, 20)).experiment("b").add(0.05, 0.1, range(0, 20));
  expect_words(refusal(apart.rows()), {"column 'time'", "'a'", "'b'"});
  expect_words(refusal(between.rows()), {"line ", "column 'time'", "from even steps of"});
}

// Seconds, whatever the unit of the column.
TEST(TimeAxis, KeepsAStatedSampleTime) {
  TimeColumn rows = Column(1).experiment("a").add(40.0, 100.0 / 3.0, {0, 2, 3, 7}).rows();
  rows.unit = {"ms", 1.0, 1000.0};
  const Grid grid = io::time_grid(rows, 0.1 / 3.0);
  EXPECT_NEAR(grid.dt, 100.0 / 3.0, 1e-12);  // some ε of its size, from a conversion
  EXPECT_EQ(steps_of(rows, grid), (std::vector<Index>{0, 2, 3, 7}));
  EXPECT_NE(refusal(rows, 0.03), "no exception");
}

TEST(TimeAxis, OfASingleTimeShowsNoSpacing) {
  const Grid grid = io::time_grid(Column().experiment("a").add(2.5).experiment("b").add(2.5).rows(), std::nullopt);
  EXPECT_FALSE(grid.shows_dt);
  EXPECT_EQ(grid.begin, 2.5);
  EXPECT_EQ(grid.dt, 1.0);
}

TEST(EvenSpacing, IsThatOfTimesWithoutAGap) {
  const auto times = [](const std::vector<Index>& steps, double dt) {
    return Column().experiment("a").add(-1.0, dt, steps).rows().time;
  };
  for (const double dt : {0.001, 0.02, 1.0 / 30.0, 2.0}) {
    const std::optional<double> found = io::even_spacing(times(range(0, 40), dt));
    ASSERT_TRUE(found) << dt;
    EXPECT_NEAR(*found, dt, 4 * epsilon * (1.0 + 40 * dt) / 39);  // the first and the last time as doubles
    EXPECT_FALSE(io::even_spacing(times(with_gaps(), dt))) << dt;
    std::vector<double> uneven = times(range(0, 40), dt);
    uneven[17] += 0.3 * dt;
    EXPECT_FALSE(io::even_spacing(uneven)) << dt;
    uneven[17] = nan;
    EXPECT_FALSE(io::even_spacing(uneven)) << dt;
    std::vector<double> falling = times(range(0, 40), dt);
    std::reverse(falling.begin(), falling.end());
    EXPECT_FALSE(io::even_spacing(falling)) << dt;
  }
  EXPECT_FALSE(io::even_spacing({}));
  EXPECT_FALSE(io::even_spacing({1.0}));
}

}  // namespace
}  // namespace tokid::testing
