// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/fields.hpp"

#include <algorithm>
#include <cmath>

namespace tokid::io {

namespace {

// 2^53: above it, doubles cannot represent all whole numbers.
constexpr double largest_integer = 9007199254740992.0;

std::string kind(const Array& array) {
  if (const auto* foreign = std::get_if<Foreign>(&array.values)) return foreign->what;
  return std::holds_alternative<std::vector<std::string>>(array.values) ? "text" : "numbers";
}

Index whole(std::string_view name, double value, double low, double high) {
  if (!(value >= low && value <= high) || value != std::floor(value))
    fail("data set '{}': {} found, {} needed", name, value,
         high == largest_integer ? "a whole number" : fmt::format("whole numbers from {} to {}", low, high));
  return static_cast<Index>(value);
}

}  // namespace

void fail_shape(std::string_view name, const Shape& found, std::string_view needed) {
  fail("data set '{}': shape {} found, {} needed", name, text(found), needed);
}

const Array* Fields::find(std::string_view name) const {
  const auto at = std::find_if(contents_.arrays.begin(), contents_.arrays.end(),
                               [&](const auto& entry) { return entry.first == name; });
  return at == contents_.arrays.end() ? nullptr : &at->second;
}

const Array& Fields::get(std::string_view name) const {
  if (const Array* array = find(name)) return *array;
  fail("no data set '{}' found among {}, one needed", name, quoted(contents_.names));
}

const std::vector<double>& Fields::numbers(std::string_view name) const {
  const Array& array = get(name);
  if (const auto* values = std::get_if<std::vector<double>>(&array.values)) return *values;
  fail("data set '{}': {} found, real numbers needed", name, kind(array));
}

const Shape& Fields::shape(std::string_view name) const { return get(name).shape; }

double Fields::number(std::string_view name) const {
  const auto& values = numbers(name);
  if (values.size() != 1) fail_shape(name, shape(name), "one number");
  return values.front();
}

Index Fields::integer(std::string_view name) const {
  return whole(name, number(name), -largest_integer, largest_integer);
}

const std::vector<std::string>& Fields::texts(std::string_view name) const {
  const Array& array = get(name);
  if (const auto* values = std::get_if<std::vector<std::string>>(&array.values)) return *values;
  fail("data set '{}': {} found, text needed", name, kind(array));
}

std::string Fields::text(std::string_view name) const {
  const auto& values = texts(name);
  if (values.size() != 1) fail("data set '{}': {} texts found, one needed", name, values.size());
  return values.front();
}

std::vector<std::string> Fields::labels(std::string_view name) const {
  const auto* values = std::get_if<std::vector<double>>(&get(name).values);
  if (!values) return texts(name);
  std::vector<std::string> result;
  for (const double value : *values) result.push_back(fmt::format("{}", value));
  return result;
}

const std::vector<double>& Fields::list(std::string_view name, size_t count) const {
  const auto& values = numbers(name);
  // (N), (N, 1) and (1, N) are accepted, because MATLAB has no lists.
  const Shape& found = shape(name);
  const auto longest = found.empty() ? size_t{1} : *std::max_element(found.begin(), found.end());
  if (values.size() != count || (count > 0 && longest != count)) fail_shape(name, found, fmt::format("({})", count));
  return values;
}

std::vector<Index> Fields::integers(std::string_view name, size_t count, Index low, Index high) const {
  std::vector<Index> result;
  for (const double value : list(name, count))
    result.push_back(whole(name, value, static_cast<double>(low), static_cast<double>(high)));
  return result;
}

Matrix Fields::matrix(std::string_view name) const {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto& values = numbers(name);
  const Shape& found = shape(name);
  if (found.size() != 2) fail_shape(name, found, "two dimensions");
  return Eigen::Map<const RowMajor>(values.data(), static_cast<Index>(found[0]), static_cast<Index>(found[1]));
}

Array Fields::stack(std::string_view name) const {
  const Shape needed = stack_shape(name);
  Array array = get(name);
  if (layout() != Layout::matlab) return array;
  array.shape = {needed[1], needed[2], needed[0]};
  return permuted(array, {2, 0, 1});
}

Shape Fields::stack_shape(std::string_view name) const {
  numbers(name);
  Shape found = shape(name);
  if (layout() == Layout::matlab && found.size() == 2) found.push_back(1);
  if (found.size() != 3) fail_shape(name, found, "three dimensions");
  return layout() == Layout::matlab ? Shape{found[2], found[0], found[1]} : found;
}

}  // namespace tokid::io
