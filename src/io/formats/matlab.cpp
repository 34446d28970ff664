// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/matlab.hpp"

#include <algorithm>

#include "io/text.hpp"

namespace tokid::io {

Array char_array(const std::u16string& codes, const Shape& shape) {
  if (codes.empty()) return {{}, std::vector<std::string>{""}};
  if (shape.size() != 2) return {shape, Foreign{"a char array of more than two dimensions"}};
  const size_t rows = shape[0], columns = shape[1];
  std::vector<std::string> texts;
  for (size_t i = 0; i < rows; ++i) {
    std::u16string row;
    for (size_t j = 0; j < columns; ++j) row += codes[i + j * rows];
    while (rows > 1 && !row.empty() && row.back() == u' ') row.pop_back();
    const auto text = utf8_from(row);
    if (!text) return {shape, Foreign{"a char array that is not valid Unicode"}};
    texts.push_back(*text);
  }
  return {rows == 1 ? Shape{} : Shape{rows}, std::move(texts)};
}

Array column_major(const Array& numbers) {
  Array array = numbers;
  if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&numbers.values))
    array.values = std::vector<double>(integers->begin(), integers->end());
  array.shape.resize(std::max(array.shape.size(), size_t{2}), 1);
  return reversed(array);
}

}  // namespace tokid::io
