// The data sets of a file by name, with checks of their types and shapes. Every error states the data set, the value in
// the file and the needed value.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/arrays.hpp"

namespace tokid::io {

class Fields {
 public:
  explicit Fields(Contents contents) : contents_(std::move(contents)) {}

  const Names& names() const { return contents_.names; }
  Layout layout() const { return contents_.layout; }
  bool has(std::string_view name) const { return find(name) != nullptr; }

  // Each of these functions throws IoError if the data set is missing or has another type.
  const std::vector<double>& numbers(std::string_view name) const;
  const Shape& shape(std::string_view name) const;
  double number(std::string_view name) const;
  Index integer(std::string_view name) const;
  std::string text(std::string_view name) const;
  const std::vector<std::string>& texts(std::string_view name) const;
  // A list of texts. Numbers are converted to the shortest texts that represent them.
  std::vector<std::string> labels(std::string_view name) const;
  const std::vector<double>& list(std::string_view name, size_t count) const;
  std::vector<Index> integers(std::string_view name, size_t count, Index low, Index high) const;
  Matrix matrix(std::string_view name) const;
  // A matrix for each of S steps, with the shape (S, rows, columns). In MATLAB's layout the file has rows × columns ×
  // S, where MATLAB drops trailing ones.
  Array stack(std::string_view name) const;
  Shape stack_shape(std::string_view name) const;

 private:
  const Array* find(std::string_view name) const;
  const Array& get(std::string_view name) const;

  Contents contents_;
};

[[noreturn]] void fail_shape(std::string_view name, const Shape& found, std::string_view needed);

}  // namespace tokid::io
