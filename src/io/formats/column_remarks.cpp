// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/column_remarks.hpp"

#include <fmt/format.h>

namespace tokid::io {

std::optional<std::string> remark_on_unused(const Names& columns) {
  if (columns.empty()) return std::nullopt;
  return columns.size() == 1
             ? fmt::format("column {} is not used. If it is a channel, name it as an input or an output",
                           quoted(columns))
             : fmt::format("columns {} are not used. Name the columns that are channels as inputs or outputs",
                           quoted(columns));
}

}  // namespace tokid::io
