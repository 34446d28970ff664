// One table of samples, read from a .csv file.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/records.hpp"
#include "io/formats/table_numbers.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

struct Table {
  Records records;
  Channels channels;
  Names input_titles, output_titles;  // of the columns
  std::optional<double> dt;
  std::optional<InitialState> initial_state;
  std::vector<Index> length;
  bool names_experiments = false, stamped = false;
  Guesses guesses;
  std::optional<std::string> cut;  // a remark on the end of the file
  Names remarks;
};

// The first one of several tables, which determines their channels.
struct FirstTable {
  std::string file;
  Names inputs, outputs;  // titles of the columns
};

// `first`: the first one of several tables, or null. \throws IoError
Table read_table(const std::filesystem::path& path, const ReadOptions& options, const FirstTable* first);

}  // namespace tokid::io
