// Converts between NumPy's arrays and the matrices of the library.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "python.hpp"

namespace tokid::python {

// A view of the caller's array of real numbers, of any type and with any strides.
using AnyArray = nb::ndarray<nb::ro, nb::device::cpu>;
using NumPyArray = nb::ndarray<nb::numpy, double>;
using ReadOnlyArray = nb::ndarray<nb::numpy, const double>;

// Copies samples (N × T × channels) into the ensemble: into the columns from `offset` on of each step. \throws
// nb::type_error for an array of other values than real numbers
void write_samples(const AnyArray& samples, Ensemble& ensemble, Index offset);

// A view (N × T × channels) of the samples, without a copy: of `channels` columns from `offset` on of each step.
// `owner` keeps the samples alive.
NumPyArray samples_view(Ensemble& ensemble, Index offset, Index channels, nb::handle owner);

// Free responses (Nf × Tf × m).
FreeResponse free_response_of(const AnyArray& y);

// A copy of the outputs (N × T × m), in the order of C.
NumPyArray outputs_of(const Ensemble& ensemble);

// A read-only view of a matrix or vector that belongs to `owner`.
ReadOnlyArray view_of(const Eigen::Map<const Matrix>& matrix, nb::handle owner);
ReadOnlyArray view_of(const Eigen::Map<const Vector>& vector, nb::handle owner);

// An array that owns its values, in the order of C.
NumPyArray array_of(std::vector<double> values, std::vector<size_t> shape);

// An array of these sizes, in the order of C, with the numbers entry(i, j, …).
template <class Entry, class... Sizes>
auto array_of_entries(const Entry& entry, Sizes... sizes) {
  using Number = std::decay_t<decltype(entry(Index(sizes)...))>;
  const std::array<size_t, sizeof...(sizes)> shape{size_t(sizes)...};
  const size_t count = (size_t(sizes) * ...);
  auto held = std::make_unique<Number[]>(count);
  std::array<Index, sizeof...(sizes)> at{};
  for (size_t i = 0; i < count; ++i) {
    held[i] = std::apply(entry, at);
    for (size_t d = at.size(); d-- > 0 && ++at[d] == Index(shape[d]);) at[d] = 0;
  }
  Number* first = held.get();
  const nb::capsule owner(held.release(), [](void* p) noexcept { delete[] static_cast<Number*>(p); });
  return nb::ndarray<nb::numpy, Number, nb::ndim<sizeof...(sizes)>>(first, shape.size(), shape.data(), owner);
}

}  // namespace tokid::python
