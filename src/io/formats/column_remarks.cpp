// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/column_remarks.hpp"

#include <fmt/format.h>

namespace tokid::io {

std::optional<std::string> remark_on_unused(const Names& columns) {
  if (columns.empty()) return std::nullopt;
  return columns.size() == 1
             ? fmt::format("column {} is not used: name it as input or output if it is a channel", quoted(columns))
             : fmt::format("columns {} are not used: name those that are channels as inputs or outputs",
                           quoted(columns));
}

}  // namespace tokid::io
