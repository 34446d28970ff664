// Named row-major arrays, which every format reads and writes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "tokid/io.hpp"

namespace tokid::io {

using Names = std::vector<std::string>;
using Shape = std::vector<size_t>;  // empty: a scalar

// Throws IoError. The messages in src/io do not contain the name of the file; naming() puts the name in front.
[[noreturn]] void fail_with(std::string text);
template <typename... T>
[[noreturn]] void fail(fmt::format_string<T...> text, T&&... values) {
  fail_with(fmt::format(text, std::forward<T>(values)...));
}

// Values of a kind that tokid does not use. A data set of this kind causes an error only if tokid needs its values.
struct Foreign {
  std::string what;  // "complex numbers"
  bool operator==(const Foreign&) const = default;
};

struct Array {
  Shape shape;
  std::variant<std::vector<double>, std::vector<std::int64_t>, std::vector<std::string>, Foreign> values;
};

using Arrays = std::vector<std::pair<std::string, Array>>;  // in the order of the file

// MATLAB drops trailing dimensions of size one. In its layout, a stack of matrices has the step as its last index.
enum class Layout { plain, matlab };

struct Contents {
  Names names;    // of all data sets in the file
  Arrays arrays;  // the wanted data sets that exist; readers turn every number into a double
  Layout layout = Layout::plain;
};

bool contains(const Names& names, std::string_view name);

// Adds an array to `found`. It does nothing if `found` has an array of this name and these values, in any shape.
// \throws IoError if the array of this name has other values
void add_once(const std::string& name, Array array, Arrays& found);

// \throws IoError if the product is too large
size_t checked_product(const Shape& shape, size_t item_bytes = 1);

// Axis i of the result is axis order[i] of the argument.
Array permuted(const Array& array, const std::vector<size_t>& order);
// Reverses all axes, which converts between row-major and column-major order.
Array reversed(const Array& array);

std::string text(const Shape& shape);    // "(2, 80, 1)"
std::string quoted(const Names& names);  // "'u', 'y'", the first of many; "nothing" for none

}  // namespace tokid::io
