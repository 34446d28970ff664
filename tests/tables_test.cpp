// Cells, time stamps and dialects of tables, and the order of files.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "io/formats/cells.hpp"
#include "io/formats/data_files.hpp"
#include "io/formats/dialect.hpp"
#include "io/formats/time_stamp.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid {
namespace {

// Seconds from the first stamp to the second one.
double between(const char* first, const char* second, DateOrder order = DateOrder::automatic) {
  std::vector<io::Stamp> stamps;
  for (const char* text : {first, second}) {
    const auto stamp = io::stamp_from(text);
    if (!stamp) throw std::runtime_error(text);
    stamps.push_back(*stamp);
  }
  return io::times_of(stamps, {0, 0}, {1, 2}, {first, second}, order).seconds[1];
}

TEST(TimeStamp, FormsOfOneMoment) {
  for (const char* text : {"2026-11-27T13:12:05.5", "2026-11-27 13:12:05,5", "2026/11/27 13:12:05.500",
                           "20261127T13:12:05.5", "27.11.2026 13:12:05,5", "27.11.26 13:12:05.5",
                           "11/27/2026 1:12:05.5 PM", "27/11/2026 13:12:05.5", "27-Nov-2026 13:12:05.5",
                           "27-NOV-26 13:12:05:500", "27 November 2026 13:12:05.5", "Nov 27, 2026 1:12:05.5 p.m."})
    EXPECT_DOUBLE_EQ(between("2026-11-27 13:00:00", text), 725.5) << text;
  for (const char* text : {"2026-11-27T13:12:05.5Z", "2026-11-27T14:12:05.5+01:00", "2026-11-27T08:12:05.5-0500"})
    EXPECT_DOUBLE_EQ(between("2026-11-27T13:00:00Z", text), 725.5) << text;
}

TEST(TimeStamp, TextsThatAreNone) {
  for (const char* text : {"", "5", "1.5", "-1e-3", "1.2.3", "12:5", "2026-13-01", "31.02.2026", "25:00:00x", "Bad",
                           "27.11.2026 25:00:00", "1:02.5", "2026-11-27T", "13:12:05 XM", "1-2-3"})
    EXPECT_FALSE(io::stamp_from(text)) << text;
}

TEST(TimeStamp, OrderOfDayAndMonth) {
  EXPECT_EQ(between("03/04/2026", "04/04/2026", DateOrder::day_first), 86400.0);
  EXPECT_EQ(between("03/04/2026", "04/04/2026", DateOrder::month_first), 31 * 86400.0);
  EXPECT_EQ(between("12/04/2026", "13/04/2026"), 86400.0);
  EXPECT_EQ(between("03/04/2026 01:00", "03/04/2026 02:00"), 3600.0);  // one day, whichever it is
  EXPECT_THROW(between("03/04/2026", "04/04/2026"), IoError);
  EXPECT_THROW(between("13/04/2026", "04/13/2026"), IoError);
  EXPECT_THROW(between("13/04/2026", "14/04/2026", DateOrder::month_first), IoError);
  EXPECT_EQ(between("23:59:59", "0:00:01"), 2.0);  // the next day
}

// Seconds from the first time of day to each one.
std::vector<double> seconds_of(const std::vector<std::string>& texts, std::vector<Index> experiments = {}) {
  experiments.resize(texts.size());
  std::vector<io::Stamp> stamps;
  std::vector<Index> lines;
  for (const std::string& text : texts)
    stamps.push_back(io::stamp_from(text).value()), lines.push_back(Index(lines.size()));
  return io::times_of(stamps, experiments, lines, texts, DateOrder::automatic).seconds;
}

TEST(TimeStamp, TimesOfDayOnSeveralDays) {
  constexpr double h = 3600;
  using Times = std::vector<double>;
  // The next day begins after a pause of 13 h.
  EXPECT_EQ(seconds_of({"16:00", "17:00", "18:00", "19:00", "20:00", "09:00"}),
            (Times{0, h, 2 * h, 3 * h, 4 * h, 17 * h}));
  // The newest row is first.
  EXPECT_EQ(seconds_of({"13:00", "12:00", "11:00"}), (Times{0, -h, -2 * h}));
  EXPECT_EQ(seconds_of({"01:00", "00:00", "23:00", "22:00"}), (Times{0, -h, -2 * h, -3 * h}));
  // Each experiment has midnights of its own.
  EXPECT_EQ(seconds_of({"22:00", "23:00", "00:00", "22:00", "23:00", "00:00"}, {0, 0, 0, 1, 1, 1}),
            (Times{0, h, 2 * h, 0, h, 2 * h}));
  EXPECT_EQ(seconds_of({"11:00 PM", "12:00 AM", "1:00 AM"}), (Times{0, h, 2 * h}));
  EXPECT_EQ(seconds_of({"23:00:00", "24:00:00", "25:00:00"}), (Times{0, h, 2 * h}));  // elapsed times
  // Noon or midnight, a fall of elapsed times, and no direction.
  EXPECT_THROW(seconds_of({"9:00", "10:00", "11:00", "12:00", "12:59", "1:00"}), IoError);
  EXPECT_THROW(seconds_of({"23:00:00", "24:00:00", "25:00:00", "26:00:00", "27:00:00", "0:00:00"}), IoError);
  EXPECT_THROW(seconds_of({"13:00", "15:00", "14:00", "16:00", "15:00", "17:00"}), IoError);
}

TEST(TimeStamp, TimeZonesMustBeInAllRows) {
  EXPECT_EQ(between("2026-11-27T13:00:00Z", "2026-11-27T14:00:00+01:00"), 0.0);
  EXPECT_THROW(between("2026-11-27T13:00:00Z", "2026-11-27T14:00:00"), IoError);
  EXPECT_THROW(between("2026-11-27T13:00:00", "2026-11-27T14:00:00+01:00"), IoError);
}

TEST(TimeUnit, MinutesAndSeconds) {
  for (const char* unit : {"mm:ss", "m:ss", "min:s"}) EXPECT_TRUE(io::is_minutes_and_seconds(unit)) << unit;
  for (const char* unit : {"", "hh:mm", "hh:mm:ss", "min", "s"}) EXPECT_FALSE(io::is_minutes_and_seconds(unit)) << unit;
}

TEST(Cells, Numbers) {
  EXPECT_EQ(io::number_from("+1.5", '.'), 1.5);
  EXPECT_EQ(io::number_from("-1,5e3", ','), -1500.0);
  EXPECT_EQ(io::number_from("7", ','), 7.0);
  for (const char* text : {"1,5", "1.5 V", "", "1 000"}) EXPECT_FALSE(io::number_from(text, '.')) << text;
  for (const char* text : {"1.5", "1.234,5"}) EXPECT_FALSE(io::number_from(text, ',')) << text;
}

TEST(Cells, Thousands) {
  for (const char* text : {"1,000", "-25.125", "+999,999"}) EXPECT_TRUE(io::may_be_thousands(text)) << text;
  for (const char* text : {"", "1000", "0,125", "1.25", "1.0000", "1000.125", "1,000,000", "1e3,000", ".125", "1,00e"})
    EXPECT_FALSE(io::may_be_thousands(text)) << text;
}

TEST(Cells, Labels) {
  const auto check = [](const char* column, const char* name, const char* unit) {
    const io::Label label = io::label_from(column);
    EXPECT_EQ(label.name, name) << column;
    EXPECT_EQ(label.unit, unit) << column;
  };
  check("p [bar]", "p", "bar");
  check("T (degC)", "T", "degC");
  check("flow(m3/h)", "flow", "m3/h");
  check("speed [1/min]", "speed", "1/min");
  check("T [\u00B0C]", "T", "\u00B0C");
  check("level (tank 1)", "level (tank 1)", "");
  check("u(1)", "u(1)", "");
  check("y[2]", "y[2]", "");
  check("plain", "plain", "");
}

TEST(Cells, Units) {
  for (const char* unit :
       {"bar", "mbar", "m/s", "kg*m/s^2", "m\u00B3/h", "W/(m2)", "1/min", "[x]", "%", "kN m", "rad/s"})
    EXPECT_TRUE(io::is_unit(unit)) << unit;
  for (const char* unit : {"", "speed", "tank 1", "bar!", "valve"}) EXPECT_FALSE(io::is_unit(unit)) << unit;
}

std::deque<io::TableText::Line> lines(const std::vector<std::string>& texts) {
  std::deque<io::TableText::Line> result;
  for (const std::string& text : texts) result.push_back({text, Index(result.size()) + 1});
  return result;
}

TEST(Dialect, SeparatorsAndHeaders) {
  const io::Dialect german =
      io::dialect_of(lines({"Anlage;7", "", "Zeit;u;y", "s;V;bar", "0,0;1,5;2", "0,1;1,5;2"}), {});
  EXPECT_EQ(german.separator, ';');
  EXPECT_EQ(german.header, 2U);
  EXPECT_TRUE(german.has_units_row);
  const io::Dialect plain = io::dialect_of(lines({"experiment,time,u,y", "a,0,1,2", "a,1,oops,2", "a,2,1"}), {});
  EXPECT_EQ(plain.separator, ',');
  EXPECT_EQ(plain.header, 0U);
  EXPECT_FALSE(plain.has_units_row);
  EXPECT_FALSE(io::dialect_of(lines({"0,1,2", "1,2,3"}), {}).has_header);
  EXPECT_TRUE(io::dialect_of(lines({"time,1,2", "1,2,3"}), {}).has_header);
}

TEST(Dialect, HeadersBelowPreambles) {
  const auto header = [](const std::vector<std::string>& texts, const io::Known& known = {}) {
    return io::dialect_of(lines(texts), known).header;
  };
  const std::vector<std::string> numbers{"1,2,3", "4,5,6", "time,u,y", "0,1,2", "1,2,3", "2,3,4"};
  EXPECT_EQ(header(numbers), 2U);
  EXPECT_EQ(header({"Report", "time,1,2,3", "0,1,2,3", "1,2,3,4"}), 1U);
  EXPECT_EQ(header({"Report", "0,time,2,3", "0,1,2,3", "1,2,3,4"}, {{}, {"time", "2"}}), 1U);
  std::vector<std::string> preamble(30, "setting,1");
  preamble.insert(preamble.end(), {"time,u,y", "0,1,2", "1,2,3", "2,3,4"});
  EXPECT_EQ(header(preamble), 30U);
  // A word for a missing sample that only the caller knows.
  EXPECT_EQ(header({"time,u,y", "0,Out,Out", "1,Out,Out", "2,Out,Out"}, {{"Out"}, {}}), 0U);
}

TEST(Cells, SwitchStates) {
  for (const char* text : {"on", "ON", "True", "true"}) EXPECT_EQ(io::switch_state(text), 1.0) << text;
  for (const char* text : {"off", "OFF", "False"}) EXPECT_EQ(io::switch_state(text), 0.0) << text;
  for (const char* text : {"", "o", "offline", "1", "yes"}) EXPECT_FALSE(io::switch_state(text)) << text;
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
}  // namespace tokid
