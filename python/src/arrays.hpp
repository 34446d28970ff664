// Between NumPy's arrays and the matrices of the library.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "python.hpp"

namespace tokid::python {

// Any array of real numbers in memory, whatever its type and strides; a view of the caller's buffer.
using AnyArray = nb::ndarray<nb::ro, nb::device::cpu>;
using NumPyArray = nb::ndarray<nb::numpy, double>;
using ReadOnlyArray = nb::ndarray<nb::numpy, const double>;

// Samples (N × T × channels) into the columns `offset` … of each step. The one pass over them that their layout needs.
// \throws nb::type_error for another kind of numbers
void write_samples(const AnyArray& samples, Ensemble& ensemble, Index offset);

// A view (N × T × channels) of the columns `offset` … of each step, without a copy; `owner` keeps the samples alive.
NumPyArray samples_view(Ensemble& ensemble, Index offset, Index channels, nb::handle owner);

// The outputs (N × T × m) as an array of their own, in the order of C.
NumPyArray outputs_of(const Ensemble& ensemble);

// A read-only view of a matrix or vector that belongs to `owner`.
ReadOnlyArray view_of(const Matrix& matrix, nb::handle owner);
ReadOnlyArray view_of(const Vector& vector, nb::handle owner);
ReadOnlyArray view_of(const Eigen::Map<const Matrix>& matrix, nb::handle owner);
ReadOnlyArray view_of(const Eigen::Map<const Vector>& vector, nb::handle owner);

// Arrays that own what they hold.
NumPyArray array_of(Matrix matrix);  // (rows × cols), in the order of Fortran
NumPyArray array_of(Vector vector);
NumPyArray array_of(std::vector<double> values, std::vector<size_t> shape);

// Copies of arrays; the shapes are those that Python has seen to.
Matrix matrix_of(const AnyArray& array);  // (rows × cols), or a vector as one column
Vector vector_of(const AnyArray& array);

}  // namespace tokid::python
