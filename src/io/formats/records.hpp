// Rows of samples of one or several tables, and the ensemble that they make.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/table_numbers.hpp"
#include "io/formats/time_axis.hpp"

namespace tokid::io {

// What states the steps of the rows: times, step numbers, or the order of the rows.
enum class StepSource { times, numbers, order };

// Does the trigger hold at a row? Unknown: its sample is missing.
enum class Event : unsigned char { unknown, fails, holds };

struct Records {
  Names inputs, outputs;  // names of the r + m channels
  StepSource source = StepSource::order;
  std::string doubt;   // the end of messages about step numbers that may be something else
  std::string advice;  // the end of messages about rows of the same step: a column that may name the experiments
  TimeColumn rows;
  std::vector<double> samples;  // (rows, r + m)
  std::vector<bool> held;       // of each channel: does it hold its value between two samples? Empty: none does
  std::vector<Event> event;     // of each row, with a trigger
  ColumnValues trigger_values;  // of the column of the trigger
  Names remarks;                // on what was done with the rows

  size_t channels() const { return inputs.size() + outputs.size(); }
};

// Appends the experiments of `more`, whose channels must be the same.
void append(const Records& more, Records& to);

// Decides whether the times of different experiments are those of one clock. If all experiments have most of the
// shortest one in common, the times stay. Otherwise each experiment begins with its own first row. Returns a remark on
// what was done, unless all begin at the same time.
std::optional<std::string> begin_together(Records& records);

// Moves the time of each experiment, so that the first row at which the trigger begins to hold has the time 0. If it
// already holds at the first row and does not begin again, this row has the time 0. Remarks name the experiments in
// which it already holds at the first row, and those in which it never holds, which are dropped. `before`: the step
// that this row becomes. \throws IoError if it holds in no experiment
void align(const std::string& trigger, Index before, Records& records);

struct Resampling {
  double dt = 1.0;  // [s]
  ResampleMethod method = ResampleMethod::linear;
  std::optional<Index> longest_gap;  // steps of dt or of the usual distance of the samples, whichever is longer
  std::optional<Index> longest_gap_of_held = {};  // of held channels, whose method is previous
};

// Samples on the grid begin + k dt, where begin is 0 if `aligned`, and else the first time of all rows. A remark states
// what this does to the noise, and remarks name repeated times, steps much shorter than the distance of the samples,
// and channels that should perhaps be held. \throws IoError unless the rows have times
void resample(const Resampling& choice, bool aligned, Records& records);

struct Assembly {
  std::optional<double> dt;     // stated sample time [s]
  bool moved = false;           // times may lie beside the steps of `dt`: see moved_grid()
  std::optional<Index> before;  // steps to keep before the time 0 of aligned records
  bool own_lengths = false;     // each experiment ends with its last row; false: absent rows are missing samples
};

// The ensemble with its samples, sample time, lengths and names of experiments, without names of channels.
// \throws IoError that names a line, for times off the grid and for rows of the same step
Ensemble assembled(const Records& records, const Assembly& choice);

}  // namespace tokid::io
