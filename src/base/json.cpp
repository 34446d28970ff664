// SPDX-License-Identifier: BSD-3-Clause
#include "base/json.hpp"

#include <algorithm>

namespace tokid {

Json parse_json(std::string_view text) { return Json::parse(text, nullptr, false); }

std::string text_of(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

JsonMeasure measure_json(std::string_view text) {
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

bool is_modest(std::string_view options) {
  const JsonMeasure found = measure_json(options);
  return options.size() <= longest_options && found.depth <= deepest_options && found.keys <= most_options;
}

Json options_json(const std::string& options) {
  return is_modest(options) ? parse_json(options) : Json(Json::value_t::discarded);
}

}  // namespace tokid
