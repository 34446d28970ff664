// A checksum of text that ignores the kind of line ends, which editors and version control change.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace tokid::io {

// XXH3 of the pieces of a text, one after the other, with "\n" for every "\r\n".
class TextChecksum {
 public:
  TextChecksum();
  ~TextChecksum();

  void add(std::string_view piece);
  std::string digits();  // 16 hexadecimal digits in lower case, of all pieces; must be the last call

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tokid::io
