// SPDX-License-Identifier: BSD-3-Clause
#include "base/unicode.hpp"

#include <algorithm>

#include "tokid/printable.hpp"

namespace tokid::unicode {

namespace {

bool is_surrogate(char32_t c) { return c >= 0xD800 && c < 0xE000; }
bool is_valid(char32_t c) { return c < 0x110000 && !is_surrogate(c); }

void append_utf8(std::string& out, char32_t c) {
  const auto tail = [&](int shift) { out += static_cast<char>(0x80 | ((c >> shift) & 0x3F)); };
  if (c < 0x80) {
    out += static_cast<char>(c);
  } else if (c < 0x800) {
    out += static_cast<char>(0xC0 | (c >> 6)), tail(0);
  } else if (c < 0x10000) {
    out += static_cast<char>(0xE0 | (c >> 12)), tail(6), tail(0);
  } else {
    out += static_cast<char>(0xF0 | (c >> 18)), tail(12), tail(6), tail(0);
  }
}

}  // namespace

std::optional<std::u32string> utf32_from(std::string_view utf8) {
  constexpr char32_t smallest[] = {0, 0x80, 0x800, 0x10000};  // for 0 … 3 continuation bytes
  std::u32string out;
  for (size_t i = 0; i < utf8.size();) {
    const auto lead = static_cast<unsigned char>(utf8[i++]);
    const size_t more = lead < 0x80 ? 0 : lead >> 5 == 6 ? 1 : lead >> 4 == 14 ? 2 : lead >> 3 == 30 ? 3 : 4;
    if (more == 4 || utf8.size() - i < more) return std::nullopt;
    char32_t c = more == 0 ? lead : lead & (0x3Fu >> more);
    for (size_t j = 0; j < more; ++j) {
      const auto byte = static_cast<unsigned char>(utf8[i++]);
      if (byte >> 6 != 2) return std::nullopt;
      c = (c << 6) | (byte & 0x3F);
    }
    if (!is_valid(c) || c < smallest[more]) return std::nullopt;
    out += c;
  }
  return out;
}

std::optional<std::string> utf8_from(std::u32string_view utf32) {
  std::string out;
  for (const char32_t c : utf32) {
    if (!is_valid(c)) return std::nullopt;
    append_utf8(out, c);
  }
  return out;
}

std::optional<std::string> utf8_from(std::u16string_view utf16) {
  std::u32string out;
  for (size_t i = 0; i < utf16.size(); ++i) {
    char32_t c = utf16[i];
    const bool pair =
        c >= 0xD800 && c < 0xDC00 && i + 1 < utf16.size() && utf16[i + 1] >= 0xDC00 && utf16[i + 1] < 0xE000;
    if (pair) c = 0x10000 + ((c & 0x3FF) << 10) + (utf16[++i] & 0x3FF);
    out += c;
  }
  return utf8_from(out);
}

size_t character_length(std::string_view text) {
  const auto byte = [&text](size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return 1;
  const size_t length = lead >= 0xC2 && lead <= 0xDF   ? 2
                        : (lead & 0xF0) == 0xE0        ? 3
                        : lead >= 0xF0 && lead <= 0xF4 ? 4
                                                       : 0;
  if (length == 0 || length > text.size()) return 0;
  for (size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xC0) != 0x80) return 0;
  // Overlong forms, surrogates, and code points above U+10FFFF are invalid.
  if ((lead == 0xE0 && byte(1) < 0xA0) || (lead == 0xED && byte(1) > 0x9F) || (lead == 0xF0 && byte(1) < 0x90) ||
      (lead == 0xF4 && byte(1) > 0x8F))
    return 0;
  return length;
}

bool is_control(std::string_view character) {
  const auto first = static_cast<unsigned char>(character[0]);
  return first < 0x20 || first == 0x7F || (first == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0);
}

namespace {

// Characters that change the text direction.
bool is_turn(char32_t c) {
  return c == 0x061C || c == 0x200E || c == 0x200F || (c >= 0x202A && c <= 0x202E) || (c >= 0x2066 && c <= 0x2069);
}

bool is_separator(char32_t c) { return c == 0x2028 || c == 0x2029; }  // line and paragraph separator

}  // namespace

}  // namespace tokid::unicode

std::string tokid::printable(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const size_t length = unicode::character_length(text);
    const std::string_view character = text.substr(0, std::max<size_t>(1, length));
    text.remove_prefix(character.size());
    if (length == 0)
      result += "\xEF\xBF\xBD";
    else if (const char32_t code = unicode::utf32_from(character)->front();
             unicode::is_control(character) || unicode::is_separator(code))
      result += ' ';
    else if (!unicode::is_turn(code))
      result += character;
  }
  return result;
}
