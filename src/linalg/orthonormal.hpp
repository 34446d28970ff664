// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Replaces q (rows × cols, rows ≥ cols) by an orthonormal basis of the same nested subspaces, those of its first
// columns. This is Q of its QR factorisation, up to signs. It is computed twice as Q = A R⁻¹, with R from Householder
// reflections. The first pass loses digits with the condition of A; the second one restores them from a nearly
// orthonormal basis. A column that depends exactly on the columns before becomes zero. A column that depends on them
// within rounding gets an arbitrary direction.
void orthonormalise(Matrix& q);

}  // namespace tokid::linalg
