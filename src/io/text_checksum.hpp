// The checksum of a text, which editors and version control change the line ends of.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace tokid::io {

// XXH3 of the pieces of a text, with "\n" for every "\r\n", one piece after the other.
class TextChecksum {
 public:
  TextChecksum();
  ~TextChecksum();

  void add(std::string_view piece);
  std::string digits();  // 16 hexadecimal ones in lower case, of all pieces; nothing is added after that

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tokid::io
