// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Replaces q (rows × cols, rows ≥ cols) by Q of its QR factorisation, up to signs. For every j, the first j columns
// keep their span. The function computes q R⁻¹ twice, with R from Householder reflections. The first pass loses digits
// if q has a large condition number. The second pass restores them, because the columns are then nearly orthonormal. A
// column that depends exactly on the columns before it becomes zero. A column that depends on them only within rounding
// gets an arbitrary direction.
void orthonormalise(Matrix& q);

}  // namespace tokid::linalg
