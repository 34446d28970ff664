// SPDX-License-Identifier: BSD-3-Clause
#include "io/text.hpp"

#include "io/arrays.hpp"
#include "tokid/printable.hpp"

namespace tokid::io {

std::u16string utf16_from(std::string_view utf8) {
  const auto utf32 = utf32_from(utf8);
  if (!utf32) fail("text '{}': invalid bytes found, UTF-8 needed", printable(utf8));
  std::u16string out;
  for (const char32_t c : *utf32) {
    if (c >= 0x10000) out += static_cast<char16_t>(0xD800 + ((c - 0x10000) >> 10));
    out += static_cast<char16_t>(c >= 0x10000 ? 0xDC00 + (c & 0x3FF) : c);
  }
  return out;
}

void check_texts(std::string_view name, const std::vector<std::string>& texts) {
  for (const auto& text : texts)
    if (!utf32_from(text) || text.find('\0') != std::string::npos)
      fail("data set '{}': text '{}' found, UTF-8 without NUL needed", name, printable(text));
}

std::string in_lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return text;
}

}  // namespace tokid::io
