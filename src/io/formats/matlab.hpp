// Common parts of the two file formats for MATLAB's variables: .mat, and the HDF5 of version 7.3.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/arrays.hpp"

namespace tokid::io {

// Converts a char array to texts, one for each row. If there are several rows, the blanks at their ends are removed,
// because MATLAB pads rows to one width. One row becomes a scalar. `codes` are in MATLAB's order (column-major).
Array char_array(const std::u16string& codes, const Shape& shape);

// Converts numbers to MATLAB's form: column-major doubles with at least two dimensions. The shape of the result lists
// the axes in reverse order.
Array column_major(const Array& numbers);

}  // namespace tokid::io
