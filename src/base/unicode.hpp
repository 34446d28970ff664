// Decoding, checking and encoding of UTF-8, the encoding of every text in the library.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tokid::unicode {

// Conversions; empty if the text is not valid.
std::optional<std::u32string> utf32_from(std::string_view utf8);
std::optional<std::string> utf8_from(std::u32string_view utf32);
std::optional<std::string> utf8_from(std::u16string_view utf16);

// Number of bytes of the first UTF-8 character of a text that is not empty; 0 if these bytes are not valid.
size_t character_length(std::string_view text);
bool is_control(std::string_view character);  // a control character of ASCII, or one of U+0080 … U+009F

}  // namespace tokid::unicode
