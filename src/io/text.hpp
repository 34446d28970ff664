// Converts between UTF-8, which the library uses for all texts, and the encodings of the file formats.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/unicode.hpp"

namespace tokid::io {

using unicode::character_length, unicode::is_control, unicode::utf32_from, unicode::utf8_from;

std::u16string utf16_from(std::string_view utf8);  // \throws IoError for invalid text

// Checks that every format can store the texts: they must be UTF-8 without NUL. \throws IoError that names the data set
void check_texts(std::string_view name, const std::vector<std::string>& texts);

std::string in_lower_case(std::string text);  // changes ASCII letters only

}  // namespace tokid::io
