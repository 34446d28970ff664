// Model::options as JSON, without trust in where the text comes from.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace tokid {

constexpr std::size_t longest_options = std::size_t{1} << 24, deepest_options = 16, most_options = 1024;

struct JsonMeasure {
  std::size_t depth = 0, keys = 0;
};

// Of any text: brackets and colons that are not within a string.
inline JsonMeasure measure_json(std::string_view text) {
  JsonMeasure found;
  std::size_t depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string && c == '\\')
      ++i;
    else if (c == '"')
      in_string = !in_string;
    else if (in_string)
      continue;
    else if (c == '[' || c == '{')
      found.depth = std::max(found.depth, ++depth);
    else if ((c == ']' || c == '}') && depth > 0)
      --depth;
    else if (c == ':')
      ++found.keys;
  }
  return found;
}

// Copies and texts of a JSON value are made by recursion, and the keys of an ordered object are searched one by one: a
// text that is far deeper than any identification writes would take the stack, and one of many keys forever.
inline bool is_modest(std::string_view options) {
  const JsonMeasure found = measure_json(options);
  return options.size() <= longest_options && found.depth <= deepest_options && found.keys <= most_options;
}

// Discarded where the text is none, or not modest.
template <class Json = nlohmann::json>
Json options_json(const std::string& options) {
  return is_modest(options) ? Json::parse(options, nullptr, false) : Json(Json::value_t::discarded);
}

}  // namespace tokid
