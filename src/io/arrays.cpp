// SPDX-License-Identifier: BSD-3-Clause
#include "io/arrays.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <type_traits>

namespace tokid::io {

namespace {

Shape row_major_strides(const Shape& shape) {
  Shape strides(shape.size(), 1);
  for (size_t i = shape.size(); i-- > 1;) strides[i - 1] = strides[i] * shape[i];
  return strides;
}

template <typename T>
void gather(const std::vector<T>& in, size_t offset, const Shape& shape, const Shape& strides, size_t axis,
            std::vector<T>& out) {
  if (axis == shape.size()) return out.push_back(in[offset]);
  for (size_t i = 0; i < shape[axis]; ++i) gather(in, offset + i * strides[axis], shape, strides, axis + 1, out);
}

}  // namespace

// An exception's what() ends at the first zero character, and texts from files may contain zero characters.
void fail_with(std::string text) {
  for (size_t at = 0; (at = text.find('\0', at)) != std::string::npos;) text.replace(at, 1, "\uFFFD");
  throw IoError(text);
}

bool contains(const Names& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

namespace {

// NaN marks a missing value in both arrays, so two NaN are equal.
bool are_same(const Array& a, const Array& b) {
  const auto *x = std::get_if<std::vector<double>>(&a.values), *y = std::get_if<std::vector<double>>(&b.values);
  if (!x || !y) return a.values == b.values;
  return std::equal(x->begin(), x->end(), y->begin(), y->end(),
                    [](double p, double q) { return p == q || (std::isnan(p) && std::isnan(q)); });
}

}  // namespace

void add_once(const std::string& name, Array array, Arrays& found) {
  const auto before = std::find_if(found.begin(), found.end(), [&](const auto& entry) { return entry.first == name; });
  if (before == found.end()) return static_cast<void>(found.emplace_back(name, std::move(array)));
  if (!are_same(before->second, array)) fail("data set '{}': found twice, with different values; one needed", name);
}

size_t checked_product(const Shape& shape, size_t item_bytes) {
  if (std::find(shape.begin(), shape.end(), 0u) != shape.end()) return 0;
  // Half the range of size_t, because sizes must fit into the signed indices of Eigen.
  constexpr size_t limit = std::numeric_limits<size_t>::max() / 2;
  size_t product = item_bytes;
  for (const size_t n : shape) {
    if (product > limit / n) fail("shape {} found, sizes that fit into memory needed", text(shape));
    product *= n;
  }
  return product;
}

Array permuted(const Array& array, const std::vector<size_t>& order) {
  const Shape from = row_major_strides(array.shape);
  Array result;
  Shape strides;
  for (const size_t axis : order) {
    result.shape.push_back(array.shape[axis]);
    strides.push_back(from[axis]);
  }
  const bool empty = checked_product(array.shape) == 0;
  std::visit(
      [&](const auto& values) {
        using Values = std::decay_t<decltype(values)>;
        if constexpr (std::is_same_v<Values, Foreign>) {
          result.values = values;
        } else {
          Values out;
          out.reserve(values.size());
          if (!empty) gather(values, 0, result.shape, strides, 0, out);
          result.values = std::move(out);
        }
      },
      array.values);
  return result;
}

Array reversed(const Array& array) {
  std::vector<size_t> order(array.shape.size());
  std::iota(order.rbegin(), order.rend(), size_t{0});
  return permuted(array, order);
}

std::string text(const Shape& shape) { return fmt::format("({})", fmt::join(shape, ", ")); }

std::string quoted(const Names& names) {
  constexpr size_t most = 30;
  if (names.empty()) return "nothing";
  const auto end = names.begin() + std::ptrdiff_t(std::min(names.size(), most));
  return fmt::format("'{}'{}", fmt::join(names.begin(), end, "', '"),
                     names.size() > most ? fmt::format(" and {} more", names.size() - most) : "");
}

}  // namespace tokid::io
