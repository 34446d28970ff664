// Remarks on the columns of tables, for the readers of .csv files and of DataFrames.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "io/arrays.hpp"

namespace tokid::io {

// A remark that these columns are not read; empty if `columns` is empty.
std::optional<std::string> remark_on_unused(const Names& columns);

// The remark on a table in which no column states the steps of the rows.
inline constexpr std::string_view rows_as_steps =
    "no column of times or step numbers found: the rows of an experiment were taken as successive steps. Name a column "
    "of times 'time', or a column of step numbers 'k'";

}  // namespace tokid::io
