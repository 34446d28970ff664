// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// q (rows × cols, rows ≥ cols) becomes an orthonormal basis of the same nested subspaces, those of its first columns:
// Q of its QR factorisation, up to signs, by twice Q = A R⁻¹ with R of Householder reflections. The first pass loses
// digits with the condition of A, which the second one has from a basis that is nearly orthonormal. A column that
// depends on those before to the last bit becomes zero; one that does so to rounding errors gets some direction.
void orthonormalise(Matrix& q);

}  // namespace tokid::linalg
