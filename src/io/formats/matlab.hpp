// Common parts of the two containers of MATLAB's variables: .mat, and the HDF5 of version 7.3.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/arrays.hpp"

namespace tokid::io {

// A char array: one text for each row, without the blanks that pad rows to one width; scalar for one row. The codes are
// column-major, as MATLAB keeps them.
Array char_array(const std::u16string& codes, const Shape& shape);

// Numbers as MATLAB keeps them: column-major doubles of at least two dimensions. The result has the axes reversed.
Array column_major(const Array& numbers);

}  // namespace tokid::io
