// Text that is safe to show to people.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace tokid {

// Text from a file or a name, as one line for people: control characters and line separators, which a terminal would
// obey, become spaces, marks that turn the direction of the text are left out, and what is not UTF-8 becomes U+FFFD.
std::string printable(std::string_view text);

}  // namespace tokid
