// Remarks of the readers of tables, .csv files and DataFrames, on their columns.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "io/arrays.hpp"

namespace tokid::io {

// A remark on columns that are not read, if there are any.
std::optional<std::string> remark_on_unused(const Names& columns);

// The remark for a table without a column that states the step of a row.
inline constexpr std::string_view rows_as_steps =
    "no column of times or step numbers found: the rows of an experiment were taken as successive steps; name a column "
    "of times 'time', one of step numbers 'k'";

}  // namespace tokid::io
