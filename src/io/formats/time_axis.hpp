// Converts the column of times in a table, as written, to steps of one grid.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid::io {

// Finds how finely a column of numbers is written. Programs leave out trailing zeros, so the longest numbers count.
class Precision {
 public:
  void add(std::string_view text, double value);
  double unit(double value) const;  // a number of this size is a multiple of it

 private:
  int digits_ = 1, decimals_ = 0;
  bool single_ = true;  // all numbers are of single precision
};

struct TimeColumn {
  std::string name;               // as the table has it
  TimeUnit unit;                  // of its times
  std::vector<double> time;       // of each row: time, step or number of the row in its experiment
  std::vector<Index> experiment;  // of each row
  std::vector<Index> line;        // of each row
  Names experiments;              // in the order of appearance
  Precision precision;            // of the times
};

struct Grid {
  double begin = 0.0, dt = 1.0;  // in the unit of the times
  bool shows_dt = false;         // else a single time, with dt = 1

  double step(double time) const { return std::round((time - begin) / dt); }
};

// Finds the grid begin + k dt on which all times lie, to 1e-6 of a step or to the rounding of their printed digits.
// Rounded times count if their unit is at most a third of a step and there are eight of them. `dt` [s] > 0: the stated
// sample time; otherwise it follows from the differences. Gaps of whole steps are missing samples.
// \throws IoError that names the line for a time off the grid, and for a gap too long to be counted; for experiments
// that share no steps or have other sample times, and for a stated dt of which all times are multiples
Grid time_grid(const TimeColumn& rows, std::optional<double> dt);

// Experiments that share no step cannot show how one step differs from another. \throws IoError that names two of them
// and states what is needed
void check_common_steps(const TimeColumn& rows, std::string_view needed);

// The spacing of ordered times, even as for time_grid() and without a gap; empty for others, and for fewer than two.
std::optional<double> even_spacing(const std::vector<double>& times);

}  // namespace tokid::io
