// The columns of a .csv: which are inputs and outputs, and which state the experiments and steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/notes.hpp"

namespace tokid::io {

// Is this the name of the column of experiments, times or step numbers? No channel may have it.
bool is_reserved(const std::string& name);

struct CsvColumns {
  std::vector<size_t> inputs, outputs;
  std::optional<size_t> experiment, time, step;  // step numbers, if there are no times
  Names unused;  // names of the other columns

  std::optional<size_t> place() const { return time ? time : step; }
};

// Inputs and outputs are the columns that the caller states, or else those that the comments of the file name, or else
// those of `options.wanted` if the file has all of them, or else those whose names begin with u and y.
// \throws IoError for a column that is missing or occurs twice, and for a table without inputs or without needed
// outputs
CsvColumns csv_columns(const Names& header, const Notes& notes, const ReadOptions& options);

// Names and units of the channels.
Channels csv_channels(const Names& header, const Notes& notes, const CsvColumns& columns);

}  // namespace tokid::io
