// Between UTF-8, the encoding of every text in the library, and what the formats store.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tokid::io {

// Empty where the text is not valid.
std::optional<std::u32string> utf32_from(std::string_view utf8);
std::optional<std::string> utf8_from(std::u32string_view utf32);
std::optional<std::string> utf8_from(std::u16string_view utf16);
std::u16string utf16_from(std::string_view utf8);  // \throws IoError for invalid text

// What every format can store: UTF-8 without NUL. \throws IoError that names the data set
void check_texts(std::string_view name, const std::vector<std::string>& texts);

std::string in_lower_case(std::string text);  // of ASCII, and no other letters

// Length of the UTF-8 character at the front, 0 where there is none.
size_t character_length(std::string_view text);
bool is_control(std::string_view character);  // of ASCII or of what ISO 8859 has above it

}  // namespace tokid::io
