// What readers of tables, .csv files and DataFrames, tell of their columns.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "io/arrays.hpp"

namespace tokid::io {

// Of columns that are passed over, if there are any.
std::optional<std::string> remark_on_unused(const Names& columns);

// Where no column says to which step a row belongs.
inline constexpr std::string_view rows_as_steps =
    "no column of times or step numbers found: the rows of an experiment were taken as successive steps; name a column "
    "of times 'time', one of step numbers 'k'";

}  // namespace tokid::io
