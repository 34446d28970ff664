// SPDX-License-Identifier: BSD-3-Clause
#include "io/time_unit.hpp"

#include <gtest/gtest.h>

#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

TEST(TimeUnit, KnowsTheUsualNames) {
  const auto seconds = [](const char* name) {
    const auto unit = io::time_unit(name);
    return unit ? unit->in_seconds(3.0) : 0.0;
  };
  for (const char* name :
       {"t", "time", "Time", "t [s]", "time_s", "time/s", "TIME (S)", "timestamp", "elapsed time", " t "})
    EXPECT_EQ(seconds(name), 3.0) << name;
  for (const char* name : {"Time (ms)", "time_ms", "t[ms]", "time in ms", "time milliseconds"})
    EXPECT_EQ(seconds(name), 0.003) << name;
  for (const char* name : {"t_us", "time [\u00B5s]", "time [\u03BCs]"}) EXPECT_EQ(seconds(name), 3e-6) << name;
  EXPECT_EQ(seconds("time_ns"), 3e-9);
  EXPECT_EQ(seconds("time [min]"), 180.0);
  EXPECT_EQ(seconds("t (h)"), 10800.0);
  for (const char* name :
       {"", "T", "T [s]", "t1", "t_min", "temperature", "times", "time1", "t [m]", "time_constant", "tau"})
    EXPECT_FALSE(io::time_unit(name)) << name;
  EXPECT_THROW(io::time_unit("time [fortnight]"), IoError);
  EXPECT_EQ(io::TimeUnit({"ms", 1.0, 1e3}).from_seconds(0.05), 50.0);
}

}  // namespace
}  // namespace tokid::testing
