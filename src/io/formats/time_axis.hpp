// Converts the column of times of a table, as its text is written, to steps of a grid.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid::io {

// Finds to how many digits a column of numbers is rounded. Programs leave out trailing zeros, so the longest numbers
// determine the result.
class Precision {
 public:
  void add(std::string_view text, double value);
  void add(const Precision& other);  // as if its numbers had been added
  double unit(double value) const;   // the unit to which numbers of this size are rounded

 private:
  int digits_ = 1, decimals_ = 0;
  bool single_ = true;  // all numbers can be in single precision
};

struct TimeColumn {
  std::string name;               // as in the table
  TimeUnit unit;                  // unit of the times
  std::vector<double> time;       // of each row: its time, its step number, or its position in its experiment
  std::vector<Index> experiment;  // of each row
  std::vector<Index> line;        // of each row
  Names experiments;              // in the order of appearance
  Names files;                    // of each experiment, where the rows come from several files; else empty
  Precision precision;            // of the times
  double largest = 0.0;           // absolute time before the times were moved, whose rounding they keep
};

// "line 17", or "run3.csv, line 17" where the rows come from several files.
std::string place(const TimeColumn& rows, size_t row);

struct Grid {
  double begin = 0.0, dt = 1.0;  // in the unit of the times
  bool shows_dt = false;         // dt follows from the times; false: there is only one time, and dt = 1

  double step(double time) const { return std::round((time - begin) / dt); }
};

// Finds the grid begin + k dt of all times. Times may deviate from it by 1e-6 of a step, or by the rounding of their
// printed digits. Such rounding is accepted only if its unit is at most a third of a step and there are at least eight
// different steps. `dt` [s] > 0: the stated sample time; without it, dt follows from the differences of the times. Gaps
// of several steps are missing samples.
// \throws IoError that names the line, for a time that is not on the grid and for a gap too long to count its steps;
// IoError for experiments without a common step or with different sample times, and for rows that are all several
// stated dt apart
Grid time_grid(const TimeColumn& rows, std::optional<double> dt);

struct MovedGrid {
  Grid grid;
  double largest = 0.0;  // largest distance of a time from its step, in the unit of the times
};

// The grid of the stated `dt` [s] that is nearest to all times, which may lie up to a tenth of a step beside it.
// \throws IoError that names the line of a time farther from its step; IoError for rows that are all several dt apart
MovedGrid moved_grid(const TimeColumn& rows, double dt);

// Checks that all experiments have a step in common; otherwise the data are not repeated experiments. \throws IoError
// that names two experiments without a common step, and ends with `needed`
void check_common_steps(const TimeColumn& rows, std::string_view needed);

// The spacing of increasing times that time_grid() accepts and that have no gap; empty for other times, and for fewer
// than two.
std::optional<double> even_spacing(const std::vector<double>& times);

}  // namespace tokid::io
