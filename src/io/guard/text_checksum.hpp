// A checksum of a text that does not depend on the kind of line ends, because editors and version control change them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace tokid::io {

// The hash XXH3 of a text that is added piece by piece. "\r\n" counts as "\n".
class TextChecksum {
 public:
  TextChecksum();
  ~TextChecksum();

  void add(std::string_view piece);
  std::string digits();  // 16 hexadecimal digits in lower case, for all pieces; must be the last call

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tokid::io
