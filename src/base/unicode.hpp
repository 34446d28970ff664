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

// Length of the UTF-8 character at the front, 0 without one.
size_t character_length(std::string_view text);
bool is_control(std::string_view character);  // of ASCII or of the upper half of ISO 8859

}  // namespace tokid::unicode
