// Text that is safe to display.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace tokid {

// Makes one safe line of text from a file or a name. Control characters and line separators, which a terminal would
// obey, become spaces. Characters that change the text direction are removed. Bytes that are not UTF-8 become U+FFFD.
std::string printable(std::string_view text);

}  // namespace tokid
