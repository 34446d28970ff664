// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/time_unit.hpp"

#include <gtest/gtest.h>

#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

TEST(TimeUnit, KnowsTheUsualNames) {
  const auto seconds = [](const char* name) {
    const auto unit = io::time_unit(name);
    return unit ? unit->in_seconds(3.0) : 0.0;
  };
  for (const char* name : {"t", "time", "Time", "t [s]", "time_s", "time/s", "TIME (S)", "timestamp", "elapsed time",
                           " t ", "seconds", "Sec", "seconds since start", "Time since start", "time_since_start_s",
                           "time elapsed", "elapsed", "elapsed [s]"})
    EXPECT_EQ(seconds(name), 3.0) << name;
  for (const char* name : {"Time (ms)", "time_ms", "t[ms]", "time in ms", "time milliseconds", "Milliseconds", "millis",
                           "milliseconds_since_start", "elapsed_ms", "time since start [ms]"})
    EXPECT_EQ(seconds(name), 0.003) << name;
  for (const char* name : {"t_us", "time [\u00B5s]", "time [\u03BCs]"}) EXPECT_EQ(seconds(name), 3e-6) << name;
  EXPECT_EQ(seconds("time_ns"), 3e-9);
  EXPECT_EQ(seconds("time [min]"), 180.0);
  EXPECT_EQ(seconds("t (h)"), 10800.0);
  for (const char* name : {"",
                           "T",
                           "T [s]",
                           "t1",
                           "t_min",
                           "temperature",
                           "times",
                           "time1",
                           "t [m]",
                           "time_constant",
                           "tau",
                           "s",
                           "ms",
                           "d",
                           "second",
                           "minutes",
                           "hours",
                           "elapsed [m]",
                           "elapsed_distance",
                           "since start",
                           "secs per lap",
                           "t (time)"})
    EXPECT_FALSE(io::time_unit(name)) << name;
  EXPECT_THROW(io::time_unit("time [fortnight]"), IoError);
  EXPECT_THROW(io::time_unit("elapsed time [m]"), IoError);
  EXPECT_EQ(io::TimeUnit({"ms", 1.0, 1e3}).from_seconds(0.05), 50.0);
}

TEST(TimeUnit, KnowsStepNumbers) {
  for (const char* name :
       {"step", "Sample", "STEP", "step number", "sample_number", "Sample No.", "step-index", " sample "})
    EXPECT_TRUE(io::is_step_number(name)) << name;
  for (const char* name : {"", "k", "steps", "samples", "step size", "stepsize", "time step", "index", "row", "number",
                           "sample id", "resample", "step 1"})
    EXPECT_FALSE(io::is_step_number(name)) << name;
}

}  // namespace
}  // namespace tokid::testing
