// SPDX-License-Identifier: BSD-3-Clause
#include "text.hpp"

#include "arrays.hpp"

namespace tokid::io {

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

std::u16string utf16_from(std::string_view utf8) {
  const auto utf32 = utf32_from(utf8);
  if (!utf32) fail("text '{}': invalid bytes found, UTF-8 needed", single_line(utf8));
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
      fail("data set '{}': text '{}' found, UTF-8 without NUL needed", name, single_line(text));
}

std::string single_line(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) c = ' ';
  return out;
}

}  // namespace tokid::io
